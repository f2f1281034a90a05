"""Names of the likeliest set: their classes, what has no name beside them, their levels, what is said and what leads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from support.searched_arm import PLAY, SCALE, held, sums_of
from truepose.identification.diagnosis.naming import named, summarised
from truepose.identification.diagnosis.posterior_summary import Named
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.state import State, supports
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.placed import EffectAtPlace

# -- one name, its class, and what has no name in its stead -------------------------------------------------------

PLAYED, SCALED = EffectAtPlace("backlash", ("q2",)), EffectAtPlace("actuator-scale", ("q1",))
OTHER, FAINT = EffectAtPlace("friction-hysteresis", ("q2",)), EffectAtPlace("backlash", ("q1",))
FORM = EffectAtPlace(Empirical.slug, ("q2",))
BESIDE = {PLAYED: 0.6, OTHER: 0.3, FAINT: 0.01}
Shares = Mapping[tuple[EffectAtPlace, ...], float]


def posed(shares: Shares, beside: Mapping[EffectAtPlace, float] = BESIDE) -> Found:
    """Play and a scale in the mode; states of these causes have these shares, and the slot of the play holds ``beside``."""
    _, found = held(PLAY, SCALE)
    problem, n = found.problem, len(found.problem.causes)
    table, causes = np.zeros((n, n)), np.zeros(n)
    row, states = problem.causes.index(PLAYED), list[tuple[State, float]]()
    for other, share in beside.items():
        table[row, problem.causes.index(other)] = share
    for there, share in shares.items():
        numbers = [problem.causes.index(one) for one in there]
        members = tuple(sorted((_term(found, number), 5) for number in numbers))
        states.append((State(members, found.mode.point, 0.0), share))
        causes[numbers] += share
    posterior = replace(found.posterior, causes=causes, beside=table, states=tuple(states))
    return replace(found, posterior=posterior)


def _term(found: Found, number: int) -> int:
    """A term of a cause, of what has no name the one that the side of arrival drives."""
    own = np.flatnonzero(found.problem.spike_slab.terms.cause == number).tolist()
    arrives = [t for t in own if found.catalogue.candidates[found.problem.candidates[t]].kind == "arrival"]
    return int((arrives or own)[0])


def play(found: Found) -> Named:
    """The name that the play of the mode has, or what has none in its stead."""
    wanted = [i for i in found.accepted if found.catalogue.cause(i) == PLAYED]
    return next(n for n in named(found, sums_of(found)) if set(n.candidates) == set(wanted))


def test_a_class_is_the_laws_of_a_slot_and_each_has_the_share_of_the_states_that_hold_it() -> None:
    """What holds less than a fiftieth of the slot belongs to no class."""
    one = play(posed({(PLAYED, SCALED): 0.6, (OTHER, SCALED): 0.3, (FAINT, SCALED): 0.01, (SCALED,): 0.09}))
    assert one.cause == PLAYED and (one.probability, one.certainty) == pytest.approx((0.6, 0.9))
    (other,) = one.equivalents
    assert (other.cause, other.tested) == (OTHER, True)
    assert (other.probability, other.gain - one.gain) == pytest.approx((0.3, np.log(0.5)))


def test_a_class_is_never_surer_than_certain() -> None:
    """States that hold two of its laws count once."""
    one = play(posed({(PLAYED, OTHER): 0.7, (PLAYED,): 0.2, (OTHER,): 0.1}))
    assert one.probability == pytest.approx(0.9) and one.certainty == pytest.approx(1.0)
    assert [m.probability for m in one.equivalents] == pytest.approx([0.8])


@pytest.mark.parametrize(("alone", "beside"), [(0.5, 0.3), (0.6, 0.01), (0.9, 0.0)])
def test_where_something_without_a_name_is_at_its_part_a_law_does_not_hold(
    alone: float, beside: float
) -> None:
    """Its driver is known, and what it is is not: that is another explanation, where it is worth a word."""
    one = play(posed({(PLAYED,): alone, (PLAYED, FORM): beside, (): 1.0 - alone - beside}))
    assert one.cause == PLAYED and (one.probability, one.certainty) == pytest.approx((alone, alone))
    assert one.levels.driver == pytest.approx(alone + beside)
    told = {m.cause: m.probability for m in one.equivalents if m.cause != OTHER}
    assert told == ({FORM: pytest.approx(beside)} if beside > 0.02 else {})


def test_what_is_likelier_without_a_law_than_with_it_has_no_name() -> None:
    """The law stands beside it, as probable as it is."""
    one = play(posed({(PLAYED,): 0.3, (PLAYED, FORM): 0.5, (OTHER,): 0.05, (): 0.15}))
    assert one.nameless and one.said and (one.cause, one.probability) == (FORM, 0.0)
    assert one.certainty == pytest.approx(0.35)
    assert one.levels.kind == "arrival" and one.levels.driver == pytest.approx(0.85)
    assert [m.cause for m in one.equivalents] == [PLAYED, OTHER]
    assert [m.probability for m in one.equivalents] == pytest.approx([0.3, 0.05])


def test_names_have_the_evidence_of_the_mode_with_them_and_without_and_stand_by_it() -> None:
    """What would stand in a name's slot has its own, as much less as it is rarer there."""
    found = posed({(PLAYED, SCALED): 0.9, (OTHER, SCALED): 0.1}, {PLAYED: 0.9, OTHER: 0.05})
    slab, members = found.problem.spike_slab, found.mode.members
    told = named(found, sums_of(found))
    assert {n.cause for n in told} == {PLAYED, SCALED}
    assert [n.gain for n in told] == sorted((n.gain for n in told), reverse=True)
    for one in told:
        at = [k for k, m in enumerate(members) if found.problem.candidates[m[0]] in one.candidates]
        (gain,) = supports(slab, found.mode, [np.array(at)])
        assert one.gain == pytest.approx(gain)
        for other in one.equivalents:
            assert other.gain == pytest.approx(gain + np.log(0.05 / 0.9))


