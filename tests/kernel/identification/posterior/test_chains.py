"""Laws of the chains over sets: what every set weighs when all are counted, starts, seeds, order of terms, exclusions.

Where a probability is compared with the exact one, both chains are 4,000 sweeps long: 1-sigma over six seeds is 0.005 at most.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from support.examples import by_day
from support.linear_problems import (
    FEW,
    RICHNESS,
    SIZES,
    axis,
    catalogue_problem,
    enumerated,
    reordered,
    single,
    spike_slab,
)
from truepose.arrays import Array
from truepose.identification.posterior import posterior as chains
from truepose.identification.posterior import sampler as finding
from truepose.identification.posterior import sampler as sampling
from truepose.identification.posterior.design import GridPoint, Term, Terms
from truepose.identification.posterior.posterior import Chains, Posterior, mode, sample
from truepose.identification.posterior.sampler import Chain, plausible
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import State, best_point, log_posterior, tops
from truepose.identification.prior import Richness

TERMS = 6
ALL = (0, 1)
"""Every widening of the grid."""
LONG = 100
"""Rounds of two chains that are compared with exact probabilities."""


@pytest.fixture
def long(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chains that do not stop as soon as they agree."""
    monkeypatch.setattr(chains, "AGREED", -1.0)  # two chains may agree exactly by chance
    monkeypatch.setattr(
        sampling, "JOINT", 0.5
    )  # as many draws of the grid a sweep as with the slots of a machine


def shares(found: Posterior, count: int = TERMS) -> Array:
    """(c,) probability of each term; those left out of the chains have none."""
    return np.array([found.terms.get(k, 0.0) for k in range(count)])


def visited(found: Posterior) -> Array:
    """(c,) the same by how often the chains held each term."""
    out = np.zeros(TERMS)
    for state, share in found.states:
        out[[term for term, _ in state.members]] += share
    return out


@cache
def _run(problem: int, seed: int) -> Posterior:
    """Long chains over a problem of the catalogue, once for the laws that look at them."""
    return sample(spike_slab(catalogue_problem(problem)), RICHNESS, seed=seed, rounds=LONG)


# -- against counting every set ---------------------------------------------------------------------------


@pytest.mark.parametrize(("problem", "seed"), by_day([(0, 1), (1, 2), (2, 3)], (1, 2)))
def test_probabilities_are_those_of_all_sets_counted(long: None, problem: int, seed: int) -> None:
    """Sets, sizes, noise and tolerances; what slots were drawn from, and what they held."""
    dense = catalogue_problem(problem)
    exact = enumerated(spike_slab(dense), RICHNESS, dense)
    assert np.any((exact.terms > 0.1) & (exact.terms < 0.9))  # nothing is learnt from what is certain
    found = _run(problem, seed)
    np.testing.assert_allclose(shares(found), exact.terms, atol=0.02)
    np.testing.assert_allclose(visited(found), exact.terms, atol=0.04)
    for point, share in exact.points.items():
        assert dict(found.points).get(point, 0.0) == pytest.approx(share, abs=0.03)
    sets: dict[tuple[int, ...], float] = {}
    for state, share in found.states:
        key = tuple(term for term, _ in state.members)
        sets[key] = sets.get(key, 0.0) + share
    for key, share in sorted(exact.sets.items(), key=lambda item: -item[1])[:8]:
        assert sets.get(key, 0.0) == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("alone", by_day([True, False], False))
def test_causes_of_several_terms_are_counted_right(long: None, alone: bool) -> None:
    """Terms of one cause exclude each other, or a second one costs less than a first."""
    dense = catalogue_problem(1)
    problem = spike_slab(dense, single(*[1] * TERMS, causes=[0, 0, 1, 1, 2, 3], alone=alone))
    exact = enumerated(problem, RICHNESS, dense)
    found = sample(problem, RICHNESS, seed=4, rounds=LONG)
    np.testing.assert_allclose(shares(found), exact.terms, atol=0.02)
    if alone:
        for state, _ in found.states:
            causes = [int(problem.terms.cause[term]) for term, _ in state.members]
            assert len(set(causes)) == len(causes)
    else:
        assert sum(share for key, share in exact.sets.items() if {0, 1} <= set(key)) > 0.02  # it happens


