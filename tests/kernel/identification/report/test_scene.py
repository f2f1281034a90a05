"""Laws of the drawing on a report's first page: points are readings, arrows end there, guilty places are parts."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import truepose.models
from support.effect_machines import read_machines
from support.exact_fits import fit_at, posed, read
from support.examples import examples
from support.moving_machines import record, written
from support.reports import arm, fitted, recorded
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.report.scene import (
    STEPS,
    base_pose,
    error_words,
    pieces_of,
    scene_of,
    sights,
    thinned,
    upright,
)
from truepose.models.effects.base import effects
from truepose.models.effects.common import sensor_names
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of
from truepose.models.machine.skeleton import skeleton
from truepose.shown.document import Guilty

Array = NDArray[np.float64]
BUNDLED = ("telescope", "nanopositioner", "polisher")
BALLBAR = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}
frames:
  base: {in: world, xyz: [150, -100, 900], rpy: [5, -3, 40], tolerance: {xyz: 1, rpy: 1}}
  tool: {in: flange, xyz: [400, 50, 30], tolerance: {xyz: 0.1}}
sensor: {type: ballbar, centre: [100, 50, -900], sigma: {distance: 0.001}}
"""


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    base = tmp_path_factory.mktemp("bar")
    return dict(read_machines(tmp_path_factory.getbasetemp() / "scene")) | {
        "ballbar": written(base, BALLBAR, "ballbar")
    }


def missing(machine: Machine, size: float = 0.2) -> tuple[Estimate, Recording]:
    """A fit that is some tolerances beside what was measured."""
    q = (
        record(machine, np.random.default_rng(6).uniform(-1.0, 1.0, (12, 2)))
        if machine.name == "ballbar"
        else posed(machine, 12)
    )
    recording = read(machine, q, [])
    sigma = np.array([p.tolerance if np.isfinite(p.tolerance) else 0.0 for p in machine.parameters])
    away = size * sigma * np.random.default_rng(9).normal(size=len(sigma))
    return fit_at(machine, recording, [], away), recording


def predicted(fit: Estimate, recording: Recording) -> dict[str, Array]:
    names, values, _, _ = Predictor(fit.nominal, recording, fit.effects).columns(fit.p, fit.x)
    return dict(zip(names, values.T, strict=True))


def from_sensor(fit: Estimate, points: Array) -> Array:
    """(n, 3) in the base's frame, by the inverse of a 4 x 4 matrix."""
    whole = np.column_stack([points, np.ones(len(points))])
    return np.asarray((np.linalg.inv(base_pose(fit)) @ whole.T).T[:, :3])


POINTS = {
    "camera": [["A1.x", "A1.y", "A1.z"], ["A2.x", "A2.y", "A2.z"], ["A3.x", "A3.y", "A3.z"]],
    "stage": [["x", "y", "z"]],
    "arm": [["x", "y", "z"]],
    "gough": [["x", "y", "z"]],
}


@pytest.mark.parametrize("name", POINTS)
def test_points_are_the_readings_and_arrows_lead_to_them(machines: Mapping[str, Machine], name: str) -> None:
    """From where the model has a point to where it was read, all in the base's frame."""
    fit, recording = missing(machines[name])
    seen, model = sights(fit, recording), predicted(fit, recording)
    assert seen.points.shape == seen.arrows.shape == (len(recording), len(POINTS[name]), 3)
    for k, axes in enumerate(POINTS[name]):
        there = from_sensor(fit, np.column_stack([recording.observations[a] for a in axes]))
        start = from_sensor(fit, np.column_stack([model[a] for a in axes]))
        np.testing.assert_allclose(seen.points[:, k], there, atol=1e-8)
        np.testing.assert_allclose(seen.points[:, k] - seen.arrows[:, k], start, atol=1e-8)
        assert np.linalg.norm(seen.arrows[:, k], axis=1).max() > 1e-3


def test_lengths_alone_have_no_points(machines: Mapping[str, Machine]) -> None:
    fit, recording = missing(machines["ballbar"])
    assert sights(fit, recording).points.shape == (len(recording), 0, 3)
    scene = scene_of(fit, None, recording, [])
    assert scene is not None and scene.data["points"] == [] and "measured" not in scene.told


@pytest.mark.parametrize(("name", "column"), [("camera", "A2.y"), ("stage", "z")])
def test_what_was_not_read_has_no_arrow(machines: Mapping[str, Machine], name: str, column: str) -> None:
    fit, recording = missing(machines[name])
    seen = {k: v.copy() for k, v in recording.observations.items()}
    seen[column][4] = np.nan
    part = replace(recording, observations=seen)
    away = fit.p - np.array([p.nominal for p in fit.nominal.parameters])
    arrows = sights(fit_at(fit.nominal, part, [], away), part).arrows
    gone = np.asarray(np.isnan(arrows).all(axis=2))
    assert gone.sum() == 1 and gone[4].any()
    assert not np.isnan(arrows[~gone]).any()


