"""What a report's drawing holds, number by number: where it stands, how large it is, what a click on a pose tells."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.effect_machines import read_machines
from support.exact_fits import fit_at, posed, read
from support.reports import arm, fitted, recorded
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.scene.scene import STEPS, error_words, scene_of, upright
from truepose.identification.report.scene.sights import sights
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.mktemp("scene") / "machines")


def missing(machine: Machine) -> tuple[Estimate, Recording]:
    """A fit that is some tolerances beside what was measured."""
    recording = read(machine, posed(machine, 6), [])
    sigma = np.array([p.tolerance if np.isfinite(p.tolerance) else 0.0 for p in machine.parameters])
    away = 0.2 * sigma * np.random.default_rng(9).normal(size=len(sigma))
    return fit_at(machine, recording, [], away), recording


def data_of(fit: Estimate, recording: Recording, after: Estimate | None = None) -> dict[str, Any]:
    scene = scene_of(fit, after, recording, [])
    assert scene is not None
    return scene.data


def poses_of(data: dict[str, Any]) -> Array:
    """(n, k, 3) points of the skeleton, in steps."""
    return np.array(data["poses"], dtype=float).reshape(len(data["poses"]), -1, 3)


@pytest.mark.parametrize("name", ["arm", "stage", "gough", "camera"])
def test_the_drawing_is_in_the_middle_and_reaches_from_corner_to_corner(
    machines: Mapping[str, Machine], name: str
) -> None:
    """Axes apart, whose length says nothing: each is a thirtieth of the drawing."""
    data = data_of(*missing(machines[name]))
    poses, points = poses_of(data), np.array(data["points"], dtype=float).reshape(-1, 3)
    axes = [piece["p"] for piece in data["pieces"] if piece["k"] == "axis"]
    ends = {end for _, end in axes}
    solid = [k for piece in data["pieces"] for k in piece["p"] if k not in ends]
    every = np.concatenate([poses[:, solid].reshape(-1, 3), points])
    low, high = every.min(axis=0), every.max(axis=0)
    np.testing.assert_allclose(low + high, 0.0, atol=2.0)
    assert np.linalg.norm(high - low) == pytest.approx(2 * STEPS, abs=4.0)
    for start, end in axes:
        np.testing.assert_allclose(
            np.linalg.norm(poses[:, end] - poses[:, start], axis=1), STEPS / 15, atol=2.0
        )
    assert axes or name in ("stage", "gough")
    assert all(piece["c"] is (piece["k"] == "plate") for piece in data["pieces"])


def test_the_drawing_does_not_hang_on_where_the_sensor_stands(machines: Mapping[str, Machine]) -> None:
    """Its points are those of the machine's own frame: a base that is moved and turned by what was fitted changes little."""
    fit, recording = missing(machines["arm"])
    first = data_of(fit, recording)
    assert first["size"] > 100.0  # mm: half of an arm's reach and more
    span = np.linalg.norm(np.ptp(np.array(first["points"]).reshape(-1, 3), axis=0)) * first["size"] / STEPS
    seen = sights(fit, recording).points.reshape(-1, 3)
    turn = upright(fit.nominal)
    assert span == pytest.approx(np.linalg.norm(np.ptp(seen @ turn.T, axis=0)), rel=2e-3)


def test_a_pose_that_is_clicked_tells_its_row_its_joints_and_its_errors(tmp_path: Any) -> None:
    """Angles in degrees, to five digits; the file without its folder."""
    machine = arm(tmp_path)
    recording = replace(recorded(machine), files=("/far/off/a&b.csv",))
    before, after = fitted(machine, recording), fitted(machine, recording, away=2.0)
    after = replace(after, residual=0.5 * after.residual)
    data = data_of(before, recording, after)
    assert data["joints"] == ["q1 °", "q2 °"]
    np.testing.assert_allclose(data["q"], np.degrees(recording.q), rtol=6e-5)
    assert all(len(f"{abs(v):g}".replace(".", "").lstrip("0")) <= 5 for row in data["q"] for v in row)
    assert data["where"] == [f"a&b.csv, row {k}" for k in recording.source_row]
    for row, (was, now) in enumerate(data["errors"]):
        assert was == error_words(machine, before, row) and now == error_words(machine, after, row)
        size = 10.0 * float(np.linalg.norm(before.residual[row]))  # µm: a sigma is 0.01 mm
        assert float(was.split()[1]) == pytest.approx(size, rel=6e-3)
    alone = data_of(before, recording)
    assert [one for (one,) in alone["errors"]] == [was for was, _ in data["errors"]]


def test_errors_are_told_by_kind_of_reading(machines: Mapping[str, Machine]) -> None:
    """Of a pose the distance and the angle, each as the length of its three components."""
    machine = machines["stage"]
    fit, _ = missing(machine)
    row = np.array([3.0, 0.0, 4.0, 0.0, 6.0, 8.0])  # sigmas of 0.001 mm and 0.001 deg
    told = error_words(machine, replace(fit, residual=np.tile(row, (6, 1))), 2)
    assert told == "position 5.00 µm, rotation 175 µrad"
    lost = np.zeros((6, 6), dtype=bool)
    lost[2, 3:] = True
    gone = replace(fit, residual=np.tile(row, (6, 1)), lost=lost)
    assert error_words(machine, gone, 2) == "position 5.00 µm, rotation not read"
    assert error_words(machine, gone, 1) == told


def test_the_base_is_up_where_no_gravity_is_known(machines: Mapping[str, Machine]) -> None:
    fit, recording = missing(machines["arm"])
    for gravity, up in ((None, "base"), ((0.0, 0.0, 0.0), "base"), ((0.0, 0.0, -9.81), "gravity")):
        own = replace(fit.nominal, gravity=gravity)
        np.testing.assert_array_equal(upright(own), np.eye(3))
        assert data_of(replace(fit, nominal=own), recording)["up"] == up
    np.testing.assert_array_equal(
        upright(replace(fit.nominal, gravity=(0.0, 0.0, 9.81))), np.diag([1.0, -1.0, -1.0])
    )


def test_beside_a_sensor_of_points_one_of_joints_is_not_drawn(machines: Mapping[str, Machine]) -> None:
    """Whichever stands first in the machine file; the arrows are those of the sensor of points alone."""
    two = next(m for m in machines.values() if len(m.sensors) == 2)
    fit, recording = missing(two)
    seen = sights(fit, recording)
    assert seen.points.shape[1] == 1
    point, other = two.sensors
    width = len(point.channels)
    swapped = replace(two, sensors=(other, point))
    order = [*range(width, fit.residual.shape[1]), *range(width)]
    turned = replace(fit, nominal=swapped, residual=fit.residual[:, order])
    again = sights(turned, recording)
    np.testing.assert_allclose(again.points, seen.points)
    np.testing.assert_allclose(again.arrows, seen.arrows)
    quiet = fit.residual.copy()
    quiet[:, width:] = 0.0
    np.testing.assert_allclose(sights(replace(fit, residual=quiet), recording).arrows, seen.arrows)
