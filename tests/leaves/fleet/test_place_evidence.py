"""What a fleet is told of a recording: Bayes factors free of the prior, shares among rivals, sizes of what is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import logit

from support.searched_arm import PLAY, SCALE, held
from truepose.arrays import Array
from truepose.identification.diagnosis.posterior_summary import Inclusion
from truepose.identification.diagnosis.search import Found
from truepose.identification.leaves.fleet.place_evidence import PlaceEvidence, evidence
from truepose.identification.posterior.state import State, slot_odds
from truepose.models.machine.placed import EffectAtPlace

PLAYS = EffectAtPlace("backlash", ("q1",)), EffectAtPlace("backlash", ("q2",))
TRUE = EffectAtPlace("actuator-scale", ("q1",)), PLAYS[1]


@pytest.fixture(scope="module")
def found() -> Found:
    return held(PLAY, SCALE)[1]


def posed(
    found: Found, *states: tuple[State, float], causes: Array | None = None, beside: Array | None = None
) -> Found:
    """With a posterior of these states."""
    n = len(found.problem.causes)
    own = np.zeros(n) if causes is None else causes
    alike = np.zeros((n, n)) if beside is None else beside
    return replace(found, posterior=replace(found.posterior, states=states, causes=own, beside=alike))


def told(
    found: Found, said: Mapping[EffectAtPlace, float] | None = None
) -> tuple[dict[EffectAtPlace, PlaceEvidence], dict[str, PlaceEvidence]]:
    places, anywhere = evidence(found, Inclusion(said or {}, (), 0.0))
    assert [EffectAtPlace(p.effect, p.place) for p in places] == list(found.problem.causes)
    assert all(p.place == () for p in anywhere)
    return {EffectAtPlace(p.effect, p.place): p for p in places}, {p.effect: p for p in anywhere}


def nothing(found: Found) -> State:
    return State((), found.mode.point, 0.0)


def holding(found: Found, *causes: EffectAtPlace, size: int = 5) -> State:
    """A state of the first term of each."""
    cause = found.problem.spike_slab.terms.cause.tolist()
    members = tuple((cause.index(found.problem.causes.index(c)), size) for c in causes)
    return State(members, found.mode.point, 0.0)


def every(case: tuple[dict[EffectAtPlace, PlaceEvidence], dict[str, PlaceEvidence]]) -> list[PlaceEvidence]:
    return [*case[0].values(), *case[1].values()]


def odds(p: float) -> float:
    return p / (1.0 - p)


# -- the prior that is taken out ----------------------------------------------------------------------------------


def test_prior_odds_of_all_causes_beside_nothing_are_those_of_a_slot(found: Found) -> None:
    """Of an effect at any place: one less the chance of none."""
    places, anywhere = told(posed(found, (nothing(found), 1.0)))
    whole = sum(odds(p.prior) for p in places.values())
    assert np.log(whole) == pytest.approx(slot_odds(found.problem.richness, 0))
    for slug, one in anywhere.items():
        own = [p.prior for cause, p in places.items() if cause.effect == slug]
        assert one.prior == pytest.approx(1.0 - np.prod(1.0 - np.array(own)))


def test_the_prior_of_a_cause_is_that_beside_all_others_of_a_state(found: Found) -> None:
    """Whether it is there itself says nothing; where one joint has play, another may."""
    both = told(posed(found, (holding(found, *TRUE), 1.0)))[0]
    for cause, other in (TRUE, TRUE[::-1]):
        without = told(posed(found, (holding(found, other), 1.0)))[0]
        assert both[cause].prior == pytest.approx(without[cause].prior)
    alone = told(posed(found, (nothing(found), 1.0)))[0]
    assert both[PLAYS[0]].prior > 1.5 * alone[PLAYS[0]].prior


def test_priors_are_means_over_the_states_by_their_shares(found: Found) -> None:
    states = nothing(found), holding(found, *TRUE)
    one, other = (told(posed(found, (state, 1.0))) for state in states)
    mixed = told(posed(found, (states[0], 0.75), (states[1], 0.25)))
    for found_, first, second in zip(*(every(case) for case in (mixed, one, other)), strict=True):
        assert found_.prior == pytest.approx(0.75 * first.prior + 0.25 * second.prior)
        noticed = [p.prior * (1.0 - p.unseen) for p in (found_, first, second)]
        assert noticed[0] == pytest.approx(0.75 * noticed[1] + 0.25 * noticed[2], abs=1e-12)


def test_sizes_that_nobody_would_notice_are_no_part_of_what_is_told(found: Found) -> None:
    """Their share of the prior, of each cause of one term; and of an effect at all its places."""
    slab = found.problem.spike_slab
    places, anywhere = told(posed(found, (nothing(found), 1.0)))
    shares = np.exp(slab.terms.log_sizes)
    seen = set[bool]()
    for k, (cause, one) in enumerate(places.items()):
        (terms,) = np.nonzero(slab.terms.cause == k)
        if len(terms) == 1:
            own = float(shares[slab.noticeable[:, terms[0]], terms[0]].sum())
            assert odds(one.prior * (1.0 - one.unseen)) == pytest.approx(own * odds(one.prior), rel=1e-9)
            seen |= {own < 0.999}
        assert cause.effect in anywhere
    assert True in seen
    for slug, whole in anywhere.items():
        noticed = [1.0 - p.prior * (1.0 - p.unseen) for c, p in places.items() if c.effect == slug]
        assert whole.prior * (1.0 - whole.unseen) == pytest.approx(1.0 - np.prod(noticed))


def test_a_bayes_factor_is_what_odds_are_beyond_those_of_the_prior(found: Found) -> None:
    """At the sizes that would be noticed; a chain tells no more than some hundred sweeps can."""
    n = len(found.problem.causes)
    causes = np.linspace(0.02, 0.98, n)
    places, _ = told(posed(found, (nothing(found), 1.0), causes=causes))
    told_of = list[float]()
    for p, one in zip(causes, places.values(), strict=True):
        assert one.probability == p
        if one.unseen == 1.0:
            assert one.log_bayes_factor == 0.0
            continue
        told_of.append(float(logit(p) - logit(one.prior * (1.0 - one.unseen))))
        assert abs(told_of[-1]) < 12.0 and one.log_bayes_factor == pytest.approx(told_of[-1])
    assert 0 < len(told_of) < n  # what would not be noticed at any size is neither for nor against
    sure, never = (told(posed(found, (nothing(found), 1.0), causes=np.full(n, p)))[0] for p in (1.0, 0.0))
    assert {p.log_bayes_factor for p in sure.values()} == {15.0, 0.0}
    assert {p.log_bayes_factor for p in never.values()} == {-12.0, 0.0}


# -- rivals -------------------------------------------------------------------------------------------------------


def test_rivals_share_the_credit_for_what_they_explain(found: Found) -> None:
    """By what their slots held; places of one effect are no rivals of that effect; what no slot held has none."""
    n, at = len(found.problem.causes), [found.problem.causes.index(c) for c in (*PLAYS, TRUE[0])]
    beside, causes = np.zeros((n, n)), np.full(n, 1e-9)
    beside[np.ix_(at, at)] = [[0.5, 0.3, 0.2], [0.1, 0.4, 0.0], [0.0, 0.0, 0.9]]
    causes[at[:2]] = 0.6, 0.2
    places, anywhere = told(posed(found, (nothing(found), 1.0), causes=causes, beside=beside))
    assert [places[found.problem.causes[k]].credit for k in at] == pytest.approx([0.5, 0.8, 1.0])
    others = [p.credit for k, p in enumerate(places.values()) if k not in at]
    assert others == [1.0] * (n - 3)
    assert anywhere["backlash"].credit == pytest.approx((0.6 * 0.8 + 0.2 * 1.0) / 0.8, rel=1e-6)
    assert anywhere[TRUE[0].effect].credit == pytest.approx(1.0)


def test_an_effect_is_anywhere_as_often_as_states_hold_it_at_some_place(found: Found) -> None:
    """Less what is only like it: as its likeliest place has it; never less than at one of them."""
    first, second, none = holding(found, PLAYS[0]), holding(found, PLAYS[1]), nothing(found)
    causes = np.zeros(len(found.problem.causes))
    causes[[found.problem.causes.index(c) for c in PLAYS]] = 0.3, 0.4
    case = posed(found, (first, 0.3), (second, 0.4), (none, 0.3), causes=causes)
    for said, expected in (
        ({}, 0.7),
        ({PLAYS[1]: 0.2}, 0.35),
        ({PLAYS[1]: 0.02}, 0.3),
        ({PLAYS[1]: 0.5}, 0.7),
        ({PLAYS[0]: 0.1}, 0.7),
    ):
        assert told(case, said)[1]["backlash"].probability == pytest.approx(expected)
    assert told(case)[1][TRUE[0].effect].probability == 0.0


# -- sizes --------------------------------------------------------------------------------------------------------


def test_sizes_are_told_of_what_may_be_there(found: Found) -> None:
    """From a fiftieth on; by the share of the states that hold each."""
    one, other = holding(found, TRUE[1], size=6), holding(found, TRUE[1], size=7)
    at = found.problem.causes.index(TRUE[1])
    for p, there in ((0.021, True), (0.019, False)):
        causes = np.zeros(len(found.problem.causes))
        causes[at] = p
        case = posed(found, (one, 0.3), (other, 0.1), (nothing(found), 0.6), causes=causes)
        places, anywhere = told(case)
        shares = places[TRUE[1]].sizes
        expected = np.zeros(len(found.problem.spike_slab.sizes.values))
        expected[[6, 7]] = 0.75, 0.25
        assert np.array(shares) == pytest.approx(expected) if there else shares == ()
        assert (places[TRUE[1]].size is not None) is there
        assert all(p.sizes == () and p.size is None for c, p in places.items() if c != TRUE[1])
        assert all(p.sizes == () and p.size is None for p in anywhere.values())


def test_amounts_of_states_are_averaged_with_what_they_differ_by(found: Found) -> None:
    """A mixture of two: the variance within and between them."""
    values = found.problem.spike_slab.sizes.values
    near, far = (int(np.argmin(np.abs(values - v))) for v in (1.0, 1e-2))
    states = [holding(found, TRUE[1], size=k) for k in (near, far)]
    causes = np.ones(len(found.problem.causes))
    sizes = [told(posed(found, (s, 1.0), causes=causes))[0][TRUE[1]].size for s in states]
    mixed = told(posed(found, (states[0], 2 / 3), (states[1], 1 / 3), causes=causes))[0][TRUE[1]].size
    assert mixed is not None and sizes[0] is not None and sizes[1] is not None
    share, means = np.array([2 / 3, 1 / 3]), np.array([s.log_mean for s in sizes if s is not None])
    centre = float(share @ means)
    assert abs(means[1] - means[0]) > 0.1
    assert mixed.log_mean == pytest.approx(centre)
    assert mixed.log_amount == pytest.approx(float(share @ [s.log_amount for s in sizes if s is not None]))
    within = float(share @ [s.log_std**2 for s in sizes if s is not None])
    assert mixed.log_std == pytest.approx(np.sqrt(within + float(share @ (means - centre) ** 2)))
