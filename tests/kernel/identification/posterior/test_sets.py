"""Laws of the odds of sets: of one term more, of a part of the terms, of the urns that they are drawn from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scipy.special import logsumexp

from support.linear_problems import (
    FURTHER,
    RICHNESS,
    SIZES,
    UNKNOWNS,
    catalogue_problem,
    drawn,
    enumerated,
    random_problem,
    single,
    spike_slab,
)
from truepose.identification.posterior.design import GridPoint, Terms
from truepose.identification.posterior.sampler import Chain
from truepose.identification.posterior.spike_slab import Conditional, Members, SpikeSlab
from truepose.identification.posterior.state import log_posterior, slot_odds

POINTS: Sequence[GridPoint] = (GridPoint((1, 0), 0), GridPoint((0, 1), 1), GridPoint((2, 1), 2))


@pytest.mark.parametrize("seed", range(3))
def test_a_part_of_the_terms_has_the_same_odds(seed: int) -> None:
    """Beside members or none, at any point; columns are numbered anew and causes are not."""
    dense = catalogue_problem(seed)
    whole = SpikeSlab(dense.design, dense.unknowns, single(*[1] * 6, causes=[0, 0, 1, 2, 3, 3]), SIZES)
    wanted = np.array([True, True, False, True, False, True])
    part, index = whole.restricted(wanted)
    place = {int(term): k for k, term in enumerate(index)}
    assert index.tolist() == [0, 1, 3, 5]
    for point in (GridPoint((0,), 0), GridPoint((2,), 1)):
        for members in ((), ((3, 1),), ((0, 0), (5, 1))):
            own = tuple((place[term], size) for term, size in members)
            np.testing.assert_allclose(
                part.log_odds(point, own), whole.log_odds(point, members)[:, wanted], atol=1e-8
            )
            assert part.log_evidence(point, own) == pytest.approx(
                whole.log_evidence(point, members), abs=1e-8
            )
            assert part.log_prior(own) == pytest.approx(whole.log_prior(members))


@pytest.mark.parametrize("seed", range(3))
def test_odds_of_one_more_are_the_ratio_of_two_posteriors(seed: int) -> None:
    """Whatever has left or is given; the number of slots and how full they are, in both."""
    dense = catalogue_problem(seed)
    problem = SpikeSlab(
        dense.design, dense.unknowns, single(*[1] * 6, causes=[0, 0, 1, 2, 3, 3], alone=False), SIZES
    )
    point, members = GridPoint((1,), 0), ((0, 1), (3, 1))
    here = log_posterior(problem, RICHNESS, members, point)
    assert np.isfinite(here) and not problem.noticeable.all()
    slot = slot_odds(RICHNESS, 2)
    for odds in (
        problem.log_odds(point, members),
        problem.log_odds(point, members, ((4, 1), (5, 0))),
        problem.conditioned(((3, 1),)).log_odds(point, ((0, 1),)),
        problem.conditioned(((3, 1),)).log_odds(point, ((0, 1),), ((5, 0),)),
        problem.conditioned(members).log_odds(point, ()),
    ):
        found = odds + slot
        for term in (1, 2, 4, 5):
            for size in range(2):
                more = log_posterior(problem, RICHNESS, (*members, (term, size)), point)
                assert found[size, term] == pytest.approx(more - here, abs=1e-7)
        assert np.all(found[:, [0, 3]] == -np.inf)


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 1)), unique_by=lambda m: m[0], max_size=6))
def test_the_log_prior_of_a_set_is_that_of_drawing_it_from_the_urns(members: list[tuple[int, int]]) -> None:
    """In any order; what a set and the set with a term more differ by is the prior odds of that term."""
    terms = single(*[1] * 6, causes=[0, 0, 1, 1, 2, 3], kinds=[0, 0, 0, 1], alone=False)
    assert terms.log_prior_of(members) == pytest.approx(drawn(terms, tuple(members)))
    assert terms.log_prior_of(members[::-1]) == pytest.approx(terms.log_prior_of(members))
    for k, member in enumerate(members):
        rest = members[:k] + members[k + 1 :]
        step = terms.log_prior(rest)[member[1], member[0]]
        assert terms.log_prior_of(members) - terms.log_prior_of(rest) == pytest.approx(step)


def test_a_second_term_of_a_cause_has_paid_for_it() -> None:
    """It costs its own odds and its setting; where causes take one term alone, there is none."""
    terms = single(1, 1, 1, causes=[0, 0, 1], alone=False)
    prior = terms.log_prior([(0, 1)])
    np.testing.assert_allclose(prior[:, 1], np.log(FURTHER / 2.0) + SIZES.log_prior)
    assert np.all(prior[:, 0] == -np.inf)
    alone = single(1, 1, 1, causes=[0, 0, 1]).log_prior([(0, 1)])
    assert np.all(alone[:, :2] == -np.inf) and np.all(np.isfinite(alone[:, 2]))


@pytest.mark.parametrize("width", [3, 30])
def test_a_wide_term_turned_to_what_is_seen_is_the_same_term(width: int) -> None:
    """Its evidence at every size changes by no more than what was left out adds; all numbers stay."""
    rng = np.random.default_rng(1)
    dense = random_problem(2, readings=25, width=width + 2)
    few = rng.standard_normal((25, 4)) @ rng.standard_normal((4, width))
    dense = replace(dense, g=np.column_stack([dense.g[:, :1], few, dense.g[:, -1:]]))
    problem = spike_slab(dense, single(1, width, 1))
    turned = problem.compressed()
    assert turned.design.width == 2 + (width if width == 3 else 4)
    for point in POINTS[::5]:
        here, there = (p.log_odds(point, [(0, 1)]) for p in (problem, turned))
        np.testing.assert_allclose(there, here, atol=1e-6)


@given(st.integers(0, 23))
def test_richness_is_marginalised_over_its_levels(number: int) -> None:
    """Odds of one more: each level's chance of filled slots, weighted, times the slots that are left."""
    filled, prior, slots = np.array(RICHNESS.filled), np.exp(RICHNESS.log_prior), 24
    rich = replace(RICHNESS, slots=slots)
    weight = [float(np.sum(prior * filled**k * (1.0 - filled) ** (slots - k))) for k in (number, number + 1)]
    expected = np.log(weight[1] / weight[0] * (slots - number))
    assert slot_odds(rich, number) == pytest.approx(expected)
    assert logsumexp(rich.log_weights(number)) == pytest.approx(np.log(weight[0]))