def test_a_cause_has_one_probability_wherever_it_is_told() -> None:
    """A rival that is likelier beside a name than in its stead is told as likely as it is; a name is nobody's rival."""
    slot = {PLAYED: 0.6, OTHER: 0.2, SCALED: 0.2}
    found = posed({(PLAYED, OTHER): 0.4, (PLAYED, SCALED): 0.2, (OTHER,): 0.15, (SCALED,): 0.25}, slot)
    one, listed = play(found), sums_of(found).inclusion().places
    assert [m.cause for m in one.equivalents] == [OTHER]
    assert one.equivalents[0].probability == pytest.approx(0.55) == listed[OTHER]
    assert one.certainty == pytest.approx(0.75)  # the scale has the rest for itself
    assert one.probability == pytest.approx(0.6) == listed[PLAYED]
    assert list(listed.values()) == sorted(listed.values(), reverse=True)


def test_forms_are_told_where_no_name_speaks_of_their_part_and_driver() -> None:
    """The best supported first, from one chance in two of the driver at the part on."""
    case, _ = held(PLAY, SCALE)
    forms = {(c.place, c.kind): c.label for i, c in enumerate(case.cat.candidates) if not case.cat.named(i)}
    own, coupled = forms[("q1",), "position"], forms[("q2",), "coupling"]

    def told(found: Found, share: float = 1.0, *less: str) -> list[Named]:
        """What has no name where the mode has this share, and the rest is the mode of ``less`` alone."""
        kept = [m for m in found.mode.members if label(found, m[0]) in less]
        states = (found.mode, share), (replace(found.mode, members=tuple(kept)), 1.0 - share)
        posed_ = replace(found, posterior=replace(found.posterior, states=states))
        return [n for n in named(posed_, sums_of(posed_)) if n.nameless]

    def label(found: Found, term: int) -> str:
        return found.catalogue.candidates[found.problem.candidates[term]].label

    spoken = case.holding("actuator-scale@q1", own, coupled)
    assert [n.cause.place for n in told(spoken, 0.4, "actuator-scale@q1", coupled)] == [("q2",)]
    both = told(spoken)  # with a form at its part in every state the scale is none
    assert {n.cause.place for n in both} == {("q1",), ("q2",)}
    free = case.holding(own, coupled)
    both = told(free)
    assert {n.cause.place for n in both} == {("q1",), ("q2",)} and both[0].gain > both[1].gain
    assert {n.levels.kind for n in both} == {"position", "coupling"}
    assert all(n.probability == n.certainty == 0.0 and n.levels.driver == 1.0 for n in both)
    assert len(told(free, 0.51)) == 2 and told(free, 0.49) == []


# -- what is said, what leads -------------------------------------------------------------------------------------


