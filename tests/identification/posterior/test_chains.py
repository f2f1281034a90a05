"""Laws of the chains over sets: what every set weighs when all are counted, starts, seeds, order of terms, exclusions.

Where a probability is compared with the exact one, both chains are 1,400 sweeps long: its standard error is about 0.007.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from support.linear_problems import (
    FEW,
    RICHNESS,
    SIZES,
    Dense,
    axis,
    catalogue_problem,
    enumerated,
    reordered,
    single,
)
from truepose.identification.posterior import posterior as chains
from truepose.identification.posterior import sampler
from truepose.identification.posterior.mode import State, log_posterior
from truepose.identification.posterior.posterior import Posterior, class_probability, mode, sample
from truepose.identification.posterior.sampler import Chain, Passage, Richness
from truepose.identification.posterior.terms import Term, Terms
from truepose.identification.posterior.weighing import Weighing

Array = NDArray[np.float64]
TERMS = 6


@pytest.fixture
def long(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chains that do not stop as soon as they agree."""
    monkeypatch.setattr(chains, "ROUNDS", 35)
    monkeypatch.setattr(chains, "AGREED", -1.0)  # two chains may agree exactly by chance


def weighing(dense: Dense, terms: Terms | None = None) -> Weighing:
    return Weighing(dense.design, dense.unknowns, single(*[1] * TERMS) if terms is None else terms, SIZES)


def shares(found: Posterior, count: int = TERMS) -> Array:
    """(c,) probability of each term; those left out of the chains have none."""
    return np.array([found.terms.get(k, 0.0) for k in range(count)])


def visited(found: Posterior) -> Array:
    """(c,) the same by how often the chains held each term."""
    out = np.zeros(TERMS)
    for state, share in found.states:
        out[[term for term, _ in state.members]] += share
    return out


# -- against counting every set ---------------------------------------------------------------------------


@pytest.mark.parametrize(("problem", "seed"), [(0, 1), (1, 2), (2, 3)])
def test_probabilities_are_those_of_all_sets_counted(long: None, problem: int, seed: int) -> None:
    """Sets, sizes, noise, tolerances and remainder; what slots were drawn from, and what they held."""
    dense = catalogue_problem(problem)
    exact = enumerated(weighing(dense), RICHNESS, dense)
    assert np.any((exact.terms > 0.1) & (exact.terms < 0.9))  # nothing is learnt from what is certain
    found = sample(weighing(dense), RICHNESS, seed=seed)
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


@pytest.mark.parametrize("alone", [True, False])
def test_causes_of_several_terms_are_counted_right(long: None, alone: bool) -> None:
    """Terms of one cause exclude each other, or a second one costs less than a first."""
    dense = catalogue_problem(1)
    problem = weighing(dense, single(*[1] * TERMS, causes=[0, 0, 1, 1, 2, 3], alone=alone))
    exact = enumerated(problem, RICHNESS, dense)
    found = sample(problem, RICHNESS, seed=4)
    np.testing.assert_allclose(shares(found), exact.terms, atol=0.02)
    if alone:
        for state, _ in found.states:
            causes = [int(problem.terms.cause[term]) for term, _ in state.members]
            assert len(set(causes)) == len(causes)
    else:
        assert sum(share for key, share in exact.sets.items() if {0, 1} <= set(key)) > 0.02  # it happens


@pytest.mark.parametrize("slots", [1, 3, 24])
def test_one_term_is_as_probable_as_its_odds_in_however_many_slots(
    monkeypatch: pytest.MonkeyPatch, long: None, slots: int
) -> None:
    """A single term of known gain: the odds are the prior's times the Bayes factor, which no order of drawing changes.

    1-sigma of the share over seeds is 0.009 with 2,800 sweeps; four times as many make 0.02 a limit that chance keeps to.
    """
    monkeypatch.setattr(chains, "ROUNDS", 140)
    dense = replace(
        catalogue_problem(0, terms=1, strength=0.0),
        unknowns=replace(FEW, noise=(axis(1.0),), widening=((1.0,),), log_widening=(0.0,), size=axis(0.0)),
    )
    gain = Weighing(dense.design, dense.unknowns, single(1), SIZES).log_odds((0, 0, 0), ())
    level = 1.0 / (1.0 + slots * float(np.exp(np.logaddexp.reduce(gain[:, 0]))))
    richness = Richness((level,), (0.0,), slots)  # about as likely as not
    problem = Weighing(dense.design, dense.unknowns, single(1), SIZES)
    odds = slots * level / (1.0 - level) * float(np.exp(np.logaddexp.reduce(gain[:, 0])))
    found = sample(problem, richness, seed=5)
    assert 0.4 < odds / (1.0 + odds) < 0.65
    assert shares(found, 1)[0] == pytest.approx(odds / (1.0 + odds), abs=0.02)