def places(machine: Machine) -> list[tuple[str, tuple[str, ...]]]:
    return [(slug, tuple(place)) for slug in effects for place in effects.get(slug, "test")().places(machine)]


@pytest.mark.parametrize("name", BUNDLED)
def test_every_place_of_the_catalogue_is_a_part_or_of_a_sensor(name: str) -> None:
    machine = load_machine(Path(truepose.models.__path__[0]) / "machines" / name / "machine.yaml")
    pieces = skeleton(machine).pieces
    own = {*sensor_names(machine), *(element_of(p.name) for s in machine.sensors for p in s.parameters)}
    own -= {"tool", "base"}
    assert len(places(machine)) > 50
    for slug, place in places(machine):
        at = pieces_of(place, pieces, machine)
        if not place:
            assert at == []  # the whole recording
        elif own.issuperset(element_of(name) for name in place):
            assert at == [], (slug, place)
        else:
            assert at, (slug, place)
            for one in place:  # each of them, not the first alone
                assert element_of(one) in own or pieces_of((one,), pieces, machine), (slug, place)
        assert len(set(at)) == len(at) and all(0 <= k < len(pieces) for k in at)


def test_a_place_is_drawn_where_it_is(machines: Mapping[str, Machine]) -> None:
    machine = machines["gough"]
    pieces = skeleton(machine).pieces
    for name in ("leg3", "m3", "leg3.a.x", "leg3.length"):
        (at,) = pieces_of((name,), pieces, machine)
        assert pieces[at].kind == "leg" and "leg3" in pieces[at].names
    assert {pieces[k].kind for k in pieces_of(("base",), pieces, machine)} == {"plate"}
    assert pieces_of(("nobody",), pieces, machine) == []


def plain(value: Any) -> bool:
    """Whether JSON holds it as it is."""
    if isinstance(value, dict):
        return all(type(k) is str and plain(v) for k, v in value.items())
    if isinstance(value, list):
        return all(map(plain, value))
    return type(value) in (str, int, float, bool, type(None))


@pytest.mark.parametrize("name", ["arm", "stage", "gough", "camera", "ballbar", "graph"])
@pytest.mark.parametrize("two", [True, False])
def test_data_is_plain_and_without_a_number_that_is_none(
    machines: Mapping[str, Machine], name: str, two: bool
) -> None:
    fit, recording = missing(machines[name])
    gone = {k: v.copy() for k, v in recording.observations.items()}
    next(iter(gone.values()))[2] = np.nan
    part = replace(recording, observations=gone)
    residual = fit.residual.copy()
    residual[5] = np.nan  # a row that could not be assembled
    broken = replace(fit, residual=residual)
    scene = scene_of(broken, broken if two else None, part, [Guilty("x", "y", "93 %", ("base",))])
    assert scene is not None
    assert plain(scene.data)
    assert json.loads(json.dumps(scene.data, allow_nan=False)) == scene.data
    data, size = scene.data, len(skeleton(fit.nominal).around(np.zeros((999, 3))).pieces)
    assert len(data["pieces"]) == size and len(data["guilty"]) == 1
    assert 5 not in data["poseRows"] and 5 not in data["pointRows"]
    assert len(data["poses"]) == len(data["poseRows"]) == len(data["q"]) == len(data["errors"])
    assert len(data["arrows"]) == (name != "ballbar") * (1 + two) and all(
        len(a) == len(data["points"]) for a in data["arrows"]
    )
    assert len(data["points"]) == 3 * len(data["pointRows"])
    assert max(map(abs, data["points"]), default=0) <= STEPS
    assert all(len(errors) == 1 + two for errors in data["errors"])


@pytest.mark.parametrize("name", ["camera", "arm"])
def test_whole_numbers_keep_distances_and_what_is_up(machines: Mapping[str, Machine], name: str) -> None:
    fit, recording = missing(machines[name])
    scene = scene_of(fit, None, recording, [])
    assert scene is not None
    seen = sights(fit, recording)
    drawn = np.array(scene.data["points"]).reshape(-1, 3) * scene.data["size"] / scene.data["steps"]
    flat = seen.points.reshape(-1, 3)
    far = np.linalg.norm(drawn[:, None] - drawn[None], axis=2)
    np.testing.assert_allclose(
        far, np.linalg.norm(flat[:, None] - flat[None], axis=2), atol=2 * scene.data["size"] / STEPS
    )
    np.testing.assert_allclose(np.diff(drawn[:, 2]), np.diff(flat[:, 2]), atol=2 * scene.data["size"] / STEPS)
    assert scene.data["up"] == ("gravity" if fit.nominal.gravity else "base")
    arrows = np.array(scene.data["arrows"][0]).reshape(-1, 3) * 1e-6
    np.testing.assert_allclose(
        np.linalg.norm(arrows, axis=1), np.linalg.norm(seen.arrows.reshape(-1, 3), axis=1), atol=2e-6
    )