def test_levels_are_sums_over_states_and_no_deeper_one_is_larger() -> None:
    """A state with a form at the same place knows the place, one with the same driver there knows that."""
    _, found = held(PLAY, SCALE)
    cause = found.problem.spike_slab.terms.cause.tolist()
    term = {c: cause.index(found.problem.causes.index(c)) for c in (PLAYED, OTHER)}
    at_q2 = next(
        t
        for t, i in enumerate(found.problem.candidates)
        if found.catalogue.cause(i) == EffectAtPlace("encoder-eccentricity", ("q2",))
    )
    states = tuple(
        (State(((t, 5),) if t >= 0 else (), found.mode.point, 0.0), share)
        for t, share in ((term[PLAYED], 0.3), (term[OTHER], 0.25), (at_q2, 0.2), (-1, 0.25))
    )
    seen = sums_of(replace(found, posterior=replace(found.posterior, states=states)))
    for law, place, driver in ((0.3, 0.75, 0.55), (0.6, 0.75, 0.6), (0.8, 0.8, 0.8)):
        levels = seen.levels(PLAYED, "arrival", law)
        assert levels.kind == "arrival"
        assert (levels.place, levels.driver) == pytest.approx((place, driver))
    assert seen.at(("q1",)) == 0.0 and seen.at((), None) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("shares", "told"),
    [
        ({"q1": 0.5, "q2": 0.45}, (("q1", "q2"), 0.95)),
        ({"q1": 0.45, "q2": 0.5}, (("q2", "q1"), 0.95)),
        ({"q1": 0.5, "q2": 0.38}, None),
        ({"q1": 0.91, "q2": 0.05}, None),
        ({"q1": 0.895, "q2": 0.015}, None),
    ],
)
def test_a_driver_that_surely_acts_somewhere_is_told_with_its_places(
    shares: Mapping[str, float], told: tuple[tuple[str, ...], float] | None
) -> None:
    """Likeliest first; not where one place is sure by itself, nor where only one is worth a word."""
    _, found = held(PLAY, SCALE)
    cause = found.problem.spike_slab.terms.cause.tolist()
    number = {place: found.problem.causes.index(EffectAtPlace("backlash", (place,))) for place in shares}
    states = [
        (State(((cause.index(number[place]), 5),), found.mode.point, 0.0), share)
        for place, share in shares.items()
    ]
    states.append((State((), found.mode.point, 0.0), 1.0 - sum(shares.values())))
    found_ = sums_of(replace(found, posterior=replace(found.posterior, states=tuple(states)))).together()
    assert [(one.driver, one.places) for one in found_] == ([] if told is None else [("arrival", told[0])])
    assert [one.probability for one in found_] == pytest.approx([] if told is None else [told[1]])


@pytest.mark.parametrize(
    ("share", "told", "leads"), [(0.9, True, False), (0.2, False, True), (0.08, False, False)]
)
def test_what_is_less_probable_than_not_leads_from_a_tenth_on(share: float, told: bool, leads: bool) -> None:
    found = posed({(PLAYED, SCALED): share, (SCALED,): 1.0 - share}, {PLAYED: share})
    said = summarised(found, found.fit)
    assert (PLAYED in [n.cause for n in said.names]) is told
    assert (PLAYED in [n.cause for n in said.leading]) is leads
    assert SCALED in [n.cause for n in said.laws]


def test_what_bounds_left_nothing_of_is_not_told() -> None:
    """A term of the likeliest set that its fit does not hold."""
    _, found = held(PLAY, SCALE)
    only = replace(found.fit, effects=tuple(e for e in found.fit.effects if e.at_place == SCALED))
    assert [n.cause for n in summarised(found, only).laws] == [SCALED]


def test_the_likeliest_sets_are_told_and_what_is_likelier_than_a_hundredth() -> None:
    """States of the same causes are one set; what has no name is summed over the sets, and no law holds beside it."""
    found = posed(
        {
            (PLAYED, SCALED): 0.3,
            (PLAYED, FORM): 0.2,
            (PLAYED,): 0.25,
            (FAINT,): 0.009,
            (OTHER,): 0.011,
            (): 0.13,
        }
    )
    (state, share), *others = found.posterior.states
    again = replace(state, members=tuple((term, 6) for term, _ in state.members))
    states = ((state, share), (again, 0.1), *others)
    causes = found.posterior.causes.copy()
    causes[[found.problem.causes.index(one) for one in (PLAYED, SCALED)]] = 0.85, 0.4
    said = sums_of(
        replace(found, posterior=replace(found.posterior, states=states, causes=causes))
    ).inclusion()
    law = 0.85 * (0.4 + 0.25) / (0.4 + 0.25 + 0.2)
    assert said.places == pytest.approx({PLAYED: law, SCALED: 0.4, FORM: 0.2, OTHER: 0.011})
    assert list(said.places.values()) == sorted(said.places.values(), reverse=True)
    assert {(frozenset(s.effects), round(s.probability, 9)) for s in said.sets} == {
        (frozenset({PLAYED, SCALED}), 0.4),
        (frozenset({PLAYED}), 0.25),
        (frozenset({PLAYED, FORM}), 0.2),
        (frozenset(), 0.13),
        (frozenset({OTHER}), 0.011),
        (frozenset({FAINT}), 0.009),
    }
    assert [s.probability for s in said.sets] == sorted((s.probability for s in said.sets), reverse=True)
    assert said.nameless == pytest.approx(0.2)