@given(seed=st.integers(0, 1000), slot=st.floats(-6.0, 3.0))
@hypothesis_settings(max_examples=15, deadline=None)
def test_a_slot_is_drawn_as_often_as_its_conditional_says(seed: int, slot: float) -> None:
    rng = np.random.default_rng(seed)
    odds = rng.normal(0.0, 1.5, (2, 3))
    found = Conditional(odds, -3.0)
    exact = np.append(np.exp(odds + slot).ravel(), 1.0)
    exact /= exact.sum()
    np.testing.assert_allclose(found.terms(slot), exact[:-1].reshape(2, 3).sum(axis=0))
    assert found.log_total(slot) == pytest.approx(-np.log(exact[-1]))
    drawn = [found.draw(slot, rng) for _ in range(2000)]
    counts = [drawn.count((term, size)) for size in range(2) for term in range(3)] + [drawn.count(None)]
    np.testing.assert_allclose(np.array(counts) / 2000.0, exact, atol=5.0 * np.sqrt(0.25 / 2000.0))


TERMS = 6


@pytest.mark.parametrize("given", [((0, 1),), ((3, 1), (4, 1))])
def test_what_is_given_is_what_the_states_that_hold_it_say(given: Members) -> None:
    """Other terms, one of the same cause among them, and the grid: of the whole posterior those that hold it alone."""
    dense = catalogue_problem(1, strength=1.5)
    whole = spike_slab(dense, single(*[1] * TERMS, causes=[0, 0, 1, 1, 2, 3], alone=False))
    exact = enumerated(whole, RICHNESS, dense).given(given)
    start = GridPoint((0,), 1)
    chain = Chain(whole.conditioned(given), RICHNESS, (0, 1), start, (), 3)
    sweeps = list(chain.sweeps(4000))
    held = [term for term, _ in given]
    expected = exact.terms.copy()
    np.testing.assert_allclose(expected[held], 1.0)
    expected[held] = 0.0  # slots that are drawn hold it no second time
    terms = np.mean([np.sum([v.terms for v in sweep.visits], axis=0) for sweep in sweeps], axis=0)
    np.testing.assert_allclose(terms, expected, atol=0.02)
    assert np.any((expected > 0.1) & (expected < 0.9))
    for point, share in exact.points.items():
        assert np.mean([s.point == point for s in sweeps]) == pytest.approx(share, abs=0.04)


