"""What a fleet's machines say together: in any order, frequencies, constants and tolerances that hold what was drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline
from scipy.special import expit
from scipy.stats import t as student

from support.command import input_error
from support.fleets import DrawnFleet, mixed_machines
from truepose.identification.leaves.fleet.hierarchy import FINE, Hierarchy, single
from truepose.identification.leaves.fleet.likelihood import (
    KERNEL,
    LOG_ODDS,
    SLAB,
    Told,
    by_size,
    of_frequency,
    of_presence,
)
from truepose.identification.leaves.fleet.pooled import NUMBERS, Pooled
from truepose.identification.leaves.fleet.record import figures_of, parameters_of, rounded
from truepose.identification.leaves.fleet.statistics import log_normal, statistics, trees


@given(seed=st.integers(0, 2**20), order=st.permutations(range(6)))
def test_statistics_know_no_order(seed: int, order: list[int]) -> None:
    every = mixed_machines(np.random.default_rng(seed), 6)
    assert statistics(Pooled.of([every[k] for k in order])) == statistics(Pooled.of(every))


def test_what_is_kept_of_no_machine_is_refused() -> None:
    with input_error("truepose/kept/1"):
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


def kept(**changes: Any) -> dict[str, Any]:
    return {**DrawnFleet(np.zeros(2), 5, -4.0).machine(np.random.default_rng(0)), **changes}


def fleet(deviations: list[float], std: float = 0.1) -> list[dict[str, Any]]:
    return [kept(parameters={"c1": [x, std, "length"], "c2": [0.0, std, "length"]}) for x in deviations]


def test_a_constant_has_the_mean_and_the_spread_of_its_machines() -> None:
    x = [1.0, 2.0, 4.0, 5.0]
    told = statistics(Pooled.of(fleet(x)))
    first, second = told.constants
    # the farthest off first
    assert (told.machines, first.name, second.name, first.machines) == (4, "c1", "c2", 4)
    assert first.mean.value == pytest.approx(3.0, rel=1e-5)
    half = student.ppf(0.95, 3) * np.std(x, ddof=1) / 2.0
    assert (first.mean.low, first.mean.high) == pytest.approx((3.0 - half, 3.0 + half), rel=1e-4)
    # what the fits themselves scatter by is no difference between machines
    assert first.spread == pytest.approx(np.sqrt(np.var(x, ddof=1) - 0.1**2), rel=1e-4)
    assert second.spread == 0.0
    assert statistics(Pooled.of(fleet([1.0]))).constants == ()  # one machine has no spread


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0])
def test_a_tolerance_is_met_where_parts_scatter_less(ratio: float) -> None:
    x = ratio * np.random.default_rng(1).standard_normal(100)
    machines = [kept(parameters={"c1": [float(v), 0.01, "length"]}) for v in x]
    (alone,) = statistics(Pooled.of(machines)).tolerances
    assert (alone.deviations, alone.parts) == (100, "length")
    # 100 deviations tell a spread to 7 %
    assert alone.ratio.value == pytest.approx(ratio, rel=0.2)
    assert alone.ratio.low < alone.ratio.value < alone.ratio.high < 1.4 * alone.ratio.low
    assert alone.met == pytest.approx(1.0 if ratio < 1 else 0.0, abs=0.01) or ratio == 1.0


def test_sizes_are_log_normal_with_their_noise_taken_off() -> None:
    y, e = np.array([0.0, 0.2, 0.5, 0.9, 1.4]), np.full(5, 0.1)
    sums = np.array([5.0, y.sum(), (y**2).sum(), (e**2).sum()])
    mean, spread, error = log_normal(sums)
    variance = np.var(y, ddof=1)
    assert mean == pytest.approx(y.mean()) and spread == pytest.approx(np.sqrt(variance - 0.01))
    assert error == pytest.approx(student.ppf(0.95, 4) * np.sqrt(variance / 5))
    alike = log_normal(np.array([4.0, 4 * 0.7, 4 * 0.49, 4 * 0.09]))
    assert alike[1] == 0.0 and alike[2] == pytest.approx(student.ppf(0.95, 3) * np.sqrt(0.09 / 4))


def side(chi2: float, rms: dict[str, float], held: dict[str, float]) -> dict[str, Any]:
    def told(values: dict[str, float]) -> dict[str, Any]:
        return {kind: {"value": v, "unit": "mm"} for kind, v in values.items()}

    return {"chi2_per_dof": chi2, "rms": told(rms), "validation_rms": told(held)}


@pytest.mark.parametrize("held", [True, False])
def test_figures_of_a_diagnosis_are_those_of_held_out_rows_where_there_are_some(held: bool) -> None:
    after = side(1.0, {"position": 0.1, "new": 1.0}, {"position": 0.25, "new": 1.0} if held else {})
    before = side(9.1234567, {"position": 0.4}, {"position": 0.5})
    finding = {"effect": "backlash", "place": ["q2"]}
    diagnosis = {
        "machine": "arm", "verdict": "adequate", "concealed": False, "fit": {"before": before, "after": after},
        "proof": None, "noise": 1.0, "findings": [finding], "remainder": None,
        "parameters": {
            "a": {"identifiable": True, "std": 0.0123456789, "value": 1.23456789},
            "b": {"identifiable": False, "std": 0.1, "value": 1.0},
            "c": {"identifiable": True, "std": None, "value": 1.0},
            "d": {"identifiable": True, "std": 0.0, "value": 1.23456789},
        },
    }  # fmt: skip
    found = figures_of(diagnosis, "ok")
    first, last = (0.5, 0.25) if held else (0.4, 0.1)
    read = [found[name] for name in ("reading", "rms_before", "rms_after", "unit")]
    assert read == ["position", first, last, "mm"]
    assert found["held_out"] is held and found["findings"] == "backlash at q2"
    assert (found["chi2_before"], found["chi2_after"], found["ratio"]) == (9.12346, 1.0, None)
    more = figures_of({**diagnosis, "proof": {"ratio": 2.0}, "remainder": {"driver": "payload"}}, "ok")
    assert more["ratio"] == 2.0 and more["remainder"] == "payload"
    # to a thousandth of the 1-sigma, and no coarser
    assert parameters_of(diagnosis) == {"a": (1.23457, 0.0123457), "d": (1.23456789, 0.0)}
    assert rounded(None) is None and rounded(123456789.0) == 123457000.0


def test_machines_that_have_it_at_one_place_raise_the_others() -> None:
    often = 20.0 * np.log(expit(LOG_ODDS))  # in each of twenty machines
    likely = np.zeros((2, len(SLAB), len(LOG_ODDS)))
    likely[0] = often
    told = Hierarchy(np.array([-4.0, -4.0]), likely)
    alone = single(-4.0, np.zeros(len(LOG_ODDS)))
    assert told.place(0).mean > 0.7 > told.place(1).mean > 2.0 * alone.mean
    assert told.elsewhere.mean == pytest.approx(told.place(1).mean)
    assert told.place(0).log_factor > told.place(1).log_factor > 0.0


def test_likelihoods_of_one_machine() -> None:
    """1 - q + q B; where a rival explains it with a probability, that share of the machine says that there is nothing."""
    q = expit(LOG_ODDS)
    sure = Told.of(pd.DataFrame([[0.9, 0.1, 2.0, 0.25, 1.0]], columns=NUMBERS))
    assert sure.rival[0] == 0.0 and sure.log_factor[0] == pytest.approx(2.0)
    expected = np.log(1.0 - q + q * (0.25 + 0.75 * np.exp(2.0)))
    np.testing.assert_allclose(of_presence(sure)[0], expected)
    nobody = np.full((1, len(SLAB)), np.nan)
    whole = np.log(SLAB @ np.exp(of_frequency(sure, nobody)[0]))  # over the slab, sizes say no more
    np.testing.assert_allclose(whole, expected, rtol=1e-6)
    shared = Told.of(pd.DataFrame([[0.4, 0.1, 2.0, 0.25, 0.5]], columns=NUMBERS))
    assert shared.rival[0] == pytest.approx(0.4)
    assert shared.log_factor[0] == pytest.approx(2.0 + np.log(0.6) - np.log(0.2))
    there = np.log(1.0 - q + q * (0.25 + 0.75 * np.exp(shared.log_factor[0])))
    np.testing.assert_allclose(of_presence(shared)[0], 0.6 * there + 0.4 * np.log(1.0 - q + 0.25 * q))
