"""Laws of budgets: a search ends by the work that it did, the same everywhere, and holds no more than readings tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.linear_problems import RICHNESS, UNKNOWNS, random_problem, single
from truepose.arrays import Array
from truepose.identification.posterior import posterior as drawing
from truepose.identification.posterior import state as ascending
from truepose.identification.posterior.design import GridPoint, Terms
from truepose.identification.posterior.posterior import Posterior, Sampling
from truepose.identification.posterior.spike_slab import HELD, SpikeSlab
from truepose.identification.posterior.state import State, ascended, best_point, tops
from truepose.identification.prior import SIZES

BUDGET = 3e7
"""A few sweeps of the problems here."""
START = GridPoint((1, 0), 0)


def rounded(seed: int, terms: int, width: int, readings: int) -> SpikeSlab:
    """Readings that are rounded: no term explains them, and every one a little."""
    dense = random_problem(seed, readings=readings, width=terms * width)
    rng = np.random.default_rng(seed)
    far = np.abs(rng.uniform(-1.0, 1.0, readings)) > 0.5
    errors: Array = np.where(far, 8.0 * np.sign(dense.g[:, 0]), 0.0)
    design = type(dense)(errors, dense.kind, dense.a, dense.g, dense.always, UNKNOWNS).design
    return SpikeSlab(design, UNKNOWNS, single(*[width] * terms, sizes=SIZES), SIZES)


problems = st.builds(
    rounded, st.integers(0, 99), st.integers(5, 40), st.sampled_from([1, 2, 7]), st.integers(20, 80)
)


@pytest.fixture(scope="module", autouse=True)
def _small() -> object:
    """Budgets that these problems spend."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(drawing, "BUDGET", BUDGET)
        patch.setattr(ascending, "CLIMBING", BUDGET)
        yield


def rows(found: Posterior) -> list[tuple[State, float]]:
    return [(State(s.members, s.point, round(s.log_posterior, 6)), share) for s, share in found.states]


@settings(max_examples=8)
@given(problems)
def test_chains_end_with_their_budget_and_say_so(problem: SpikeSlab) -> None:
    """Beyond it there is no more than the sweeps that count at least, whatever the readings and the terms are."""
    sampling = Sampling(problem, RICHNESS)
    settled = sampling.work
    found = sampling.posterior()
    sweep = (sampling.work - settled) / max(found.sweeps, 1)
    assert sampling.work <= BUDGET + (2 * drawing.FEWEST + 8) * sweep
    assert found.sweeps >= 2 * drawing.FEWEST
    assert not found.cut or sampling.work > BUDGET
    assert sum(share for _, share in found.states) == pytest.approx(1.0)


@settings(max_examples=8)
@given(problems)
def test_ascents_end_with_their_budget(problem: SpikeSlab) -> None:
    found = tops(problem, RICHNESS, ())
    assert all(np.isfinite(state.log_posterior) for state in found)
    assert problem.work <= 2.0 * BUDGET
    nowhere = ascended(problem, RICHNESS, best_point(problem), (), limit=0.0)
    assert nowhere.members == ()


@settings(max_examples=6)
@given(problems, st.lists(st.integers(0, 4), min_size=1, max_size=5, unique=True))
def test_no_set_holds_more_than_the_readings_do(problem: SpikeSlab, terms: list[int]) -> None:
    """Neither what ascents find, from a state that holds too much as well, nor any state of the chains."""
    most = sum(problem.design.counts) // HELD
    assert problem.capacity == most
    known = [State(tuple((term, 8) for term in sorted(terms)), START, 0.0)]
    found = [*tops(problem, RICHNESS, known), *tops(problem, RICHNESS, ())]
    found += [state for state, _ in Sampling(problem, RICHNESS, known=known).posterior(1).states]
    for state in found:
        assert len(problem.columns(state.members)[0]) <= most


def test_what_is_more_than_the_readings_hold_is_no_candidate() -> None:
    problem = rounded(1, 3, 12, 20)
    assert problem.capacity == 10
    assert not np.isfinite(problem.log_odds(START, ())).any()
    assert problem.log_prior([(0, 8)]) == -np.inf
    assert tops(problem, RICHNESS, ())[0].members == ()


@pytest.mark.parametrize("length", [15, 16])
def test_a_series_has_two_readings_a_coefficient_or_is_no_candidate(length: int) -> None:
    """However few directions of it the readings see."""
    problem = rounded(1, 3, 2, 30)
    first, *others = problem.terms.all
    terms = Terms([replace(first, length=length), *others], problem.terms.urn)
    odds = SpikeSlab(problem.design, problem.unknowns, terms, problem.sizes).log_odds(START, ())
    assert np.isfinite(odds[-1]).tolist() == [length == 15, True, True]


@settings(max_examples=4)
@given(problems)
def test_the_same_input_takes_the_same_work_and_comes_to_the_same(problem: SpikeSlab) -> None:
    again = SpikeSlab(problem.design, problem.unknowns, problem.terms, problem.sizes)
    first, second = Sampling(problem, RICHNESS), Sampling(again, RICHNESS)
    one, other = first.posterior(), second.posterior()
    assert (first.work, one.sweeps, one.cut) == (second.work, other.sweeps, other.cut)
    assert rows(one) == rows(other) and one.disagreement == other.disagreement