@given(gravity=st.tuples(*[st.floats(-9.81, 9.81)] * 3).filter(lambda g: np.linalg.norm(g) > 1.0))
@settings(max_examples=examples(25), deadline=None)
def test_up_is_against_gravity(machines: Mapping[str, Machine], gravity: tuple[float, float, float]) -> None:
    """Whatever way a machine hangs, a point that lies higher is drawn higher; nothing is mirrored."""
    turn = upright(replace(machines["arm"], gravity=gravity))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(
        turn @ np.array(gravity), np.array([0.0, 0.0, -float(np.linalg.norm(gravity))]), atol=1e-3
    )


def test_nothing_fitted_nothing_drawn(machines: Mapping[str, Machine]) -> None:
    fit, recording = missing(machines["arm"])
    hollow = replace(fit, residual=np.full_like(fit.residual, np.nan))
    assert scene_of(hollow, None, recording, []) is None
    assert scene_of(hollow, fit, recording, []) is None


@given(st.sets(st.integers(0, 10_000), min_size=1, max_size=300), st.integers(1, 40))
@settings(max_examples=examples(60), deadline=None)
def test_thinning_keeps_ends_and_spreads_evenly(rows: set[int], most: int) -> None:
    every = np.array(sorted(rows), dtype=np.intp)
    some = thinned(every, most)
    assert len(some) == min(len(every), most)
    assert set(some.tolist()) <= rows and (np.diff(some) > 0).all()
    assert some[0] == every[0] and (most == 1 or some[-1] == every[-1])
    gaps = np.diff(np.searchsorted(every, some))
    assert not len(gaps) or gaps.max() - gaps.min() <= 1


def test_a_rows_error_is_that_of_the_points_that_were_read(machines: Mapping[str, Machine]) -> None:
    """Root of the mean square over targets of the distance."""
    fit, recording = missing(machines["camera"])
    gone = {k: v.copy() for k, v in recording.observations.items()}
    for axis in "xyz":
        gone[f"A2.{axis}"][4] = np.nan
        for target in ("A1", "A2", "A3"):
            gone[f"{target}.{axis}"][5] = np.nan
    part = replace(recording, observations=gone)
    away = fit.p - np.array([p.nominal for p in fit.nominal.parameters])
    fit = fit_at(fit.nominal, part, [], away)
    arrows = sights(fit, part).arrows
    for row in (3, 4):
        size = float(np.sqrt(np.nanmean(np.sum(arrows[row] ** 2, axis=1))))
        kind, value, unit = error_words(fit.nominal, fit, row).split()
        assert kind == "position"
        assert float(value) * {"mm": 1.0, "µm": 1e-3}[unit] == pytest.approx(size, rel=6e-3)
    assert error_words(fit.nominal, fit, 5) == "position not read"


def test_of_a_long_recording_a_hundred_and_fifty_poses_and_fifteen_hundred_points_are_drawn(
    tmp_path: Path,
) -> None:
    """Those of the first row and of the last among them; the pose that is shown first is the one that fits worst."""
    machine = arm(tmp_path)
    for rows, poses, points in ((150, 150, 150), (151, 150, 151), (1600, 150, 1500)):
        recording = recorded(machine, rows)
        fit = fitted(machine, recording)
        residual = fit.residual.copy()
        residual[rows // 2] *= 30.0
        residual[rows - 1] *= 300.0  # a row for validation
        scene = scene_of(replace(fit, residual=residual), None, recording, [])
        assert scene is not None
        data = scene.data
        assert len(data["poseRows"]) == poses and len(data["pointRows"]) == points
        for key in ("poseRows", "pointRows"):
            assert data[key][0] == 0 and data[key][-1] == rows - 1
        some = f"150 of its {rows:,} recorded poses" if rows > 150 else "its 150 recorded poses"
        assert f"arm at {some}, drawn by its own kinematics" in scene.told
        worst = data["poseRows"][data["first"]]
        assert fit.used[worst] and (worst == rows // 2 or rows > 150)
