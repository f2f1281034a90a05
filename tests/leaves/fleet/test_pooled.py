"""Laws of what a fleet's machines say together: the same in any order, frequencies and tolerances that hold what was drawn."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.special import expit

from support.fleets import DrawnFleet, mixed_machines
from truepose.errors import InputError
from truepose.identification.leaves.fleet.hierarchy import FINE, KERNEL, LOG_ODDS, SLAB, by_size
from truepose.identification.leaves.fleet.pooled import Pooled
from truepose.identification.leaves.fleet.statistics import statistics, trees


@given(seed=st.integers(0, 2**20), order=st.permutations(range(6)))
def test_statistics_know_no_order(seed: int, order: list[int]) -> None:
    every = mixed_machines(np.random.default_rng(seed), 6)
    assert statistics(Pooled.of([every[k] for k in order])) == statistics(Pooled.of(every))


def test_what_is_kept_of_no_machine_is_refused() -> None:
    with pytest.raises(InputError, match="truepose/kept/1"):
        Pooled.of([{}])


def test_a_fleet_of_which_nothing_is_known_has_the_sizes_of_the_slab() -> None:
    np.testing.assert_allclose(SLAB @ KERNEL, SLAB, rtol=1e-12)
    assert np.all(KERNEL > 0.0)
    np.testing.assert_allclose(KERNEL.sum(axis=1), 1.0)


@given(factor=st.floats(-5.0, 10.0), unseen=st.floats(0.0, 1.0))
def test_what_is_kept_of_sizes_adds_up(factor: float, unseen: float) -> None:
    """Summed over the slab, unnoticed sizes say nothing and the others what the Bayes factor says."""
    expected = unseen + (1.0 - unseen) * np.exp(factor)
    (factors,) = by_size(np.array([factor]), np.array([unseen]), np.full((1, len(SLAB)), np.nan))
    assert SLAB @ factors == pytest.approx(expected, rel=1e-9)


def test_a_place_alone_is_what_its_machines_say_times_what_was_known() -> None:
    """One likelihood once: a place hears of others through their effect, and not of itself."""
    rng = np.random.default_rng(5)
    fleet = DrawnFleet(np.array([0.6]), 6, -3.0)
    (tree,) = trees(Pooled.of([fleet.machine(rng) for _ in range(12)])).values()
    found = tree.hierarchy.place(0)
    fine = CubicSpline(LOG_ODDS, tree.hierarchy.likely[0], axis=1)(FINE)
    expected = found.before * (SLAB @ np.exp(fine - fine.max()))
    np.testing.assert_allclose(found.shares, expected / expected.sum(), atol=1e-9)
    assert found.before @ expit(FINE) == pytest.approx(expit(-3.0), rel=1e-6)


def test_rivals_that_explain_the_same_are_counted_once() -> None:
    """In 60 machines something is surely there, which either of two may be: each of them in half, not both in all."""
    rng = np.random.default_rng(2)
    kept = [DrawnFleet(np.zeros(2), 5, -4.0).machine(rng) for _ in range(60)]
    for one in kept:
        one["places"]["backlash"] = {q: [0.5, 0.018, 4.0, 0.0, 0.5] for q in ("q1", "q2")}
    told = statistics(Pooled.of(kept)).places
    assert all(0.35 < one.frequency.value < 0.65 for one in told)
    for one in kept:
        one["places"]["backlash"] = {q: [0.5, 0.018, 4.0, 0.0, 1.0] for q in ("q1", "q2")}
    alone = statistics(Pooled.of(kept)).places
    assert all(one.frequency.value > 0.85 for one in alone)


def test_frequencies_and_tolerances_hold_what_was_drawn() -> None:
    """Of fleets drawn from the model nine of ten intervals hold the truth; 300 of them do so to 2 %, alike ones to 5 %."""
    held, spreads, far = list[bool](), list[bool](), list[float]()
    for seed in range(50):
        rng = np.random.default_rng(seed)
        fleet, ratio = DrawnFleet.draw(rng, 6), float(np.exp(0.6 * rng.standard_normal()))
        told = statistics(Pooled.of([fleet.machine(rng, ratio) for _ in range(25)]))
        for one in told.places:
            truth = float(fleet.frequency[int(one.place[0][1:]) - 1])
            held.append(one.frequency.low <= truth <= one.frequency.high)
            far.append(one.frequency.value - truth)
        spread = told.tolerances[0]
        spreads.append(spread.ratio.low <= ratio <= spread.ratio.high)
    assert len(held) == 300 and 0.85 < np.mean(held) < 0.95
    assert np.mean(spreads) > 0.8
    assert abs(np.mean(far)) < 3.0 * np.std(far) / np.sqrt(50)
