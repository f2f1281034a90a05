"""Ascents to the likeliest sets: where they end, what they exchange, and in which order their ends are told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.linear_problems import RICHNESS, catalogue_problem, enumerated, single, spike_slab
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import (
    LIKELY,
    State,
    alternatives,
    ascended,
    best_point,
    log_posterior,
    slot_odds,
    tops,
)

KINDS = [0, 0, 1, 1, 2, 2]


def settled(problem: SpikeSlab, state: State) -> bool:
    """Whether each slot holds the likeliest cause beside the others, and a further one would rather be empty."""
    members = state.members
    for member in members:
        rest = [m for m in members if m != member]
        odds = np.logaddexp.reduce(problem.log_odds(state.point, rest), axis=0)
        if int(np.argmax(odds)) != member[0] or odds.max() + slot_odds(RICHNESS, len(rest)) < 0.0:
            return False
    more = np.logaddexp.reduce(problem.log_odds(state.point, members), axis=0)
    return bool(more.max(initial=-np.inf) + slot_odds(RICHNESS, len(members)) < 0.0)


@pytest.mark.parametrize("strength", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_an_ascent_ends_where_every_slot_holds_the_likeliest(seed: int, strength: float) -> None:
    """From nothing and from a set that has nothing to do with the readings, at the sizes that are likeliest there."""
    problem = spike_slab(catalogue_problem(seed, strength=strength))
    for start in ((), ((0, 0), (3, 1), (5, 0))):
        found = ascended(problem, RICHNESS, best_point(problem), start)
        assert settled(problem, found)
        assert found.members == tuple(sorted(found.members))
        assert found.log_posterior == log_posterior(problem, RICHNESS, found.members, found.point)
        for term, size in found.members:
            rest = [m for m in found.members if m[0] != term]
            assert int(np.argmax(problem.log_odds(found.point, rest)[:, term])) == size


def test_what_is_clearly_there_is_climbed_to_from_anywhere() -> None:
    dense = catalogue_problem(3, strength=0.0)
    rng = np.random.default_rng(1)
    dense = replace(dense, e=rng.standard_normal(len(dense.e)) + 4.0 * dense.g[:, 1] - 5.0 * dense.g[:, 4])
    problem = spike_slab(dense)
    exact = enumerated(problem, RICHNESS, dense)
    likeliest = max(exact.sets, key=lambda key: exact.sets[key])
    for known in ((), (State(((0, 0), (2, 0)), GridPoint((2,), 1), 0.0),)):
        assert tuple(t for t, _ in tops(problem, RICHNESS, known)[0].members) == likeliest == (1, 4)


def test_a_group_that_acts_faintly_at_all_its_places_is_found_together() -> None:
    """No term of it pays for itself; all of them do, for like goes with like."""
    dense = catalogue_problem(7, strength=0.0, alike=0.0)
    rng = np.random.default_rng(5)
    g = np.linalg.qr(dense.g)[0] * np.sqrt(len(dense.e))
    dense = replace(dense, g=g, e=0.3 * rng.standard_normal(len(dense.e)) + 0.42 * g[:, :4].sum(axis=1))
    terms = single(*[1] * 6, kinds=[0, 0, 0, 0, 1, 2])
    problem = spike_slab(dense, terms)
    found = ascended(problem, RICHNESS, best_point(problem), ())
    assert {0, 1, 2, 3} <= {t for t, _ in found.members}
    # beside another thing that is there, too
    more = spike_slab(replace(dense, e=dense.e + 3.0 * g[:, 5]), terms)
    beside = ascended(more, RICHNESS, best_point(more), ())
    assert {0, 1, 2, 3, 5} <= {t for t, _ in beside.members}


def test_kinds_are_exchanged_whole() -> None:
    """Two columns of one kind, and two of another that are nearly the same: either pair explains the readings."""
    dense = catalogue_problem(4, strength=0.0)
    rng = np.random.default_rng(2)
    g = dense.g.copy()
    g[:, [2, 3]] = g[:, [0, 1]] + 0.02 * rng.standard_normal((len(g), 2))
    e = rng.standard_normal(len(dense.e)) + 3.0 * g[:, 0] - 3.0 * g[:, 1]
    problem = spike_slab(replace(dense, g=g, e=e), single(*[1] * 6, kinds=KINDS))
    point, members = GridPoint((1,), 0), ((0, 1), (1, 1))
    first = State(members, point, log_posterior(problem, RICHNESS, members, point))
    others = alternatives(problem, RICHNESS, first)
    assert 1 in {KINDS[t] for state in others for t, _ in state.members}
    for state in others:
        assert settled(problem, state)


@pytest.mark.parametrize("seed", range(3))
def test_ends_are_told_the_likeliest_first(seed: int) -> None:
    """Either pair of two kinds explains the readings; from whichever ends are known both are found."""
    dense = catalogue_problem(seed, strength=0.0)
    rng = np.random.default_rng(2)
    g = 3.0 * dense.g
    g[:, [2, 3]] = g[:, [0, 1]] + 0.02 * rng.standard_normal((len(g), 2))
    e = rng.standard_normal(len(dense.e)) + 0.8 * g[:, 0] - 0.8 * g[:, 1]
    problem = spike_slab(replace(dense, g=g, e=e), single(*[1] * 6, kinds=KINDS))
    every = tops(problem, RICHNESS, [])
    assert {tuple(t for t, _ in state.members) for state in every} == {(0, 1), (2, 3)}
    assert all(settled(problem, state) for state in every)
    for known in (every, every[::-1], every[1:]):
        found = tops(problem, RICHNESS, known)
        assert [s.members for s in found] == [s.members for s in every]
        assert found[0].log_posterior >= found[1].log_posterior > found[0].log_posterior - LIKELY
        assert tops(problem, RICHNESS, known)[0] == found[0]


def test_what_is_out_of_the_question_is_no_end() -> None:
    """Ends twenty nats below the likeliest one are not told."""
    dense = catalogue_problem(3, strength=0.0)
    dense = replace(dense, e=np.random.default_rng(1).standard_normal(len(dense.e)) + 9.0 * dense.g[:, 1])
    problem = spike_slab(dense, single(*[1] * 6, kinds=KINDS))
    every = tops(problem, RICHNESS, [])
    assert all(every[0].log_posterior - state.log_posterior < 20.0 for state in every)
    assert 1 in {t for t, _ in every[0].members}
