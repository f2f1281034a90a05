"""Names of the likeliest set: their classes and what is only like them, their levels, what is said and what leads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from support.searched_arm import PLAY, SCALE, held
from truepose.identification.diagnosis.naming import as_named, named, summarised
from truepose.identification.diagnosis.posterior_summary import Inclusion, Named, Presence, inclusion
from truepose.identification.diagnosis.search import Found
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.state import State, slot_odds, supports
from truepose.identification.prior import ONLY_ALIKE, beyond_usual
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.placed import EffectAtPlace

# -- one name, its class, and what is only like it ----------------------------------------------------------------

PLAYED, SCALED = EffectAtPlace("backlash", ("q2",)), EffectAtPlace("actuator-scale", ("q1",))
OTHER, FAINT = EffectAtPlace("friction-hysteresis", ("q2",)), EffectAtPlace("backlash", ("q1",))
BESIDE = {PLAYED: 0.6, OTHER: 0.3, FAINT: 0.01}


def posed(beside: Mapping[EffectAtPlace, float], own: float) -> Found:
    """Play and a scale whose forms nobody tested; the slot of the play holds these, and it is there with ``own``."""
    _, found = held(PLAY, SCALE)
    problem, n = found.problem, len(found.problem.causes)
    table, causes = np.zeros((n, n)), np.zeros(n)
    row = problem.causes.index(PLAYED)
    for cause, share in beside.items():
        table[row, problem.causes.index(cause)] = share
    scaled = problem.causes.index(SCALED)
    table[scaled, scaled], causes[scaled], causes[row] = 1.0, 0.99, own
    untested = replace(found.linearisation, bent=((-1,),))
    return replace(
        found, linearisation=untested, posterior=replace(found.posterior, causes=causes, beside=table)
    )


def play(found: Found, places: Mapping[EffectAtPlace, float] | None = None) -> Named:
    return next(n for n in named(found, Inclusion(places or {}, (), 0.0)) if n.cause == PLAYED)


def itself(found: Found) -> float:
    """Chance that a play which nobody tested is the thing itself."""
    name = [i for i in found.accepted if found.catalogue.cause(i) == PLAYED]
    at = found.linearisation.free + np.array(found.linearisation.indices(name))
    return 1.0 / (1.0 + ONLY_ALIKE * beyond_usual(float(np.abs(found.linearisation.departure[at])[0])))


def test_a_class_is_all_that_its_slot_holds_and_each_has_its_share() -> None:
    """What holds less than a fiftieth of the slot belongs to no class; what is only like the play is one of it."""
    found = posed(BESIDE, 0.6)
    one, sure = play(found), itself(found)
    assert 0.5 < sure < 0.8 and not one.tested
    assert one.probability == pytest.approx(0.6 * sure)
    assert one.certainty == pytest.approx(0.9 * sure)
    told = {m.cause: (m.probability, m.gain - one.gain) for m in one.equivalents}
    like = EffectAtPlace(Empirical.slug, ("q2",))
    assert set(told) == {OTHER, like}
    assert told[OTHER] == pytest.approx((0.3 * sure, np.log(0.5)))
    assert told[like] == pytest.approx((0.6 * (1.0 - sure), np.log((1.0 - sure) / sure)))
    assert [m.probability for m in one.equivalents] == sorted((p for p, _ in told.values()), reverse=True)


def test_a_class_is_never_surer_than_certain() -> None:
    """Rivals of a name that is there nearly always share what it leaves of its slot."""
    one = play(found := posed({PLAYED: 0.9, OTHER: 0.8, FAINT: 0.4}, 0.9))
    sure = itself(found)
    assert one.certainty == pytest.approx(sure)
    told = {m.cause: m.probability for m in one.equivalents}
    assert told[OTHER] == pytest.approx(sure * 0.1 * 0.8 / 1.2)
    assert told[FAINT] == pytest.approx(sure * 0.1 * 0.4 / 1.2)


def test_a_name_has_the_evidence_that_its_share_of_the_draws_speaks_for() -> None:
    """From its prior odds beside the others; so many sweeps tell no more than one in so many."""
    for own in (0.6, 1.0):
        found = posed({PLAYED: own}, own)
        slab, members = found.problem.spike_slab, found.mode.members
        mine = [m for m in members if found.catalogue.cause(found.problem.candidates[m[0]]) == PLAYED]
        drawn = (own * 640 + 1.0) / 642.0
        least = (
            np.log(drawn / (1.0 - drawn))
            - slab.terms.log_prior_of(mine)
            - slot_odds(found.problem.richness, 1)
        )
        large = (supports(slab, found.mode, [np.flatnonzero([m in mine for m in members])]))[0]
        assert play(found).gain == pytest.approx(max(float(least), large))


def test_a_cause_that_is_named_for_itself_is_no_rival() -> None:
    """And another explanation is as probable as it is anywhere."""
    one = play(found := posed({PLAYED: 0.6, OTHER: 0.2, SCALED: 0.2}, 0.6), {OTHER: 0.55})
    told = {m.cause: m.probability for m in one.equivalents}
    assert SCALED not in told and told[OTHER] == 0.55
    assert one.certainty == pytest.approx(itself(found) * 0.8)


def test_names_stand_by_what_supports_them() -> None:
    found = posed({PLAYED: 0.9}, 0.9)
    gains = [n.gain for n in named(found, Inclusion({}, (), 0.0)) if not n.nameless]
    assert len(gains) == 2 and gains == sorted(gains, reverse=True)
    # with the probability that the name has
    said = as_named(Inclusion({PLAYED: 0.95, OTHER: 0.2}, (), 0.0), [play(found)])
    assert said.places == {PLAYED: pytest.approx(0.9 * itself(found)), OTHER: 0.2}
    assert list(said.places) == [PLAYED, OTHER]


def test_forms_are_told_where_no_name_speaks_of_their_part_and_driver() -> None:
    """The best supported first, from one chance in two of the driver at the part on."""
    case, _ = held(PLAY, SCALE)
    forms = {(c.place, c.kind): c.label for i, c in enumerate(case.cat.candidates) if not case.cat.named(i)}
    own, coupled = forms[("q1",), "position"], forms[("q2",), "coupling"]

    def told(found: Found, share: float = 1.0) -> list[Named]:
        states = (found.mode, share), (replace(found.mode, members=()), 1.0 - share)
        posed_ = replace(found, posterior=replace(found.posterior, states=states))
        return [n for n in named(posed_, Inclusion({}, (), 0.0)) if n.nameless]

    spoken = told(case.holding("actuator-scale@q1", own, coupled))
    assert [n.cause.place for n in spoken] == [("q2",)]
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
    seen = Presence(
        found.signatures.machine, found.catalogue, found.problem, replace(found.posterior, states=states)
    )
    for law, place, driver in ((0.3, 0.75, 0.55), (0.6, 0.75, 0.6), (0.8, 0.8, 0.8)):
        levels = seen.levels("backlash", ("q2",), "arrival", law)
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
    seen = Presence(
        found.signatures.machine,
        found.catalogue,
        found.problem,
        replace(found.posterior, states=tuple(states)),
    )
    found_ = seen.together()
    assert [(one.driver, one.places) for one in found_] == ([] if told is None else [("arrival", told[0])])
    assert [one.probability for one in found_] == pytest.approx([] if told is None else [told[1]])


@pytest.mark.parametrize(
    ("own", "share", "told", "leads"),
    [(0.9, 1.0, True, False), (0.5, 0.2, False, True), (0.08, 0.08, False, False)],
)
def test_what_is_less_probable_than_not_leads_from_a_tenth_on(
    own: float, share: float, told: bool, leads: bool
) -> None:
    """``own``: as the conditionals of its slot have it; ``share``: of the states that hold it."""
    found = posed({PLAYED: own}, own)
    rest = tuple(
        m for m in found.mode.members if found.catalogue.cause(found.problem.candidates[m[0]]) != PLAYED
    )
    states = (found.mode, share), (replace(found.mode, members=rest), 1.0 - share)
    found = replace(found, posterior=replace(found.posterior, states=states))
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
    """A remainder is a member of a set that has no place; what has no name is summed over the sets."""
    _, found = held(PLAY, SCALE)
    problem, point = found.problem, found.mode.point
    cause = problem.spike_slab.terms.cause.tolist()
    form = next(c for c in problem.causes if c.effect == Empirical.slug)
    term = {c: cause.index(problem.causes.index(c)) for c in (PLAYED, SCALED, form)}

    def state(*causes: EffectAtPlace, remainder: int = 0, size: int = 5) -> State:
        members = tuple(sorted((term[c], size) for c in causes))
        return State(members, GridPoint(point.noise, point.widening, remainder), 0.0)

    shares = [
        (state(PLAYED, SCALED), 0.3),
        (state(PLAYED, SCALED, size=6), 0.1),
        (state(PLAYED, remainder=1), 0.25),
        (state(PLAYED, form), 0.2),
        (state(), 0.15),
    ]
    causes = np.full(len(problem.causes), 0.009)
    causes[[problem.causes.index(PLAYED), problem.causes.index(SCALED)]] = 0.85, 0.011
    said = inclusion(problem, replace(found.posterior, states=tuple(shares), causes=causes))
    assert said.places == {PLAYED: 0.85, SCALED: 0.011}
    smooth = EffectAtPlace(Empirical.slug, ())
    assert {(frozenset(s.effects), round(s.probability, 9)) for s in said.sets} == {
        (frozenset({PLAYED, SCALED}), 0.4),
        (frozenset({PLAYED, smooth}), 0.25),
        (frozenset({PLAYED, form}), 0.2),
        (frozenset(), 0.15),
    }
    assert [s.probability for s in said.sets] == sorted((s.probability for s in said.sets), reverse=True)
    assert said.nameless == pytest.approx(0.45)
