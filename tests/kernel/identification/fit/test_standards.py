"""ISO 9283 and ISO 230-2 from made-up repeats: the standards' formulas, written out here once more, give the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import mean, stdev

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.exact_fits import fit_at, read
from support.examples import examples
from support.moving_machines import record, written
from truepose.arrays import Array
from truepose.identification.fit.repeatability import AxisTest, PoseTest, axis_tests, pose_test
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
SLIDES = """
mechanism:
  type: serial
  joints:
    - {name: s1, kind: prismatic, range: [-150, 150]}
    - {name: s2, kind: prismatic, alpha: -60, theta: 40, d: 30, range: [-200, 400]}
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


def test_two_sensors_of_one_point_are_two(tmp_path: Path) -> None:
    """Of a machine with two trackers the first one's readings are tested."""
    machine = written(tmp_path, ARM + POSITION)
    pose = written(tmp_path, ARM + POSE, "pose")
    machine = replace(machine, sensors=(*machine.sensors, *pose.sensors))
    rng = np.random.default_rng(3)
    recording = visited(machine, [4], rng)
    off = rng.normal(size=(4, 3)) * 0.01
    found = pose_tested(machine, moved(recording, off))
    assert found is not None
    np.testing.assert_allclose([found.accuracy[0], found.repeatability[0]], iso_9283(off))


# -- ISO 230-2 -----------------------------------------------------------------------------------------


def travelled(machine: Machine, targets: Array, runs: int, axis: int = 1) -> Recording:
    """One slide to its targets and back, several times, the other still; exact readings."""
    way = np.tile(np.concatenate([targets, targets[::-1]]), runs)
    side = np.tile(np.repeat([1.0, -1.0], len(targets)), runs)
    q = np.full((len(way), 2), 12.5)
    q[:, axis] = way
    name = machine.mechanism.readings[axis]
    other = machine.mechanism.readings[1 - axis]
    drivers = {f"approach.{name}": side, f"approach.{other}": np.zeros(len(way))}
    return read(machine, record(machine, q, drivers=drivers), [])


def iso_230_2(deviations: dict[float, tuple[list[float], list[float]]]) -> AxisTest:
    """From deviations by target, arrivals from below and from above, after ISO 230-2:2014, clause 3."""
    up, down = ([(mean(pair[k]), stdev(pair[k])) for pair in deviations.values()] for k in (0, 1))
    every = [*up, *down]
    return AxisTest(
        "s2",
        accuracy=max(m + 2 * s for m, s in every) - min(m - 2 * s for m, s in every),
        systematic=max(m for m, _ in every) - min(m for m, _ in every),
        repeatability=max(4 * s for _, s in every),
        reversal=max(abs(a - b) for (a, _), (b, _) in zip(up, down, strict=True)),
        targets=len(deviations),
        runs=min(len(one) for pair in deviations.values() for one in pair),
    )


@pytest.fixture(scope="module", params=["position", "targets"])
def slides(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return written(tmp_path_factory.mktemp("slides"), SLIDES + SENSORS[request.param])


def along(machine: Machine, axis: int) -> Array:
    """Unit vector of a slide's travel in the sensor's frame."""
    q = np.array([[12.5, 12.5], [12.5, 12.5]])
    q[1, axis] += 1.0
    seen = read(machine, record(machine, q), []).observations
    names = [channel.name for channel in machine.channels[:3]]
    return np.array([seen[name][1] - seen[name][0] for name in names])


def same(found: AxisTest, expected: AxisTest) -> None:
    assert (found.joint, found.targets, found.runs) == (expected.joint, expected.targets, expected.runs)
    for name in ("accuracy", "systematic", "repeatability", "reversal"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-4), name


@given(seed=SEEDS, targets=st.integers(5, 9), runs=st.integers(2, 5))
@LAWS
def test_an_axis_is_tested_by_the_standards_formulas(
    slides: Machine, seed: int, targets: int, runs: int
) -> None:
    rng = np.random.default_rng(seed)
    places = np.sort(rng.uniform(-200, 400, targets).round(3))
    exact = travelled(slides, places, runs)
    size = 0.01 * rng.normal(size=len(exact)) + 0.02 * exact.driver("approach.s2")  # type: ignore[operator]
    across = np.cross(along(slides, 1), [0.3, 0.5, 0.8])  # what is across the axis is no positioning
    off = size[:, None] * along(slides, 1) + 0.01 * rng.normal(size=(len(size), 1)) * across
    point = [channel.name for channel in slides.channels[:3]]
    recording = moved(exact, off, point)
    (found,) = axis_tests(fit_at(slides, recording, []), recording)
    q, side = recording.q[:, 1], np.asarray(recording.driver("approach.s2"))
    table = {
        float(at): (size[(q == at) & (side == 1)].tolist(), size[(q == at) & (side == -1)].tolist())
        for at in np.unique(q)
    }
    same(found, iso_230_2(table))


def test_lost_readings_are_no_runs(tmp_path: Path) -> None:
    machine = written(tmp_path, SLIDES + POSITION)
    exact = travelled(machine, np.linspace(0, 300, 6), 3)
    size = 0.01 * np.random.default_rng(5).normal(size=len(exact))
    recording = moved(exact, size[:, None] * along(machine, 1))
    gone = {name: values.copy() for name, values in recording.observations.items()}
    gone["x"][4] = np.nan
    part = replace(recording, observations=gone)
    (found,) = axis_tests(fit_at(machine, part, []), part)
    q, side = recording.q[:, 1], np.asarray(recording.driver("approach.s2"))
    kept = np.arange(len(q)) != 4
    table = {
        float(at): (
            size[kept & (q == at) & (side == 1)].tolist(),
            size[kept & (q == at) & (side == -1)].tolist(),
        )
        for at in np.unique(q)
    }
    same(found, iso_230_2(table))


def test_a_length_is_tested_as_it_is_read(tmp_path: Path) -> None:
    machine = written(tmp_path, SLIDES + BALLBAR)
    exact = travelled(machine, np.linspace(0, 300, 6), 3)
    size = 0.01 * np.random.default_rng(5).normal(size=len(exact))
    (name,) = exact.observations
    recording = replace(exact, observations={name: exact.observations[name] + size})
    (found,) = axis_tests(fit_at(machine, recording, []), recording)
    q, side = recording.q[:, 1], np.asarray(recording.driver("approach.s2"))
    table = {
        float(at): (size[(q == at) & (side == 1)].tolist(), size[(q == at) & (side == -1)].tolist())
        for at in np.unique(q)
    }
    same(found, iso_230_2(table))


@pytest.mark.parametrize(
    ("targets", "runs", "told"), [(4, 5, False), (5, 1, False), (5, 2, True), (9, 3, True)]
)
def test_too_little_is_not_told(tmp_path: Path, targets: int, runs: int, told: bool) -> None:
    machine = written(tmp_path, SLIDES + POSITION)
    recording = travelled(machine, np.linspace(0, 300, targets), runs)
    fit = fit_at(machine, recording, [])
    assert len(axis_tests(fit, recording)) == told
    assert axis_tests(fit, replace(recording, drivers={})) == []  # no side of arrival
    rolling = replace(recording, q=recording.q + np.outer(np.arange(len(recording)), [1e-3, 0.0]))
    assert axis_tests(fit, rolling) == []  # another joint moves
    turning = written(tmp_path, ARM + POSITION, "turning")
    angles = travelled(turning, np.linspace(0, 1, 6), 3)
    assert axis_tests(fit_at(turning, angles, []), angles) == []  # no slide
