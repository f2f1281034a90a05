"""What a machine file leaves out is what it would say with the default written out."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.built_machines import FRAMES, POSE
from support.moving_machines import written
from support.telescope_legs import leg_rows
from truepose.models.machine.machine import Machine

HOME = "  home: [0, 0, 440, 0, 0, 5]\n  legs:\n"


def legs(kind: str, fields: str) -> str:
    return FRAMES + f"mechanism:\n  type: {kind}\n" + HOME + leg_rows(fields) + POSE


MECHANISMS = {
    "6-pus": (legs("6-pus", "length: 500"), legs("6-pus", "length: 500, offset: 0, gain: 1, u: [0, 0, 1]")),
    "6-ups": (legs("6-ups", "range: [480, 560]"), legs("6-ups", "range: [480, 560], offset: 0, gain: 1")),
}


ARM = "mechanism:\n  type: serial\n  joints:\n    - {name: q1, kind: revolute, range: [-90, 90]}\n"
SENSORS = {
    "socket": (
        "{type: socket, sigma: {xyz: 0.05}}",
        "{type: socket, ball: [0, 0, 0], sigma: {xyz: 0.05}, tolerance: {ball: [0, 0, 0]}}",
    ),
    "distance": (
        "{type: distance, sigma: {distance: 0.001}, beam: {xyz: [0, 0, 900]}, mirror: {in: tool}}",
        "{type: distance, sigma: {distance: 0.001}, beam: {in: world, xyz: [0, 0, 900], rx: 0, rz: 0}, "
        "mirror: {in: tool, z: 0, rx: 0, ry: 0}, "
        "tolerance: {beam.xyz: [0, 0, 0], beam.angle: 0, mirror.z: 0, mirror.angle: 0}}",
    ),
    "targets": (
        "{type: targets, points: {A: [30, 0, 10]}, sigma: {xyz: 0.01}}",
        "{type: targets, points: {A: [30, 0, 10]}, sigma: {xyz: 0.01}, tolerance: {points: 0}}",
    ),
}
JOINTS = (
    ARM.replace("range", "alpha: 0, beta: 0, d: 0, theta: 0, r: 0, range"),
    "[0, 0, 0], rpy: [0, 0, 0], tolerance: {xyz: [0, 0, 0], rpy: [0, 0, 0]}",
)


def same(one: Machine, other: Machine) -> None:
    assert one.parameters == other.parameters
    assert one.mechanism == other.mechanism
    assert one.sensors == other.sensors
    assert one.frames == other.frames


@pytest.mark.parametrize("name", MECHANISMS)
def test_what_a_leg_leaves_out_is_no_offset_a_gain_of_one_and_a_rail_upwards(
    tmp_path: Path, name: str
) -> None:
    short, long = (written(tmp_path, text, "m") for text in MECHANISMS[name])
    same(short, long)


@pytest.mark.parametrize("name", SENSORS)
def test_what_a_sensor_leaves_out_is_at_the_origin_and_exactly_known(tmp_path: Path, name: str) -> None:
    short, long = (written(tmp_path, f"{ARM}sensor: {text}\n", "m") for text in SENSORS[name])
    same(short, long)


def test_what_joints_and_frames_leave_out_is_zero_and_exactly_known(tmp_path: Path) -> None:
    joint, frame = JOINTS
    long = f"{joint}frames: {{base: {{in: world, xyz: {frame}}}, tool: {{in: flange, xyz: {frame}}}}}\n"
    brief = written(tmp_path, ARM + "frames: {base: {}, tool: {}}\n" + POSE)
    same(brief, written(tmp_path, long + POSE))
    bare = written(tmp_path, ARM + POSE)
    assert [(p.name, p.nominal, p.tolerance) for p in bare.frames] == [
        (p.name, p.nominal, p.tolerance) for p in brief.frames
    ]
