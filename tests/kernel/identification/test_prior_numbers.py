"""The table of prior numbers: laws that any such numbers keep, and the figures that docs/topics/method.md promises of them."""

from __future__ import annotations

from itertools import pairwise
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.identification import prior
from truepose.identification.fit.tolerance_classes import PartClass, part_classes, tolerance_cost, widenings
from truepose.identification.posterior.design import Unknowns
from truepose.identification.prior import Doubt, Richness, Sizes, noise_log_prior, slab

PLAIN = (((1.0,),), (0.0,))
"""Tolerances as stated, and nothing else."""


def grid(rms: float) -> Unknowns:
    return Unknowns.over(1, rms, PLAIN)


# -- how many -----------------------------------------------------------------------------------------------------


def test_simple_usual_and_rich_machines_are_expected_to_have_as_many_effects_as_promised() -> None:
    """A half, two and seven, in 32 slots; one of these machines it is."""
    expected = prior.RICHNESS.slots * np.array(prior.RICHNESS.filled)
    np.testing.assert_allclose(expected, [0.5, 2.0, 7.0], rtol=0.05)
    assert prior.RICHNESS.slots == 32
    assert np.sum(np.exp(prior.RICHNESS.log_prior)) == pytest.approx(1.0)
    assert list(prior.RICHNESS.log_prior) == sorted(prior.RICHNESS.log_prior, reverse=True)


@pytest.mark.parametrize("richness", [prior.RICHNESS, Richness((0.1, 0.7), (-0.3, -1.4), 5)])
def test_slots_are_filled_as_in_draws_of_each_level(richness: Richness) -> None:
    """Sets of every number weigh what the levels' binomials say, and one more slot what is left of it."""
    levels = np.exp(richness.log_prior)
    p, n = np.array(richness.filled), richness.slots
    for k in range(n + 1):
        by_level = levels * p**k * (1.0 - p) ** (n - k)
        np.testing.assert_allclose(np.exp(richness.log_weights(k)), by_level, rtol=1e-9)
        assert np.exp(richness.log_totals[k]) == pytest.approx(float(by_level.sum()))
    for k in range(n):
        more, same = (float(np.sum(levels * p**j * (1.0 - p) ** (n - j))) for j in (k + 1, k))
        assert richness.slot(k) == pytest.approx(np.log(more / same))
    total = sum(comb(n, k) * np.exp(richness.log_totals[k]) for k in range(n + 1))
    assert total == pytest.approx(float(levels.sum()))
    assert len(richness.log_totals) == n + 2


@given(st.floats(-4.0, 4.0))
def test_a_factor_on_the_odds_of_a_slot_is_one_at_every_level(log_factor: float) -> None:
    richness = prior.RICHNESS.scaled(log_factor)
    before, after = (np.array(r.filled) / (1.0 - np.array(r.filled)) for r in (prior.RICHNESS, richness))
    np.testing.assert_allclose(np.log(after / before), log_factor, atol=1e-9)
    assert (richness.log_prior, richness.slots) == (prior.RICHNESS.log_prior, prior.RICHNESS.slots)


# -- how large ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sizes", "smallest", "largest", "rarer"),
    [
        (prior.SIZES, 1e-3, 10.0, 2.0),
        (prior.MOVEMENT_SIZES, 1e-5, 100.0, 1.0),
        (slab(0.1, 1000.0, 3.0), 0.1, 1000.0, 3.0),
    ],
)
def test_sizes_are_alike_up_to_the_largest_usual_one_and_fall_by_a_power_beyond(
    sizes: Sizes, smallest: float, largest: float, rarer: float
) -> None:
    """Two of them a decade: ten times larger is a hundred times rarer for effects, ten times for movements."""
    values, shares = sizes.values, np.exp(sizes.log_prior)
    assert (values[0], values[-1]) == pytest.approx((smallest, largest))
    np.testing.assert_allclose(values[2:] / values[:-2], 10.0)
    assert np.sum(shares) == pytest.approx(1.0)
    usual = values <= 1.0 + 1e-9
    np.testing.assert_allclose(shares[usual], shares[0])
    np.testing.assert_allclose(shares[~usual] / shares[0], values[~usual] ** -rarer)


# -- how good stated numbers are ----------------------------------------------------------------------------------


@pytest.mark.parametrize("doubt", [prior.SIGMA_DOUBT, prior.RATIO_DOUBT, Doubt(0.2, 0.5, 3.0)])
def test_a_doubt_is_two_normals_in_the_log(doubt: Doubt) -> None:
    """Moments of the mixture, by sums over its density."""
    step = np.linspace(-40.0, 40.0, 80_001)
    density = np.exp(doubt.log_prior(step)) / np.sqrt(2.0 * np.pi) * (step[1] - step[0])
    right, narrow, wide = doubt.right, doubt.narrow, doubt.wide
    moments = [float(np.sum(density * step**k)) for k in (0, 1, 2)]
    np.testing.assert_allclose(
        moments, [1.0, 0.0, right * narrow**2 + (1.0 - right) * wide**2], rtol=1e-6, atol=1e-9
    )


@pytest.mark.parametrize("rms", [0.3, 1.0, 5.0, 40.0])
def test_the_grid_of_noise_holds_what_is_stated_and_what_the_misfit_would_need(rms: float) -> None:
    """In steps no longer than what a stated sigma is right to; a sigma may be stated too large, but not by much."""
    (axis,) = grid(rms).noise
    steps = np.log(axis.values)
    assert np.min(np.abs(steps)) < 0.05
    assert max(2.0, 1.3 * rms) <= axis.values[-1] < 1.3 * max(2.0, 1.3 * rms)
    assert all(0.0 < b - a < prior.SIGMA_DOUBT.narrow + 1e-9 for a, b in pairwise(steps))
    assert 0.5 <= axis.values[0] < 1.0
    np.testing.assert_allclose(axis.log_prior, prior.SIGMA_DOUBT.log_prior(steps))
    assert axis.log_prior == noise_log_prior(axis.values)


def test_tolerances_are_half_as_stated_twice_or_four_times_as_wide() -> None:
    """Too narrow ones may be those of a kind alone, too wide ones only those of all."""
    classes = (PartClass("length"), PartClass("angle"))
    rows, log_prior = widenings(classes)
    assert {factor for row in rows for factor in row} == {0.5, 1.0, 2.0, 4.0}
    assert [row for row in rows if 0.5 in row] == [(0.5, 0.5)]
    assert rows[0] == (1.0, 1.0) and log_prior[0] == 0.0
    one_sigma = float(np.exp(prior.TOLERANCE_DOUBT))
    assert tolerance_cost((one_sigma,) * 2, classes) == pytest.approx(0.5)
    assert 1.5 < one_sigma < 2.0  # a tolerance stated half as wide as it should be is unusual, and no wonder


# -- names and what has none --------------------------------------------------------------------------------------


def test_one_thing_in_five_has_no_name_and_formulas_are_off_by_a_tenth() -> None:
    assert prior.UNNAMED_SHARE == 0.2 and prior.FORM_ERROR == 0.1


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