@pytest.mark.parametrize("slots", by_day([1, 3, 24], 3))
def test_one_term_is_as_probable_as_its_odds_in_however_many_slots(long: None, slots: int) -> None:
    """A single term of known gain: the odds are the prior's times the Bayes factor, which no order of drawing changes.

    1-sigma of the share over seeds is 0.004 with 6,400 sweeps, and nothing for a single slot.
    """
    dense = replace(
        catalogue_problem(0, terms=1, strength=0.0),
        unknowns=replace(FEW, noise=(axis(1.0),), widening=((1.0,),), log_widening=(0.0,)),
    )
    gain = SpikeSlab(dense.design, dense.unknowns, single(1), SIZES).log_odds(GridPoint((0,), 0), ())
    level = 1.0 / (1.0 + slots * float(np.exp(np.logaddexp.reduce(gain[:, 0]))))
    richness = Richness((level,), (0.0,), slots)  # about as likely as not
    problem = SpikeSlab(dense.design, dense.unknowns, single(1), SIZES)
    odds = slots * level / (1.0 - level) * float(np.exp(np.logaddexp.reduce(gain[:, 0])))
    found = sample(problem, richness, seed=5, rounds=80)
    assert 0.4 < odds / (1.0 + odds) < 0.65
    assert shares(found, 1)[0] == pytest.approx(odds / (1.0 + odds), abs=0.02)


# -- seeds, starts, order -----------------------------------------------------------------------------------


def test_two_starts_agree_in_any_order_of_terms(long: None) -> None:
    """One starts from the likeliest set, the other from half of it."""
    dense, order = catalogue_problem(1), [3, 5, 0, 4, 1, 2]
    one = _run(1, 2)
    other = sample(spike_slab(reordered(dense, order)), RICHNESS, seed=9, rounds=LONG)
    np.testing.assert_allclose(shares(other), shares(one)[order], atol=0.03)
    for found in (one, other):
        assert found.disagreement <= 0.03


def test_chains_that_disagree_go_on_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    dense, told = catalogue_problem(1), {}
    for rounds, agreed in ((1, -1.0), (3, -1.0), (3, 1.0)):  # two chains may agree exactly by chance
        monkeypatch.setattr(chains, "AGREED", agreed)
        told[rounds, agreed] = sample(spike_slab(dense), RICHNESS, seed=1, rounds=rounds)
    first, more, content = told.values()
    assert more.sweeps == 3 * first.sweeps == 3 * content.sweeps
    assert first.disagreement == content.disagreement > 0.0


@pytest.mark.parametrize(
    "kinds", by_day([[0, 0, 0, 0, 0, 0], [0, 1, 0, 1, 0, 1], [0, 0, 1, 1, 2, 2]], [0, 1, 0, 1, 0, 1])
)
def test_causes_of_one_kind_are_likelier_together(long: None, kinds: list[int]) -> None:
    """Every set counted with urns written out, for causes of few kinds, which are exchanged whole."""
    dense = catalogue_problem(1, strength=1.0)
    problem = spike_slab(dense, single(*[1] * TERMS, kinds=kinds))
    exact = enumerated(problem, RICHNESS, dense)
    assert np.any((exact.terms > 0.1) & (exact.terms < 0.9))
    found = sample(problem, RICHNESS, seed=6, rounds=LONG)
    np.testing.assert_allclose(shares(found), exact.terms, atol=0.02)


@pytest.mark.parametrize("ratio", [1.0, 8.0])
def test_regions_that_no_chain_crosses_between_are_weighed_by_their_evidence(ratio: float) -> None:
    """Two chains that stand still each in a region of its own: their shares are those of all states counted."""
    dense = catalogue_problem(5, alike=0.9999, strength=0.0)
    signal = np.random.default_rng(4).standard_normal(len(dense.e)) + 3.0 * dense.g[:, 0]
    terms = single(*[1] * TERMS)
    rarer = replace(terms.all[1], log_share=-float(np.log(ratio)))
    problem = spike_slab(replace(dense, e=signal), Terms([terms.all[0], rarer, *terms.all[2:]], terms.urn))
    exact = enumerated(problem, RICHNESS, replace(dense, e=signal))
    logs, exactly = [], []
    for k in (0, 1):
        part = problem.conditioned([(k, 1)])
        counted = Chains(part, RICHNESS, [Chain(part, RICHNESS, ALL, GridPoint((1,), 0), (), 3)])
        for _ in range(2000):
            counted.run()
        logs.append(float(counted.log_evidences.mean()))
        exactly.append(
            np.log(sum(p for (members, _), p in exact.states.items() if dict(members).get(k) == 1))
        )
    assert max(exactly) > np.log(0.1)
    assert logs[0] - logs[1] == pytest.approx(exactly[0] - exactly[1], abs=0.1)


# -- states ---------------------------------------------------------------------------------------------------


def test_terms_that_exclude_each_other_never_stand_together() -> None:
    """A cause that takes one term alone, and terms with a column in common."""
    dense = catalogue_problem(0, strength=2.0)
    spans = [(0, 0, (0,)), (1, 0, (1,)), (2, 1, (2, 3)), (3, 2, (3,)), (4, 3, (4,)), (5, 4, (4, 5))]
    terms = Terms(
        [Term(own, cause, k, 0.0, (-np.inf,) * len(own), (np.inf,) * len(own)) for k, cause, own in spans],
        single(*[1] * 6, causes=[0, 0, 1, 2, 3, 4]).urn,
    )
    problem = spike_slab(dense, terms)
    chain = Chain(problem, Richness((0.5,), (0.0,), 8), ALL, GridPoint((1,), 0), (), 1)
    counts = set()
    for sweep in chain.sweeps(300):
        own = [term for term, _ in sweep.members]
        assert len({spans[k][1] for k in own}) == len(own)
        columns = [c for k in own for c in spans[k][2]]
        assert len(set(columns)) == len(columns)
        counts.add(len(own))
    assert len(counts) > 1