# -- seeds, starts, order -----------------------------------------------------------------------------------


def test_a_seed_has_one_answer() -> None:
    dense = catalogue_problem(2)
    one, same = (sample(weighing(dense), RICHNESS, seed=7) for _ in range(2))
    assert one.terms == same.terms and one.points == same.points and one.disagreement == same.disagreement
    assert [(s.members, share) for s, share in one.states] == [(s.members, share) for s, share in same.states]
    other = sample(weighing(dense), RICHNESS, seed=8)
    assert other.terms != one.terms


def test_two_starts_agree_in_any_order_of_terms(long: None) -> None:
    """One starts from the likeliest set, the other from nothing by way of heated odds."""
    dense, order = catalogue_problem(1), [3, 5, 0, 4, 1, 2]
    one, other = (sample(weighing(d), RICHNESS, seed=9) for d in (dense, reordered(dense, order)))
    np.testing.assert_allclose(shares(other), shares(one)[order], atol=0.03)
    for found in (one, other):
        assert found.disagreement <= 0.03


def test_chains_that_disagree_go_on_and_say_so(monkeypatch: pytest.MonkeyPatch) -> None:
    dense, told = catalogue_problem(1), {}
    learning = chains.LEARNING  # rounds that do not count, for the chains learn ways from them
    for rounds, agreed in ((1, 0.0), (3 + learning, 0.0), (3 + learning, 1.0)):
        monkeypatch.setattr(chains, "ROUNDS", rounds)
        monkeypatch.setattr(chains, "AGREED", agreed)
        told[rounds, agreed] = sample(weighing(dense), RICHNESS, seed=1)
    first, more, content = told.values()
    assert more.sweeps == 3 * first.sweeps == 3 * content.sweeps
    assert content.mixed
    monkeypatch.setattr(chains, "AGREED", -1.0)  # two chains may agree exactly by chance
    assert not more.mixed


