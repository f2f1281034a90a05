"""A base that nobody knows, found by directions alone: stars through a mount, a theodolite at an arm.

Readings are plain numpy.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from support.machine_texts import machine_from
from truepose.arrays import Array
from truepose.identification.fit.align import base_of, station_of
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.load import load_checked
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.sensors.direction import Direction

MOUNT = """schema: truepose/machine/1
name: mount
mechanism: {type: mount, kind: KIND, latitude: 39}
frames:
  base: {in: world, tolerance: {xyz: 0, rpy: .inf}}
  tool: {in: flange, tolerance: {xyz: 0, rpy: [0, 0, 0.5]}}
sensor: {type: direction, sigma: {angle: 5 arcsec}}
tolerances: {angle: 0.2, SECOND.offset: .inf}
"""
ARM = """schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300}
    - {name: q2, kind: revolute, alpha: -90, d: 50}
    - {name: q3, kind: revolute, d: 400}
frames:
  base: {in: world, tolerance: {xyz: .inf, rpy: .inf}}
  tool: {in: flange, xyz: [320, 30, 60], tolerance: {xyz: 1}}
sensor: {type: direction, of: origin, sigma: {angle: 1 arcsec}}
tolerances: {angle: 0.05, length: 0.2}
"""
AXES = {"equatorial": ("ha", "dec"), "alt-az": ("az", "alt")}


def _has_roll_and_yaw(turn: tuple[float, ...]) -> bool:
    """At a pitch of 90 deg roll and yaw are one: frames are told by these, and a fit does not always end there."""
    if np.linalg.norm(turn) < 0.1:
        return False
    return bool(abs(Rotation.from_quat(turn).as_matrix()[2, 0]) < np.cos(np.radians(0.3)))


TURNS = st.tuples(*[st.floats(-1, 1)] * 4).filter(_has_roll_and_yaw)
SEEDS = st.integers(0, 10**6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("directions")


def _machine(folder: Path, text: str) -> Machine:
    return machine_from(folder, text, "m")


def _let_through(folder: Path, machine: Machine, columns: dict[str, Array]) -> Recording:
    """Return the recording, which nothing may be found wrong with that looks at files before a fit."""
    pd.DataFrame(columns).to_csv(folder / "m.csv", index=False)
    assert load_checked(folder / "m.yaml", [folder / "m.csv"])[0].verdict == "ok"
    return load_recording(machine, columns)


def _angles(v: Array) -> dict[str, Array]:
    return {
        "azimuth": np.degrees(np.arctan2(-v[:, 1], v[:, 0])),
        "elevation": np.degrees(np.arcsin(v[:, 2] / np.linalg.norm(v, axis=1))),
    }


def _noisy(v: Array, arcsec: float, rng: np.random.Generator) -> Array:
    v = v / np.linalg.norm(v, axis=1, keepdims=True)
    return np.asarray(v + np.radians(arcsec / 3600) * rng.standard_normal(v.shape))


def _found(fit: Estimate, first: str) -> Array:
    return np.array([fit.p[fit.prior.names.index(f"{first}{axis}")] for axis in ("rx", "ry", "rz")])


@settings(deadline=None, max_examples=20, derandomize=True)
@given(kind=st.sampled_from(list(AXES)), turn=TURNS, zero=st.floats(-180, 180), seed=SEEDS)
def test_stars_find_a_mount_that_is_turned_anyhow(
    folder: Path, kind: str, turn: tuple[float, ...], zero: float, seed: int
) -> None:
    first, second = AXES[kind]
    rng, base = np.random.default_rng(seed), Rotation.from_quat(turn)
    q = np.column_stack([rng.uniform(-150, 150, 15), rng.uniform(-40, 75, 15)])
    a, e = np.radians(q).T
    star = np.column_stack([np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])
    read = _angles(_noisy(base.apply(star), 5, rng))
    machine = _machine(folder, MOUNT.replace("KIND", kind).replace("SECOND", second))
    recording = _let_through(folder, machine, {first: q[:, 0], second: q[:, 1] - zero, **read})
    fit = calibrate(machine, recording).fit
    # 30 readings less at most 7 constants: chi2 of 23 beyond 60 has a chance of 4e-5
    assert fit.chi2_per_dof < 60 / 23
    # the first axis' zero and the base's turn about it are one, within the zero's tolerance of 0.2 deg
    off = Rotation.from_matrix(lie.rpy_matrix(_found(fit, "base."))).inv() * base
    assert np.degrees(off.magnitude()) < 1.0


@settings(deadline=None, max_examples=12, derandomize=True)
@given(
    turn=TURNS, way=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.3), seed=SEEDS
)
def test_a_theodolite_finds_an_arm_that_stands_anywhere(
    folder: Path, turn: tuple[float, ...], way: tuple[float, ...], seed: int
) -> None:
    rng, base = np.random.default_rng(seed), Rotation.from_quat(turn)
    place = 2500 * np.array(way) / np.linalg.norm(way)
    q = rng.uniform(-100, 100, (50, 3))
    read = _angles(_noisy(base.apply(_origin(np.radians(q))) + place, 1, rng))
    machine = _machine(folder, ARM)
    recording = _let_through(folder, machine, {f"q{k + 1}": q[:, k] for k in range(3)} | read)
    fit = calibrate(machine, recording).fit
    # 100 readings less about 15: chi2 of 85 beyond 150 has a chance of 2e-5
    assert fit.chi2_per_dof < 150 / 85
    off = Rotation.from_matrix(lie.rpy_matrix(_found(fit, "base."))).inv() * base
    assert np.degrees(off.magnitude()) < 0.5
    at = np.array([fit.p[fit.prior.names.index(f"base.{axis}")] for axis in "xyz"])
    # one theodolite has its length from the arm: 0.2 mm in 400 is 1.5 mm in 2500, and there are several lengths
    assert np.linalg.norm(at - place) < 10


def _origin(q: Array) -> Array:
    """(n, 3) origin of the tool in the base frame, mm."""

    def about_z(angle: Array) -> Array:
        return np.asarray(Rotation.from_rotvec(np.outer(angle, [0, 0, 1])).as_matrix())

    turn = about_z(q[:, 0])
    at = np.array([0, 0, 300.0])
    turn = turn @ Rotation.from_euler("x", -90, degrees=True).as_matrix()
    at = at + turn @ [50.0, 0, 0]
    turn = turn @ about_z(q[:, 1])
    at = at + turn @ [400.0, 0, 0]
    return np.asarray(at + turn @ about_z(q[:, 2]) @ [320.0, 30.0, 60.0])


@pytest.mark.parametrize(("of", "fewest"), [("origin", 3), ("x", 2), ("z", 2)])
def test_bearings_tell_a_base_from_three_poses_and_axes_from_two(of: str, fewest: int) -> None:
    """Two axes tell a turn; a place as well takes three lines of sight."""
    sensor = Direction(of, True, ("ux", "uy", "uz"), 1.0, 1e-5)
    tool, base = np.tile(np.eye(4), (4, 1, 1)), np.eye(4)
    tool[:, :3, :3] = Rotation.random(4, random_state=1).as_matrix()
    tool[:, :3, 3] = np.random.default_rng(1).uniform(-300, 300, (4, 3))
    base[:3, :3] = Rotation.from_euler("xyz", [20, -30, 100], degrees=True).as_matrix()
    base[:3, 3] = (900.0, 100.0, 200.0) if of == "origin" else (0.0, 0.0, 0.0)
    stands = base @ tool
    sight = stands[:, :3, 3] if of == "origin" else stands[:, :3, "xyz".index(of)]
    read = sight / np.linalg.norm(sight, axis=1, keepdims=True)
    read[fewest - 1 :] = np.nan  # one that was lost counts as one that is not there
    assert base_of(sensor, tool, read, station_of(())) is None
    read[fewest - 1] = sight[fewest - 1] / np.linalg.norm(sight[fewest - 1])
    found = base_of(sensor, tool, read, station_of(()))
    assert found is not None and found[1] < 1e-6
    if of != "origin":  # three bearings leave more than one place
        np.testing.assert_allclose(found[0], base, atol=1e-9)
