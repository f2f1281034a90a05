"""ISO 9283 from made-up repeats: the standard's formulas, written out here once more, give the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.exact_fits import fit_at, read
from support.examples import examples
from support.moving_machines import record, written
from truepose.arrays import Array
from truepose.identification.fit.repeatability import PoseTest, pose_test
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

LAWS = settings(max_examples=examples(8), deadline=None)
SEEDS = st.integers(0, 2**32 - 1)
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}
frames: {tool: {in: flange, xyz: [400, 50, 30], tolerance: {xyz: 0.1}}}
"""
POSITION = "sensor: {type: position, sigma: {xyz: 0.02}}\n"
POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}\n"
TARGETS = (
    "sensor: {type: targets, points: {A: [10, 0, 0], B: [0, 20, 5], C: [1, 2, 3]}, sigma: {xyz: 0.03}}\n"
)
BALLBAR = """
sensor: {type: ballbar, centre: [0, 0, -900], sigma: {distance: 0.001}}
"""
SENSORS = {"position": POSITION, "pose": POSE, "targets": TARGETS}


def moved(recording: Recording, off: Array, point: Sequence[str] = "xyz") -> Recording:
    """With readings of a point off by (n, 3) mm."""
    seen = {name: values.copy() for name, values in recording.observations.items()}
    for k, name in enumerate(point):
        seen[name] += off[:, k]
    return replace(recording, observations=seen)


# -- ISO 9283 ------------------------------------------------------------------------------------------


def visited(machine: Machine, visits: Sequence[int], rng: np.random.Generator) -> Recording:
    """Poses that were visited so many times each, in any order; exact readings."""
    pose = rng.permutation(np.repeat(np.arange(len(visits)), visits))
    q = rng.uniform(-1.0, 1.0, (len(visits), 2))[pose]
    return read(machine, record(machine, q, pose=pose + 1), [])


def iso_9283(off: Array) -> tuple[float, float]:
    """AP and RP of one pose from its deviations (n, 3), after ISO 9283:1998, 7.2.1 and 7.2.2."""
    n = len(off)
    barycentre = [sum(column) / n for column in off.T.tolist()]
    ap = sum(v * v for v in barycentre) ** 0.5
    lengths = [sum((a - b) ** 2 for a, b in zip(row, barycentre, strict=True)) ** 0.5 for row in off.tolist()]
    l_mean = sum(lengths) / n
    s_l = (sum((one - l_mean) ** 2 for one in lengths) / (n - 1)) ** 0.5
    return ap, l_mean + 3 * s_l


@pytest.fixture(scope="module", params=SENSORS)
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return written(tmp_path_factory.mktemp("arm"), ARM + SENSORS[request.param])


@given(seed=SEEDS, visits=st.lists(st.integers(1, 7), min_size=1, max_size=4))
@LAWS
def test_poses_are_tested_by_the_standards_formulas(arm: Machine, seed: int, visits: list[int]) -> None:
    rng = np.random.default_rng(seed)
    exact = visited(arm, visits, rng)
    off = rng.normal(size=(len(exact), 3)) * 0.04 + 0.1
    point = [channel.name for channel in arm.channels[:3]]
    recording = moved(exact, off, point)
    found = pose_test(fit_at(arm, recording, []), recording)
    assert recording.pose is not None
    told = [k for k, n in enumerate(visits, 1) if n >= 3]
    if not told:
        assert found is None
        return
    expected = sorted((*iso_9283(off[recording.pose == k]), visits[k - 1]) for k in told)
    assert found is not None
    rows = sorted(zip(found.accuracy, found.repeatability, found.visits, strict=True))
    np.testing.assert_allclose(np.array(rows), np.array(expected), rtol=1e-6)


def pose_tested(machine: Machine, recording: Recording) -> PoseTest | None:
    return pose_test(fit_at(machine, recording, []), recording)


def test_repeatability_is_that_of_the_readings_and_accuracy_that_of_the_model(tmp_path: Path) -> None:
    """The same shift in every reading changes AP alone; a scatter k times as large makes RP k times as large."""
    machine = written(tmp_path, ARM + POSITION)
    rng = np.random.default_rng(3)
    exact, scatter = visited(machine, [5, 6], rng), rng.normal(size=(11, 3)) * 0.01
    one, two = (pose_tested(machine, moved(exact, scatter + shift)) for shift in (0.0, 0.3))
    three = pose_tested(machine, moved(exact, 3.0 * scatter))
    assert one is not None and two is not None and three is not None
    np.testing.assert_allclose(two.repeatability, one.repeatability, rtol=1e-6)
    assert (two.accuracy > 0.4).all() and (one.accuracy < 0.02).all()
    np.testing.assert_allclose(three.repeatability, 3.0 * one.repeatability, rtol=1e-6)


def test_visits_whose_reading_was_lost_are_none(tmp_path: Path) -> None:
    machine = written(tmp_path, ARM + POSITION)
    rng = np.random.default_rng(3)
    off = rng.normal(size=(5, 3)) * 0.01
    recording = moved(visited(machine, [5], rng), off)
    gone = {name: values.copy() for name, values in recording.observations.items()}
    gone["y"][1] = np.nan
    found = pose_tested(machine, replace(recording, observations=gone))
    assert found is not None
    np.testing.assert_allclose(
        [found.accuracy[0], found.repeatability[0]], iso_9283(np.delete(off, 1, axis=0))
    )
    assert found.visits.tolist() == [4]


def test_no_poses_no_test(tmp_path: Path) -> None:
    """Without the column `pose`, or with a sensor of a length, nothing is told."""
    machine = written(tmp_path, ARM + POSITION)
    recording = visited(machine, [5, 5], np.random.default_rng(1))
    assert pose_tested(machine, replace(recording, pose=None)) is None
    bar = written(tmp_path, ARM + BALLBAR, "bar")
    assert pose_tested(bar, visited(bar, [5, 5], np.random.default_rng(1))) is None