def test_passages_lead_between_sets_in_their_proportion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two pairs explain nearly the same, and no single term does: from one to the other two must change at once.

    1-sigma of the share over seeds is about 0.02 with 1,500 sweeps.
    """
    dense, rng = catalogue_problem(0), np.random.default_rng(8)
    u, v, w, *others = np.linalg.qr(rng.standard_normal((len(dense.e), TERMS)))[0].T
    pairs = np.column_stack(
        [15.0 * u + 99.0 * v, 15.0 * u - 99.0 * v, 15.0 * u + 99.0 * w, 15.0 * u - 99.0 * w]
    )
    e = 15.0 * u + 0.9 * w + rng.standard_normal(len(dense.e))
    problem = replace(dense, g=np.column_stack([pairs, 1e-6 * others[0], 1e-6 * others[1]]), e=e)
    exact = enumerated(weighing(problem), RICHNESS, problem)
    assert 0.15 < exact.terms[0] < 0.85
    assert exact.sets[0, 1] + exact.sets[2, 3] > 0.8
    point, ends = (1, 0, 0), (((0, 1), (1, 1)), ((2, 1), (3, 1)))
    monkeypatch.setattr(sampler, "PAIRS", 0)  # no exchanges, which would do here
    caught = Chain(weighing(problem), RICHNESS, point, ends[0], 3)
    free = Chain(weighing(problem), RICHNESS, point, ends[0], 3)
    free.passages = (Passage.between((ends[0], point), (ends[1], point)),)
    held = [np.mean([0 in dict(s.members) for s in chain.sweeps(1500)]) for chain in (caught, free)]
    assert held[0] > 0.99
    assert held[1] == pytest.approx(exact.terms[0], abs=0.08)


def test_a_column_of_noise_leaves_the_others_as_they_are(long: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """A further term that says nothing takes at most the prior of a term: the others move by less than 0.04."""
    monkeypatch.setattr(chains, "ROUNDS", 25)
    dense = catalogue_problem(2)
    noise = np.random.default_rng(11).standard_normal((len(dense.e), 1))
    more = replace(dense, g=np.column_stack([dense.g, noise]))
    each = -float(np.log(TERMS))
    free = [Term((k,), k, each, each, (-np.inf,), (np.inf,)) for k in range(TERMS + 1)]
    one = sample(weighing(dense, Terms(free[:-1])), RICHNESS, seed=3)
    other = sample(weighing(more, Terms(free)), RICHNESS, seed=3)
    np.testing.assert_allclose(shares(other), shares(one), atol=0.04)


# -- states ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("heat", [1.0, 3.0])
def test_terms_that_exclude_each_other_never_stand_together(heat: float) -> None:
    """A cause that takes one term alone, and terms with a column in common."""
    dense = catalogue_problem(0, strength=2.0)
    spans = [(0, 0, (0,)), (1, 0, (1,)), (2, 1, (2, 3)), (3, 2, (3,)), (4, 3, (4,)), (5, 4, (4, 5))]
    terms = Terms(
        [Term(own, cause, -1.0, -0.5, (-np.inf,) * len(own), (np.inf,) * len(own)) for _, cause, own in spans]
    )
    problem = weighing(dense, terms)
    chain = Chain(problem, Richness((0.5,), (0.0,), 8), (1, 0, 0), (), 1)
    chain.heat = heat
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
        problem = weighing(dense)
        found = sample(problem, RICHNESS, seed=1)
        best = mode(found, problem)
        assert best in [state for state, _ in found.states]
        held = {int(problem.terms.cause[term]) for term, _ in best.members}
        assert {k for k in range(len(found.causes)) if found.causes[k] > 0.9} <= held
        for k in held:
            assert found.causes[k] > 0.5 or class_probability(found, k) > 0.8
        assert best.log_posterior == pytest.approx(log_posterior(problem, RICHNESS, best.members, best.point))


def test_of_two_that_stand_in_for_each_other_the_mode_holds_one() -> None:
    """Together they are sure, each alone is not."""
    dense = catalogue_problem(5, alike=0.999)
    e = np.random.default_rng(4).standard_normal(len(dense.e)) + 1.2 * dense.g[:, 0]
    problem = weighing(replace(dense, e=e))
    found = sample(problem, RICHNESS, seed=1)
    first, second = sorted(found.causes[:2])[::-1]
    assert second < 0.5 and first < 0.9 < class_probability(found, int(np.argmax(found.causes)))
    assert len({0, 1} & {int(problem.terms.cause[t]) for t, _ in mode(found, problem).members}) == 1


def test_a_known_state_may_hold_what_is_hopeless_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """Terms that are hopeless are left out of the chains, but for those of the state that these start from."""
    problem = weighing(catalogue_problem(1))
    monkeypatch.setattr(chains, "HOPELESS", 0.0)
    monkeypatch.setattr(chains, "ROUNDS", 1)
    point = chains.best_point(problem)
    known = State(((0, int(np.argmax(problem.noticeable[:, 0]))),), point, 0.0)
    monkeypatch.setattr(chains, "climbed_tops", lambda *_: [known])
    assert set(sample(problem, RICHNESS).terms) == {0}


def test_the_likeliest_of_a_class_stands_for_it_whoever_leads_there() -> None:
    """The slot of the less likely one holds both for certain; that of the likelier one may hold other things as well."""
    states = tuple((State(((term, 0),), (0,), 0.0), share) for term, share in ((0, 0.6), (1, 0.4)))
    beside = np.array([[0.54, 0.2], [0.1, 0.9]])
    found = Posterior({}, np.array([0.79, 0.47]), beside, states, (), 0.0, 1)
    problem = cast(Weighing, SimpleNamespace(terms=SimpleNamespace(cause=np.arange(2))))
    assert [term for term, _ in mode(found, problem).members] == [0]


def test_what_stands_in_for_a_term_is_told_beside_it(long: None) -> None:
    """Of two columns that are nearly the same either may be there: each is the other's likeliest rival."""
    dense = catalogue_problem(5, alike=0.999)
    e = np.random.default_rng(4).standard_normal(len(dense.e)) + 1.2 * dense.g[:, 0]
    found = sample(weighing(replace(dense, e=e)), RICHNESS, seed=1)
    assert np.argmax(found.beside[0] * (np.arange(TERMS) != 0)) == 1
    for one, other in ((0, 1), (1, 0)):
        assert 0.2 < found.beside[one, other] / found.beside[one, one] < 5.0
        assert found.beside[one, other] > 0.2
    assert np.all(found.beside.sum(axis=1) <= 1.0 + 1e-9)
    assert 0.9 < found.causes[0] + found.causes[1] < 1.3  # both may be there