def test_evidence_and_prior_of_what_is_given_are_those_of_the_whole() -> None:
    whole = spike_slab(catalogue_problem(1), single(*[1] * TERMS, causes=[0, 0, 1, 1, 2, 3], alone=False))
    given = ((0, 1), (4, 1))
    part = whole.conditioned(given)
    for point in (GridPoint((0,), 0), GridPoint((2,), 1)):
        for members in ((), ((1, 1),), ((2, 1), (5, 1))):
            both = (*given, *members)
            assert part.log_evidence(point, members) == pytest.approx(
                whole.log_evidence(point, both), abs=1e-8
            )
            further = part.log_prior(members) - part.log_prior(())
            assert further == pytest.approx(whole.log_prior(both) - whole.log_prior(given))


@pytest.mark.parametrize("width", [8, 60])
def test_beside_what_is_given_many_terms_are_weighed_as_few_are(width: int) -> None:
    """Whether products are written out (few columns are left) or follow from halves (many are)."""
    whole = SpikeSlab(random_problem(3, width=width).design, UNKNOWNS, single(*[2] * (width // 2)), SIZES)
    given, point = ((0, 1), (2, 0)), GridPoint((1, 0), 1)
    part, left = whole.conditioned(given), np.array([2, 3, *range(6, width)])
    own, expected = part.base(point), whole.beside(point, given)
    assert own.log_evidence == pytest.approx(expected.log_evidence, abs=1e-8)
    np.testing.assert_allclose(own.score, expected.score[left], atol=1e-8)
    every = np.arange(len(left))
    np.testing.assert_allclose(own.rows(every), expected.rows(left)[:, left], atol=1e-8)
    np.testing.assert_allclose(own.among(every), expected.among(left), atol=1e-8)
    members = ((1, 1), (3, 1))
    assert part.log_evidence(point, members) == pytest.approx(whole.log_evidence(point, (*given, *members)))
    found, known = part.log_odds(point, members), whole.log_odds(point, (*given, *members))
    open_ = np.isfinite(known)
    np.testing.assert_allclose(found[open_], known[open_], atol=1e-7)


def test_signs_count_for_a_whole_state() -> None:
    """One that holds a coefficient of the wrong sign is as much less probable as its slot would have it."""
    dense, free = catalogue_problem(1), spike_slab(catalogue_problem(1))
    size = int(np.flatnonzero(free.noticeable[:, 0])[0])
    members, point = ((0, size),), GridPoint((0,), 0)
    mean, _ = free.root(point).posterior(*free.columns(members))
    one, *others = single(*[1] * 6).all

    terms = Terms([replace(one, lower=(0.0,), upper=(np.inf,)), *others], single(*[1] * 6).urn)
    right, wrong = (
        spike_slab(replace(dense, e=turn * np.sign(mean[0]) * dense.e), terms).log_bounds(point, members)
        for turn in (1.0, -1.0)
    )
    assert right > wrong and right <= np.log(2.0) + 1e-9
    assert np.exp(right) + np.exp(wrong) == pytest.approx(2.0)  # 2 P(c > 0) and 2 P(c < 0)
    assert free.log_bounds(point, members) == free.log_bounds(point, ()) == 0.0


def test_a_conditional_is_its_odds_and_nothing() -> None:
    dense = catalogue_problem(0)
    problem = SpikeSlab(dense.design, dense.unknowns, single(*[1] * 6), SIZES)
    point = GridPoint((1,), 0)
    conditional = problem.conditional(point, ((2, 1),))
    slot = -1.3
    odds = np.exp(problem.log_odds(point, ((2, 1),)) + slot)
    np.testing.assert_allclose(conditional.terms(slot), odds.sum(axis=0) / (1.0 + odds.sum()), atol=1e-12)
    assert conditional.log_total(slot) == pytest.approx(np.log1p(odds.sum()))
    rng = np.random.default_rng(1)
    drawn = [conditional.draw(slot, rng) for _ in range(20_000)]
    for term in range(6):
        for size in range(2):
            share = odds[size, term] / (1.0 + odds.sum())
            assert drawn.count((term, size)) / 20_000 == pytest.approx(share, abs=0.015)
