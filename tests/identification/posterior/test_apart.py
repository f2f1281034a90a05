"""Chains that are caught apart, and bounds of whole states: each counts by the mass of what it visited."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from support.linear_problems import RICHNESS, SIZES, catalogue_problem, single
from truepose.identification.posterior import posterior as chains
from truepose.identification.posterior.mode import log_posterior
from truepose.identification.posterior.posterior import APART, Seen, Tally, chain_disagreement, chain_weights
from truepose.identification.posterior.terms import Terms
from truepose.identification.posterior.weighing import Weighing

TERMS = 6
POINT = (0, 0, 0, 0)


def problem(terms: Terms | None = None) -> Weighing:
    dense = catalogue_problem(1)
    return Weighing(dense.design, dense.unknowns, terms or single(*[1] * TERMS), SIZES)


def tally(weighing: Weighing, causes: list[float], seen: dict[Seen, int]) -> Tally:
    """What a chain of ten sweeps would have summed."""
    return cast(
        Tally,
        SimpleNamespace(
            causes=np.array(causes),
            seen=Counter(seen),
            sweeps=10,
            terms=10.0 * np.array(causes),
            beside=np.zeros((TERMS, TERMS)),
            held=np.zeros(TERMS),
        ),
    )


def state(weighing: Weighing, *terms: int) -> Seen:
    point = tuple(0 for _ in weighing.unknowns.shape)
    size = int(np.flatnonzero(weighing.noticeable[:, terms[0]])[0]) if terms else 0
    return tuple((term, size) for term in terms), point


def test_chains_that_agree_count_alike_whatever_they_visited() -> None:
    weighing = problem()
    one = tally(weighing, [0.5] * TERMS, {state(weighing, 0): 10})
    other = tally(weighing, [0.5 + APART / 2] * TERMS, {state(weighing): 10})
    weights, _ = chain_weights(weighing, RICHNESS, [one, other])
    assert weights.tolist() == [0.5, 0.5]


def test_chains_caught_apart_count_by_the_mass_of_their_states() -> None:
    weighing = problem()
    here, there = state(weighing, 0), state(weighing)
    own = [1.0, *[0.0] * (TERMS - 1)]
    one, other = tally(weighing, own, {here: 10}), tally(weighing, [0.0] * TERMS, {there: 10})
    weights, logs = chain_weights(weighing, RICHNESS, [one, other])
    first, second = (log_posterior(weighing, RICHNESS, *s) for s in (here, there))
    assert weights[0] == pytest.approx(1.0 / (1.0 + np.exp(second - first)))
    assert weights.sum() == pytest.approx(1.0)
    assert logs == {here: first, there: second}


def test_how_long_a_chain_stayed_says_nothing() -> None:
    weighing = problem()
    here, there = state(weighing, 0), state(weighing)
    own = [1.0, *[0.0] * (TERMS - 1)]
    other = tally(weighing, [0.0] * TERMS, {there: 10})
    short, _ = chain_weights(weighing, RICHNESS, [tally(weighing, own, {here: 1}), other])
    long, _ = chain_weights(weighing, RICHNESS, [tally(weighing, own, {here: 1000}), other])
    np.testing.assert_allclose(short, long)


@pytest.mark.parametrize(("weights", "apart"), [([0.5, 0.5], 0.6), ([1.0, 0.0], 0.0), ([0.9, 0.1], 0.216)])
def test_disagreement_is_that_of_chains_that_count(weights: list[float], apart: float) -> None:
    """Of two that count alike it is the difference; of one that has all the mass there is none."""
    tallies = [cast(Tally, SimpleNamespace(causes=np.array(causes))) for causes in ([0.8, 0.1], [0.2, 0.1])]
    assert chain_disagreement(tallies, np.array(weights)) == pytest.approx(apart)


def test_signs_count_for_a_whole_state() -> None:
    """One that holds a coefficient of the wrong sign is as much less probable as its slot would have it."""
    free = problem()
    held = state(free, 0)
    mean, covariance = free.root(held[1]).posterior(*free.columns(held[0]))
    sign = float(np.sign(mean[0]))

    def signed(direction: float) -> float:
        dense = catalogue_problem(1)
        if direction < 0:
            column = dense.design.n
            grams = []
            for gram in dense.design.grams:
                turned = gram.copy()
                turned[column] *= -1.0
                turned[:, column] *= -1.0
                grams.append(turned)
            design = replace(dense.design, grams=tuple(grams))
        else:
            design = dense.design
        terms = Terms(
            [
                replace(t, lower=(0.0,), upper=(np.inf,)) if k == 0 else t
                for k, t in enumerate(single(*[1] * TERMS).all)
            ]
        )
        return Weighing(design, dense.unknowns, terms, SIZES).log_bounds(held[1], held[0])

    right, wrong = signed(sign), signed(-sign)
    assert right > wrong and right <= np.log(2.0) + 1e-9
    assert np.exp(right) + np.exp(wrong) == pytest.approx(2.0)  # 2 P(c > 0) and 2 P(c < 0)
    assert free.log_bounds(held[1], held[0]) == free.log_bounds(held[1], ()) == 0.0
    assert covariance[0, 0] > 0.0 and chains.AGREED < APART
