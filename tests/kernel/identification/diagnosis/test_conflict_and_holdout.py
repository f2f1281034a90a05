"""Laws of the bootstrapped conflict with tolerances, of classes of parts, and of the blocks held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import null_space
from scipy.stats import chi2

from support.examples import examples
from support.recordings import rows_of
from truepose.identification.diagnosis.alarms import conflict_with_tolerances
from truepose.identification.diagnosis.holdout import OUTERMOST, held_out_blocks, ratio_interval
from truepose.identification.fit.tolerance_classes import PartClass, part_classes, widenings
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation

Array = NDArray[np.float64]
READINGS, FREE = 60, 12


def linear(rng: np.random.Generator, *, noise: float = 1.0, departure: float = 1.0) -> Linearisation:
    """A linear machine drawn from its tolerances (``departure`` times as wide as stated), seen with noise."""
    jacobian = rng.normal(size=(READINGS, FREE)) * np.geomspace(20, 1e-2, FREE)
    e = jacobian @ rng.normal(scale=departure, size=FREE) + noise * rng.normal(size=READINGS)
    rows = np.column_stack([jacobian, e])
    return Linearisation(
        grams=(rows.T @ rows,),
        counts=(READINGS,),
        free=FREE,
        columns=(),
        forms=0,
        departure=np.zeros(FREE),
        weight=np.ones(FREE),
        parts=(PartClass("length"),) * FREE,
        candidates=(),
    )


def free_noise(lin: Linearisation) -> float:
    """Noise scale that a free fit leaves, at least the stated one."""
    inside, across = lin.gram[:FREE, :FREE], lin.gram[:FREE, FREE]
    left = lin.gram[FREE, FREE] - across @ np.linalg.solve(inside, across)
    return max(1.0, float(np.sqrt(left / (READINGS - FREE))))


@pytest.mark.parametrize("noise", [1.0, 3.0])
def test_p_of_true_models_is_uniform_or_cautious(noise: float) -> None:
    rng = np.random.default_rng(4)
    p = []
    for _ in range(300):
        lin = linear(rng, noise=noise)
        p.append(conflict_with_tolerances(lin, free_noise(lin)).p)
    for level in (0.01, 0.1, 0.5):  # three standard errors of a share of 300
        assert np.mean(np.array(p) < level) < level + 3 * np.sqrt(level * (1 - level) / 300)
    assert np.mean(np.array(p) < 0.5) > 0.3  # and not blind


def test_wrong_tolerances_are_seen_and_widening_them_reconciles() -> None:
    lin = linear(np.random.default_rng(5), departure=6.0)
    noise = free_noise(lin)
    assert conflict_with_tolerances(lin, noise).p < 1e-3
    wide = replace(lin, weight=lin.weight / 6.0)
    assert conflict_with_tolerances(wide, noise).p > 0.01


def test_parameters_without_tolerance_are_projected_out() -> None:
    rng = np.random.default_rng(6)
    lin = linear(rng)
    weight = np.ones(FREE)
    weight[0] = 0.0
    far = lin.gram.copy()
    shift = 1e3 * lin.gram[:, 0]  # the unknown parameter stands anywhere
    far[:, FREE] += shift
    far[FREE, :FREE] = far[:FREE, FREE]
    far[FREE, FREE] = lin.gram[FREE, FREE] + 2e3 * lin.gram[0, FREE] + 1e6 * lin.gram[0, 0]
    found = [
        conflict_with_tolerances(
            Linearisation((gram,), (READINGS,), FREE, (), 0, np.zeros(FREE), weight, lin.parts, ()), 1.0
        )
        for gram in (lin.gram, far)
    ]
    assert found[0].statistic == pytest.approx(found[1].statistic, rel=1e-4)


@pytest.mark.parametrize(("noise", "departure", "error"), [(1.0, 3.0, 1.0), (2.0, 4.0, 2.0), (1.0, 1.0, 1.6)])
def test_far_beyond_what_is_drawn_p_is_twice_the_smaller_one_of_two_chi2(
    noise: float, departure: float, error: float
) -> None:
    """What a least-squares fit departs by against its own spread, and the readings against theirs, both in full."""
    rng = np.random.default_rng(11)
    sensitivity = rng.normal(size=(READINGS, FREE)) * np.geomspace(20, 1, FREE)
    e = sensitivity @ rng.normal(scale=departure, size=FREE) + error * rng.normal(size=READINGS)
    away, tolerance = rng.normal(size=FREE), rng.uniform(0.5, 2.0, FREE)
    open_ = 3  # without a tolerance
    rows = np.column_stack([sensitivity, e + sensitivity @ away])
    weight = np.where(np.arange(FREE) == open_, 0.0, 1.0 / tolerance)
    lin = Linearisation(
        (rows.T @ rows,), (READINGS,), FREE, (), 0, away, weight, (PartClass("length"),) * FREE, ()
    )
    # readings freed of the open parameter; geometry in tolerances
    keep = null_space(sensitivity[:, [open_]].T)
    j, seen = keep.T @ np.delete(sensitivity * tolerance, open_, axis=1), keep.T @ e
    fitted = np.linalg.pinv(j) @ seen
    spread = np.eye(FREE - 1) + noise**2 * np.linalg.inv(j.T @ j)
    statistic = float(fitted @ np.linalg.solve(spread, fitted))
    whole = float(seen @ np.linalg.solve(j @ j.T + noise**2 * np.eye(READINGS - 1), seen))
    smaller = min(chi2.sf(statistic, FREE - 1), chi2.sf(whole, READINGS - 1))
    found = conflict_with_tolerances(lin, noise)
    assert found.statistic == pytest.approx(statistic, rel=1e-6)
    assert 2.0 * smaller < 1e-3
    assert found.p == pytest.approx(2.0 * smaller, rel=1e-4)


NAMES = [f"leg{k}.{p}" for k in range(1, 7) for p in ("a.x", "b.x", "u.x", "length")]
KINDS = [{"u": "angle"}.get(name.split(".")[1], "length") for name in NAMES]


def test_classes_tell_parts_of_a_leg_apart_and_keep_frames_together() -> None:
    classes = part_classes([*NAMES, "base.x"], [*KINDS, "frame"])
    assert set(classes) == {
        PartClass("length", "leg.a"),
        PartClass("length", "leg.b"),
        PartClass("length", "leg.length"),
        PartClass("angle", "leg.u"),
        PartClass("frame"),
    }
    assert (
        part_classes(["q1.d", "q1.r", "q2.d"], ["length"] * 3) == (PartClass("length"),) * 3
    )  # too few for a class


def test_inflations_are_whole_kinds_and_single_classes() -> None:
    classes = (PartClass("length", "leg.a"), PartClass("length", "leg.b"), PartClass("angle", "leg.u"))
    rows, log_prior = widenings(classes)
    cost = dict(zip(rows, log_prior, strict=True))
    assert {(2.0, 2.0, 4.0), (2.0, 1.0, 1.0)} <= set(rows) and len(set(rows)) == len(rows)
    # one optimist for all lengths costs what one wrong class costs
    assert cost[2.0, 2.0, 1.0] == pytest.approx(cost[2.0, 1.0, 1.0])
    # everything off by one factor is one doubt, two kinds by different ones are two
    assert cost[2.0, 2.0, 2.0] == pytest.approx(cost[2.0, 2.0, 1.0])
    assert cost[2.0, 2.0, 4.0] < cost[2.0, 2.0, 2.0]


def campaign(n: int, drivers: Mapping[str, Array], validation: NDArray[np.bool_] | None = None) -> Recording:
    """Readings of two joints in time order."""
    rng = np.random.default_rng(8)
    given = {} if validation is None else {"validation": validation}
    return rows_of(rng.uniform(-1, 1, (n, 2)), drivers=drivers, **given)


def test_blocks_extrapolate_in_reach_load_and_temperature_and_share_no_row() -> None:
    rng = np.random.default_rng(9)
    drivers = {
        "payload": rng.choice([0.0, 1.0, 2.0, 3.0, 5.0], 100),
        "temperature.air": rng.normal(22, 1, 100),
    }
    recording = campaign(100, drivers)
    split, blocks = held_out_blocks(recording, np.ones(100, dtype=bool))
    assert split == "blocks"
    assert [b.name for b in blocks[:3]] == [OUTERMOST, "heaviest loads", "warmest rows"]
    assert np.sum([b.rows for b in blocks], axis=0).max() == 1
    assert np.any([b.rows for b in blocks], axis=0).all()


def test_a_load_of_two_levels_is_no_extrapolation() -> None:
    recording = campaign(60, {"payload": np.repeat([0.0, 5.0], 30)})
    _, blocks = held_out_blocks(recording, np.ones(60, dtype=bool))
    assert "heaviest loads" not in [b.name for b in blocks]


def test_validation_rows_are_the_split_where_there_are_any() -> None:
    validation = np.arange(50) >= 40
    split, blocks = held_out_blocks(campaign(50, {}, validation), ~validation)
    assert split == "role"
    np.testing.assert_array_equal(blocks[-1].rows, validation)


@settings(max_examples=examples(25), deadline=None)
@given(st.permutations(range(30)))
def test_the_interval_does_not_depend_on_the_order_of_rows(order: list[int]) -> None:
    rng = np.random.default_rng(10)
    before, after = rng.chisquare(3, 30), 0.2 * rng.chisquare(3, 30)
    ratio, interval = ratio_interval(before, after)
    again, moved = ratio_interval(before[order], after[order])
    assert again == pytest.approx(ratio)
    assert moved == pytest.approx(interval)
    assert interval[0] <= ratio <= interval[1]
