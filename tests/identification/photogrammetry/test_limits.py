"""Where a pose of points begins to be known and a point to be suspect: each limit on both sides."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from truepose.errors import InputError
from truepose.identification.leaves.photogrammetry.body_pose import LOOSE, SUSPICIOUS, BodyPose, body_pose
from truepose.identification.leaves.photogrammetry.pose_table import (
    COLUMNS,
    PAIRS,
    pose_table,
    read_body,
    read_points,
)
from truepose.models.units import UnitSystem

Array = NDArray[np.float64]
SIGMA = 0.01
BODY = np.array([[150.0, 0, 20], [-80, 130, 20], [-80, -130, 25], [10, 20, 80], [60, -40, -50]])
NAMES = ("P1", "P2", "P3", "P4", "P5")


@pytest.mark.parametrize(("std", "known"), [(0.97 * LOOSE, True), (1.03 * LOOSE, False)])
def test_a_turn_is_refused_where_its_sigma_is_three_tenths_of_a_radian(std: float, known: bool) -> None:
    """One point h off the line of two others tells the turn about it to sigma / (h sqrt(2/3)): all three are centred."""
    assert LOOSE == 0.3
    line = np.array([-3.0, 0.0, 1.0]) / np.sqrt(10.0)
    height = SIGMA / std / np.sqrt(2.0 / 3.0)
    points = np.array([100.0 * line, -100.0 * line, [0.0, height, 0.0]]) + np.array([40.0, 5.0, -7.0])
    turn = Rotation.from_rotvec([0.4, -1.0, 2.0]).as_matrix()
    if known:
        found = body_pose(points, points @ turn.T, SIGMA)
        spread = found.covariance[3:, 3:]
        assert np.sqrt(turn @ line @ spread @ turn @ line) == pytest.approx(std, rel=1e-6)
        return
    # the axis in the frame of the points before, its largest part counted positive
    with pytest.raises(InputError, match=r"rotation about \(0\.949, 0\.000, -0\.316\) \(frame of the points"):
        body_pose(points, points @ turn.T, SIGMA)


def spoilt(places: dict[int, float], count: int = 5) -> BodyPose:
    """Exact points but for some, which stand so many mm off along x."""
    after = BODY[:count] + np.array([10.0, 20.0, 30.0])
    for k, size in places.items():
        after[k, 0] += size
    return body_pose(BODY[:count], after, SIGMA)


@pytest.mark.parametrize("count", [4, 5])
def test_a_point_is_suspect_where_chance_makes_one_in_a_hundred_of_a_body_s_points(count: int) -> None:
    assert SUSPICIOUS == 0.01
    limit = chi2.isf(0.01 / count, 3)
    unit = SIGMA * np.sqrt(limit / spoilt({0: SIGMA}, count).drops[0])  # drops grow with the square
    assert spoilt({0: 0.99 * unit}, count).suspects == ()
    assert spoilt({0: 1.01 * unit}, count).suspects[0] == 0
    found = spoilt({0: 0.99 * unit}, count)
    # the other points fit exactly: without it nothing is left
    assert found.drops[0] == pytest.approx(found.chi2, rel=1e-6)
    assert found.dof == 3 * count - 6
    assert found.p_value == pytest.approx(chi2.sf(found.chi2, 3 * count - 6))
    worst_first = spoilt({0: 3.0 * unit, 2: -9.0 * unit}, count)
    assert worst_first.suspects[0] == 2
    assert list(worst_first.drops[list(worst_first.suspects)]) == sorted(worst_first.drops, reverse=True)[
        : len(worst_first.suspects)
    ]  # fmt: skip


def test_what_the_other_points_do_not_tell_of_a_point_is_not_held_against_it() -> None:
    """Three points on a line and one off it: where that one stands about the line is anybody's guess."""
    points = np.array([[-100.0, 0, 0], [0, 0, 0], [100, 0, 0], [20, 60, 0]])
    about, along = points.copy(), points.copy()
    about[3, 2] += 5.0  # the turn about the line takes all of it, but for the way to the arc
    about[3, 1] = np.sqrt(60.0**2 - 25.0)
    along[3, 0] += 5.0 * SIGMA
    free, seen = body_pose(points, about, SIGMA), body_pose(points, along, SIGMA)
    assert np.isfinite(free.drops).all() and free.suspects == ()
    assert free.drops[3] < 1e-6
    assert seen.drops[3] == pytest.approx(seen.chi2, rel=1e-5) and seen.chi2 > 1.0


