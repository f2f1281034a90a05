"""Laws of members that are given: the rest is as the whole posterior has it where they are."""

from __future__ import annotations

import numpy as np
import pytest

from support.linear_problems import (
    RICHNESS,
    SIZES,
    UNKNOWNS,
    catalogue_problem,
    enumerated,
    random_problem,
    single,
    spike_slab,
)
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.sampler import Chain, Reach
from truepose.identification.posterior.spike_slab import Members, SpikeSlab

TERMS = 6


@pytest.mark.parametrize("given", [((0, 1),), ((3, 1), (4, 1))])
def test_what_is_given_is_what_the_states_that_hold_it_say(given: Members) -> None:
    """Other terms, one of the same cause among them, and the grid: of the whole posterior those that hold it alone."""
    dense = catalogue_problem(1, strength=1.5)
    whole = spike_slab(dense, single(*[1] * TERMS, causes=[0, 0, 1, 1, 2, 3], alone=False))
    exact = enumerated(whole, RICHNESS, dense).given(given)
    start = GridPoint((0,), 1, 1)
    chain = Chain(whole.conditioned(given), RICHNESS, Reach((0, 1), (0, 1)), start, (), 3)
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
    for point in (GridPoint((0,), 0, 0), GridPoint((2,), 1, 1)):
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
    given, point = ((0, 1), (2, 0)), GridPoint((1, 0), 1, 2)
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
