"""A column is one thing: joints, what sensors read, and names that have a meaning of their own never share one."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from recording_columns import LOGGED, ORDER
from support.command import input_error
from support.machine_texts import machine_from
from truepose.identification.compensation.path_table import path_rows
from truepose.identification.prediction.predict import predict
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.leaves.starting.written import PRESETS
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS
from truepose.models.machine.sensor import sensors

AXES = np.eye(3).astype(int).tolist()
OPENED = [name for name in PRESETS if sensors.get(name, "here").opens_columns]


def gantry(folder: Path, joints: tuple[str, ...], sensor: dict[str, object], **others: object) -> Machine:
    """A gantry whose joints are called as told."""
    bodies = ["floor", "bridge", "carriage", "ram"]
    rows = [
        {"name": name, "kind": "prismatic", "parent": below, "child": above, "axis": axis, "actuated": True}
        for name, (below, above), axis in zip(joints, pairwise(bodies), AXES, strict=True)
    ]
    document = {
        "schema": "truepose/machine/1",
        "name": "gantry",
        "mechanism": {"type": "graph", "bodies": bodies, "joints": rows},
        "gravity": [0, 0, -9.81],
        "sensor": sensor,
        "tolerances": {"length": 0.1, "angle": 0.05},
        **others,
    }
    return machine_from(folder, yaml.safe_dump(document), "gantry")


def section(kind: str, **others: object) -> dict[str, object]:
    return {**PRESETS[kind].section, **others}


@pytest.mark.parametrize("column", [column.name for column in (*ORDER, *LOGGED)])
def test_a_joint_may_not_be_called_as_a_column_that_means_something_else(tmp_path: Path, column: str) -> None:
    name = re.sub("<.*>", "Y", column)
    with input_error(rf"gantry\.yaml: mechanism: found a joint called {name!r}"):
        gantry(tmp_path, ("X", "Y", name), section("position"))


@pytest.mark.parametrize("kind", [kind for kind, preset in PRESETS.items() if preset.columns])
def test_a_joint_may_not_be_called_as_what_a_sensor_reads(tmp_path: Path, kind: str) -> None:
    for column in PRESETS[kind].columns.keys() - {"pose", "from"}:
        with input_error(rf"gantry\.yaml: sensor: found the column {column!r}, which is a"):
            gantry(tmp_path, ("A", "B", column), section(kind))


@pytest.mark.parametrize("kind", OPENED)
def test_with_a_named_sensor_joints_are_called_as_one_likes(tmp_path: Path, kind: str) -> None:
    """The machine is the same as with other names: what it reads, and what is said of it."""
    joints = (*list(PRESETS[kind].columns)[:3], "Y", "Z")[:3]
    named = gantry(tmp_path, joints, section(kind, name="sensor"))
    plain = gantry(tmp_path, ("X", "Y", "Z"), section(kind))
    q = np.random.default_rng(0).uniform(20, 300, (5, 3))
    read = [
        predict(machine, load_recording(machine, dict(zip(names, q.T, strict=True)), need_observations=False))
        for machine, names in ((named, joints), (plain, ("X", "Y", "Z")))
    ]
    assert list(read[0].columns) == [
        name if name.startswith("pose.") else f"sensor.{name}" for name in read[1].columns
    ]
    np.testing.assert_array_equal(read[0].to_numpy(), read[1].to_numpy())


@pytest.mark.parametrize("opening", ["temperature", "approach", "pose", "recording"])
def test_a_sensor_may_not_open_columns_that_mean_something_else(tmp_path: Path, opening: str) -> None:
    with input_error(rf"found the column '{opening}\.x', which has a meaning of its own"):
        gantry(tmp_path, ("A", "B", "C"), section("position", name=opening))


def test_a_driver_is_no_column_of_the_sensor(tmp_path: Path) -> None:
    with input_error(r"drivers: found 'x', which the sensor reads"):
        gantry(tmp_path, ("A", "B", "C"), section("position"), drivers=[{"name": "x", "unit": "mm"}])


def test_a_path_holds_joints_or_poses_and_says_which(tmp_path: Path) -> None:
    """Where joints are called x, y and z, columns of poses begin with `pose.`."""
    named = gantry(tmp_path, ("x", "y", "z"), section("position", name="sensor"), task=["x", "y", "z"])
    path, poses = tmp_path / "path.csv", np.arange(18.0).reshape(3, 6) / 10.0
    np.savetxt(path, poses, delimiter=",", header="x,y,z,rx,ry,rz", comments="")
    with input_error(r"poses or the joints x, y, z, expected the joints alone, or poses in pose.x"):
        path_rows(named, read_table(path))
    np.savetxt(path, poses, delimiter=",", header=",".join(f"pose.{a}" for a in AXIS_UNITS), comments="")
    np.testing.assert_allclose(path_rows(named, read_table(path))[1].q, poses[:, :3], atol=1e-6)
    np.savetxt(path, poses[:, :3], delimiter=",", header="x,y,z", comments="")
    np.testing.assert_allclose(path_rows(named, read_table(path))[1].q, poses[:, :3], atol=1e-12)