def test_noise_may_be_in_either_scatter() -> None:
    rng = np.random.default_rng(2)
    after = BODY + [3.0, 2.0, 1.0] + SIGMA * rng.standard_normal(BODY.shape)
    one, split = body_pose(BODY, after, SIGMA), body_pose(BODY, after, 0.6 * SIGMA, 0.8 * SIGMA)
    np.testing.assert_allclose(split.pose, one.pose, atol=1e-9)
    # levers are those of adjusted points: a residual of 0.01 mm beside 100 mm
    assert np.max(np.abs(split.covariance - one.covariance) / np.outer(one.std, one.std)) < 1e-3
    assert split.chi2 == pytest.approx(one.chi2, rel=1e-9)


def table_of(turns: Rotation, shifts: Array, noise: float = 0.0) -> pd.DataFrame:
    rng = np.random.default_rng(4)
    data = dict[str, Array]()
    for name, point in zip(NAMES, BODY, strict=True):
        seen = turns.apply(point) + shifts + noise * rng.standard_normal(shifts.shape)
        data |= {f"{name}.{axis}": seen[:, k] for k, axis in enumerate("xyz")}
    return pd.DataFrame(data)


@pytest.mark.parametrize("angle", [0.0, 5e-5, 2e-4, 0.5, 2.0, 3.0])
def test_sigmas_of_a_rotation_vector_are_carried_by_its_own_derivative(angle: float) -> None:
    """By differences of Exp(w) R, for turns of next to nothing and of nearly half a turn; in um and rad."""
    vector = angle * np.array([0.6, -0.48, 0.64])
    turn = Rotation.from_rotvec(vector)
    table, body = (
        table_of(Rotation.concatenate([turn]), np.array([[50.0, -20, 10]])),
        dict(zip(NAMES, BODY, strict=True)),
    )
    micro = pose_table(
        1e3 * table,
        1e3 * SIGMA,
        {k: tuple(1e3 * v) for k, v in body.items()},
        units=UnitSystem("um", "rad"),
        covariance=True,
    ).iloc[0]
    found = body_pose(BODY, table.to_numpy().reshape(-1, 3), SIGMA)
    step = 1e-6
    slope = np.eye(6)
    for k in range(3):
        there = [(Rotation.from_rotvec(s * step * np.eye(3)[k]) * turn).as_rotvec() for s in (1, -1)]
        slope[3:, 3 + k] = (there[0] - there[1]) / (2 * step)
    unit = np.array([1e3] * 3 + [1.0] * 3)
    expected = np.outer(unit, unit) * (slope @ found.covariance @ slope.T)
    for k, name in enumerate(COLUMNS):
        assert micro[f"{name}.std"] == pytest.approx(np.sqrt(expected[k, k]), rel=1e-6)
    for a, b in PAIRS:
        i, j = COLUMNS.index(a), COLUMNS.index(b)
        size = np.sqrt(expected[i, i] * expected[j, j])
        assert micro[f"{a}.{b}.cov"] == pytest.approx(expected[i, j], abs=1e-6 * size)


