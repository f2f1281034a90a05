"""What names are worth before any reading: shares of slugs and places, rivals without a name; families; when a model fails."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest

from support.effect_machines import read_machines
from support.searched_arm import PLAY, SCALE, Case, held
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.diagnosis.alarms import misfits
from truepose.identification.diagnosis.naming import FAMILY, Summary, as_named, named, summarised
from truepose.identification.diagnosis.posterior_summary import LISTED, Inclusion, Named, Presence, inclusion
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.verdict import verdict
from truepose.identification.posterior.state import State, slot_odds, supports
from truepose.identification.prediction.simulate import simulate
from truepose.identification.prior import ONLY_ALIKE, TOGETHER, beyond_usual
from truepose.identification.recording.load import load_recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.models.effect_text import parse_effect
from truepose.models.effects.axis_coupling import AxisCoupling
from truepose.models.effects.empirical import Empirical
from truepose.models.load import load_machine
from truepose.models.machine import Machine
from truepose.models.placed import EffectAtPlace

ARM = """schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}
    - {name: q3, kind: revolute, d: 300, range: [-100, 100]}
frames: {tool: {in: flange, xyz: [200, 0, 0], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.1, angle: 0.05}
"""
ROWS = 24


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Catalogue]:
    """Candidates of a small arm, two sessions, a room that warms up."""
    folder: Path = tmp_path_factory.mktemp("naming")
    (folder / "arm.yaml").write_text(ARM)
    rng = np.random.default_rng(3)
    frame = pd.DataFrame(rng.uniform(-90, 90, (ROWS, 3)), columns=["q1", "q2", "q3"])
    frame["time"] = np.arange(ROWS) * 60.0
    frame["session"] = 1 + (np.arange(ROWS) >= ROWS // 2)
    frame["temperature.air"] = np.linspace(20, 24, ROWS)
    frame[["x", "y", "z"]] = rng.normal(size=(ROWS, 3))
    frame.to_csv(folder / "rows.csv", index=False)
    machine = load_machine(folder / "arm.yaml")
    return machine, catalogue(machine, load_recording(machine, [folder / "rows.csv"]))


def test_priors_of_all_candidates_add_up_to_one(arm: tuple[Machine, Catalogue]) -> None:
    assert np.sum(np.exp(arm[1].log_prior)) == pytest.approx(1.0)


def test_one_joint_alone_is_likelier_than_two_at_once(arm: tuple[Machine, Catalogue]) -> None:
    cat = arm[1]
    share = {1: 0.0, 2: 0.0}
    for placed, log in zip(cat.candidates, cat.log_prior, strict=True):
        if placed.effect.slug == "zero-shift":
            share[len(placed.place)] += float(np.exp(log))
    assert share[2] / (share[1] + share[2]) == pytest.approx(TOGETHER)


def test_a_leg_that_drags_another_is_rarer_than_joints_that_share_a_gear_train(tmp_path: Path) -> None:
    """A tenth, and nothing else becomes likelier by it."""
    coupling = AxisCoupling()
    legs = read_machines(tmp_path / "machines")["gough"]
    first, second, *_ = (limb.reading for limb in legs.mechanism.limbs)
    assert coupling.likely(legs, (first, second)) == pytest.approx(0.1)
    (tmp_path / "arm.yaml").write_text(ARM)
    assert coupling.likely(load_machine(tmp_path / "arm.yaml"), ("q1", "q2")) == 1.0


def test_mounts_are_rivals_as_curves_of_drivers_only_and_the_volume_once(
    arm: tuple[Machine, Catalogue],
) -> None:
    cat = arm[1]
    nameless = [c for c in cat.candidates if c.effect.slug == Empirical.slug]
    mounts = [c for c in nameless if c.place in (("base",), ("tool",))]
    assert {name for c in mounts for name in c.drivers} == {"time", "temperature.air"}
    assert all(c.drivers for c in mounts)
    assert [c.place for c in nameless].count(("sensor",)) == 1
    assert len({c.label for c in nameless}) == len(nameless)


# -- families -----------------------------------------------------------------------------------------------


WAVES = {
    EffectAtPlace("encoder-eccentricity", ("q1",)): "order=1,a=1e-3,b=5e-4",
    EffectAtPlace("encoder-eccentricity", ("q2",)): "order=1,a=-1e-3",
    EffectAtPlace("encoder-eccentricity", ("q3",)): "order=1,b=2e-3",
}
SCALES = {
    EffectAtPlace("actuator-scale", ("q1",)): "s=2e-3",
    EffectAtPlace("actuator-scale", ("q2",)): "s=-2e-3",
    EffectAtPlace("actuator-scale", ("q3",)): "s=3e-3",
}
COUPLED = {EffectAtPlace("axis-coupling", ("q2", "q1")): "k=1e-3"}


def found_in(folder: Path, truth: Mapping[EffectAtPlace, str]) -> Found:
    """Of the arm with these effects simulated."""
    (folder / "arm.yaml").write_text(ARM)
    machine, rng = load_machine(folder / "arm.yaml"), np.random.default_rng(4)
    rows = pd.DataFrame(rng.uniform(-95, 95, (2 * ROWS, 3)), columns=["q1 [deg]", "q2 [deg]", "q3 [deg]"])
    rows.to_csv(folder / "poses.csv", index=False)
    poses = load_recording(machine, [folder / "poses.csv"], need_observations=False)
    texts = [f"{slug}@{'+'.join(place)}:{values}" for (slug, place), values in truth.items()]
    read = simulate(machine, poses, [parse_effect(text, machine) for text in texts], seed=3)
    pd.concat([rows, read], axis=1).to_csv(folder / "rows.csv", index=False)
    return Case.on(machine, load_recording(machine, [folder / "rows.csv"])).found()


def said(found: Found) -> dict[EffectAtPlace, str]:
    """What is said, and the family of each."""
    return {n.cause: n.family for n in named(found, inclusion(found.problem, found.posterior)) if n.said}


def doubted(found: Found, cause: EffectAtPlace) -> Found:
    """One of its causes is there one time in ten."""
    problem, posterior, mode = found.problem, found.posterior, found.mode
    number = problem.causes.index(cause)
    rest = tuple(m for m in mode.members if problem.spike_slab.terms.cause[m[0]] != number)
    causes, beside = posterior.causes.copy(), posterior.beside.copy()
    causes[number], beside[number], beside[:, number] = 0.1, 0.0, 0.0
    states = ((State(rest, mode.point, 0.0), 0.9), (mode, 0.1))
    return replace(found, posterior=replace(posterior, causes=causes, beside=beside, states=states))


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> Found:
    return found_in(tmp_path_factory.mktemp("three"), {**WAVES, **COUPLED})


def test_from_three_places_of_one_effect_on_they_are_a_family(tmp_path: Path, three: Found) -> None:
    """Each is said for itself still; two are none, and nothing else beside them is of it."""
    assert FAMILY == 3
    assert said(three) == dict.fromkeys(WAVES, "encoder-eccentricity") | dict.fromkeys(COUPLED, "")
    two = {cause: text for cause, text in WAVES.items() if cause.place != ("q3",)}
    assert said(found_in(tmp_path, {**two, **COUPLED})) == dict.fromkeys((*two, *COUPLED), "")


@pytest.mark.parametrize("doubt", WAVES)
def test_a_place_that_is_not_said_makes_no_family(three: Found, doubt: EffectAtPlace) -> None:
    rest = [cause for cause in (*WAVES, *COUPLED) if cause != doubt]
    found = doubted(three, doubt)
    assert said(found) == dict.fromkeys(rest, "")
    (other,) = [n for n in named(found, inclusion(found.problem, found.posterior)) if n.cause == doubt]
    assert not other.said and other.family == ""


def test_three_joints_that_err_each_in_its_own_size_are_three(tmp_path: Path) -> None:
    """And not two of them beside an error of all three at once, which says the same."""
    assert said(found_in(tmp_path, SCALES)) == dict.fromkeys(SCALES, "actuator-scale")


# -- one name, its class, and what is only like it ----------------------------------------------------------------

PLAYED, SCALED = EffectAtPlace("backlash", ("q2",)), EffectAtPlace("actuator-scale", ("q1",))
OTHER, FAINT = EffectAtPlace("friction-hysteresis", ("q2",)), EffectAtPlace("backlash", ("q1",))
BESIDE = {PLAYED: 0.6, OTHER: 0.3, FAINT: 0.01}


def posed(beside: Mapping[EffectAtPlace, float], own: float, **others: float) -> Found:
    """Play and a scale whose forms nobody tested; the slot of the play holds these, and it is there with ``own``."""
    _, found = held(PLAY, SCALE)
    problem, n = found.problem, len(found.problem.causes)
    table, causes = np.zeros((n, n)), np.zeros(n)
    row = problem.causes.index(PLAYED)
    for cause, share in beside.items():
        table[row, problem.causes.index(cause)] = share
    scaled = problem.causes.index(SCALED)
    table[scaled, scaled], causes[scaled], causes[row] = 1.0, 0.99, own
    for name, value in others.items():
        causes[problem.causes.index({"other": OTHER, "faint": FAINT}[name])] = value
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


def test_forms_without_a_name_are_rivals_but_no_names_of_a_class() -> None:
    form = next(c for c in held(PLAY, SCALE)[1].problem.causes if c.effect == Empirical.slug)
    one = play(found := posed({PLAYED: 0.5, OTHER: 0.2, form: 0.3}, 0.5))
    assert one.certainty == pytest.approx(itself(found) * 0.7)


def test_a_class_lists_eight_at_most() -> None:
    found = held(PLAY, SCALE)[1]
    others = [c for c in found.problem.causes if c not in (PLAYED, SCALED)][:12]
    one = play(posed({PLAYED: 0.4} | dict.fromkeys(others, 0.05), 0.4))
    assert len([m for m in one.equivalents if m.cause in others]) == 8 == LISTED


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


def test_other_states_may_speak_for_a_name_that_the_likeliest_one_does_not_need() -> None:
    """Play of a joint that has none: what its share of the draws says of it counts."""
    faint = held(PLAY, SCALE)[0].holding("backlash@q1", "actuator-scale@q1")
    number, sweeps = faint.problem.causes.index(FAINT), faint.posterior.sweeps
    causes = faint.posterior.causes.copy()
    causes[number] = 0.6
    faint = replace(faint, posterior=replace(faint.posterior, causes=causes))
    (one,) = (n for n in named(faint, Inclusion({}, (), 0.0)) if n.cause == FAINT)
    (mine,) = (
        m for m in faint.mode.members if faint.catalogue.cause(faint.problem.candidates[m[0]]) == FAINT
    )
    drawn = (0.6 * sweeps + 1.0) / (sweeps + 2.0)
    prior_odds = faint.problem.spike_slab.terms.log_prior_of([mine]) + slot_odds(faint.problem.richness, 1)
    assert one.gain == pytest.approx(float(np.log(drawn / (1.0 - drawn)) - prior_odds))


def test_a_cause_that_is_named_for_itself_is_no_rival(tmp_path: Path) -> None:
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
        return State(members, point._replace(remainder=remainder), 0.0)

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


# -- verdicts -----------------------------------------------------------------------------------------------


QUIET = Alarm(1.0, 0.5)


def raised(*, residual: Alarm = QUIET, stated: float = 0.5) -> dict[str, Alarm]:
    return {"residual": residual, "prior_conflict": Alarm(9.0, stated), "structure": QUIET}


def test_a_model_fails_by_what_misstated_tolerances_and_sigmas_do_not_explain() -> None:
    assert not misfits(raised(stated=1e-20))  # tolerances may be stated too small
    stated = raised(residual=Alarm(2.0, 1e-6, "stated sigma"))
    assert not misfits(stated)  # a sigma that is wrong by less than three
    assert misfits(raised(residual=Alarm(2.0, 1e-6, "replicates")))
    assert misfits(raised(residual=Alarm(10.0, 1e-6, "stated sigma")))


@pytest.mark.parametrize(
    "residual", [QUIET, Alarm(1.7, 1e-6, "stated sigma"), Alarm(1.7, 1e-6, "replicates")]
)
@pytest.mark.parametrize("nameless", [0.5, 0.95])
@pytest.mark.parametrize("named", [False, True])
def test_one_rule_gives_the_verdict(named: bool, nameless: float, residual: Alarm) -> None:
    """What is named is missing; else what is surely there, or what noise alone cannot make, is unknown."""
    said = cast(
        Summary,
        SimpleNamespace(names=("form",) if named else (), inclusion=SimpleNamespace(nameless=nameless)),
    )
    there = nameless > 0.9 or residual.about == "replicates"
    told = "missing-physics" if named else "unknown" if there else "adequate"
    assert verdict(said, raised(residual=residual)) == told