def test_the_mode_holds_what_is_likelier_there_than_not() -> None:
    """Of all states visited none agrees better with the probabilities, and what is sure is in it."""
    for seed in range(6):
        dense = catalogue_problem(seed)
        problem = spike_slab(dense)
        found = sample(problem, RICHNESS, seed=1)
        best = mode(found, problem)
        assert best in [state for state, _ in found.states]
        held = {int(problem.terms.cause[term]) for term, _ in best.members}
        assert {k for k in range(len(found.causes)) if found.causes[k] > 0.9} <= held
        for k in held:
            assert found.slots[k] > 0.5
        assert best.log_posterior == pytest.approx(log_posterior(problem, RICHNESS, best.members, best.point))


def test_of_two_that_stand_in_for_each_other_the_mode_holds_one() -> None:
    """Together they are sure, each alone is not."""
    dense = catalogue_problem(5, alike=0.999)
    e = np.random.default_rng(4).standard_normal(len(dense.e)) + 1.2 * dense.g[:, 0]
    problem = spike_slab(replace(dense, e=e))
    found = sample(problem, RICHNESS, seed=1)
    first, second = sorted(found.causes[:2])[::-1]
    assert second < 0.5 and first < 0.9 < found.slots[np.argmax(found.causes)]
    assert len({0, 1} & {int(problem.terms.cause[t]) for t, _ in mode(found, problem).members}) == 1


def test_a_known_state_may_hold_what_is_hopeless_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Terms that are hopeless are left out of the chains, but for those of the state that these start from."""
    problem = spike_slab(catalogue_problem(1))
    monkeypatch.setattr(finding, "HOPELESS", -1e3)
    point = best_point(problem)
    known = State(((0, int(np.argmax(problem.noticeable[:, 0]))),), point, 0.0)
    monkeypatch.setattr(chains, "tops", lambda *_: [known])
    assert set(sample(problem, RICHNESS, rounds=1).terms) == {0}


def test_what_stands_in_for_a_term_is_told_beside_it(long: None) -> None:
    """Of two columns that are nearly the same either may be there: each is the other's likeliest rival."""
    dense = catalogue_problem(5, alike=0.999)
    e = np.random.default_rng(4).standard_normal(len(dense.e)) + 1.2 * dense.g[:, 0]
    found = sample(spike_slab(replace(dense, e=e)), RICHNESS, seed=1, rounds=LONG)
    assert np.argmax(found.beside[0] * (np.arange(TERMS) != 0)) == 1
    for one, other in ((0, 1), (1, 0)):
        assert 0.2 < found.beside[one, other] / found.beside[one, one] < 5.0
        assert found.beside[one, other] > 0.2
    assert np.all(found.beside.sum(axis=1) <= 1.0 + 1e-9)
    assert 0.9 < found.causes[0] + found.causes[1] < 1.3  # both may be there


def test_a_seed_has_one_answer() -> None:
    dense = catalogue_problem(2)
    one, same = (sample(spike_slab(dense), RICHNESS, seed=7) for _ in range(2))
    assert one.terms == same.terms and one.points == same.points and one.disagreement == same.disagreement
    assert [(s.members, share) for s, share in one.states] == [(s.members, share) for s, share in same.states]
    other = sample(spike_slab(dense), RICHNESS, seed=8)
    assert other.terms != one.terms


def test_the_answer_is_that_of_two_chains_by_themselves() -> None:
    """From the mode and from half of it, after as many sweeps that do not count: the mean of theirs."""
    problem = spike_slab(catalogue_problem(4))
    found, top = sample(problem, RICHNESS, seed=5, rounds=1), tops(problem, RICHNESS)[0]
    around = plausible(problem, RICHNESS, [top])
    assert around.terms.all() and not around.certain and len(top.members) > 1
    causes = []
    for k, start in enumerate((top.members, top.members[::2])):
        chain = Chain(problem, RICHNESS, around.widenings, top.point, start, 5 + k)
        sweeps = list(chain.sweeps(chains.BURN + chains.ROUND))[chains.BURN :]
        terms = np.mean([np.sum([v.terms for v in sweep.visits], axis=0) for sweep in sweeps], axis=0)
        causes.append(np.minimum(terms, 1.0))  # sums over slots are a mean of 1 at most, but for chance
    np.testing.assert_allclose(found.causes, np.mean(causes, axis=0), atol=1e-9)  # both are in one region
    assert found.disagreement == pytest.approx(float(np.max(np.abs(causes[0] - causes[1]))), abs=1e-9)