def test_the_first_row_is_the_body_where_none_is_given() -> None:
    """Exactly so: what it did not see is left out of all rows, its noise counts in all others."""
    turns, shifts = Rotation.random(3, rng=np.random.default_rng(5)), np.arange(9.0).reshape(3, 3)
    table = table_of(turns, shifts, SIGMA)
    table.index = pd.Index([7, 8, 9])
    table.loc[7, "P5.y"] = np.nan
    frame = pose_table(table, SIGMA, covariance=True)
    assert list(frame.index) == [7, 8, 9]
    spread = [c for c in frame.columns if c.endswith((".std", ".cov"))]
    assert (
        len(spread) == 6 + 15 and (frame.loc[7, spread] == 0.0).all() and (frame.loc[8, spread] != 0.0).all()
    )
    less = pose_table(table.drop(columns=["P5.x", "P5.y", "P5.z"]), SIGMA, covariance=True)
    np.testing.assert_allclose(frame[spread].to_numpy(float), less[spread].to_numpy(float), rtol=1e-9)
    exact = {name: tuple(table.loc[7, [f"{name}.{a}" for a in "xyz"]]) for name in NAMES[:4]}
    known = pose_table(table, SIGMA, exact)
    # as much noise in the reference as in the row doubles every variance
    ratio = {name: (frame[name] / known[name]).to_numpy(float)[1] for name in ("x.std", "chi2_per_dof")}
    assert ratio["x.std"] == pytest.approx(np.sqrt(2.0), rel=1e-3)
    assert ratio["chi2_per_dof"] == pytest.approx(0.5, rel=1e-3)


def test_columns_that_are_no_whole_point_stay_beside_the_poses() -> None:
    table = table_of(Rotation.identity(2), np.zeros((2, 3)))
    table["fan.y"], table["who"] = [1.0, 2.0], ["a", "b"]
    frame = pose_table(table, SIGMA)
    assert list(frame.columns[:3]) == ["fan.y", "who", "x"]
    three = {name: tuple(point) for name, point in zip(NAMES[:3], BODY, strict=False)}
    kept = pose_table(table, SIGMA, three)
    assert [c for c in kept.columns if c in table.columns] == [
        *(f"{p}.{a}" for p in ("P4", "P5") for a in "xyz"), "fan.y", "who",
    ]  # fmt: skip
    with pytest.raises(InputError, match=r"missing column 'fan\.x'"):
        pose_table(table, SIGMA, {**three, "fan": (0.0, 0.0, 0.0)})
    with pytest.raises(InputError, match=r"found the points \['P1', 'P2'\], expected columns P1\.x P1\.y"):
        pose_table(table, SIGMA, {name: three[name] for name in NAMES[:2]})
    table.loc[1, "P3.z"] = np.inf
    with pytest.raises(InputError, match="row 2, point P3: found infinity, expected finite numbers"):
        pose_table(table, SIGMA)
    for body in (None, three):
        with pytest.raises(InputError, match="found no row, expected at least one"):
            pose_table(table.iloc[:0], SIGMA, body)


def test_files_of_points_have_gaps_and_units_and_those_of_a_body_no_gaps(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("P1.x,P1.y [m],P1.z,heat [degC],who\n1.5, ,3,20.5,a\n,0.002,,21,\n", encoding="utf-8")
    frame = read_points(path)
    assert list(frame.columns) == ["P1.x", "P1.y", "P1.z", "heat [degC]", "who"]
    np.testing.assert_array_equal(frame["P1.x"].to_numpy(float), [1.5, np.nan])
    np.testing.assert_array_equal(frame["P1.y"].to_numpy(float), [np.nan, 2.0])
    np.testing.assert_array_equal(frame["P1.z"].to_numpy(float), [3.0, np.nan])
    assert list(frame["heat [degC]"]) == ["20.5", "21"]
    path.write_text("point,x [m],y,z [um]\nB,1,2,3\nA,0.5,-2,4000\n", encoding="utf-8")
    assert read_body(path) == {"B": (1000.0, 2.0, pytest.approx(0.003)), "A": (500.0, -2.0, 4.0)}
    assert list(read_body(path)) == ["B", "A"]
    path.write_text("point,x,y,z\nB,1,2,3\nA,, 2,3\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"points\.csv: row 2 .*column 'x'"):
        read_body(path)
