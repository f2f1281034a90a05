"""What names are worth: prior shares of places and second terms, doubt beside a remainder, rivals without a name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pandas as pd
import pytest
from truepose.identification.diagnosis.classes import Member, Named
from truepose.identification.diagnosis.doubt import (
    KEPT,
    LEAST_KEPT,
    doubted,
    same_part,
)
from truepose.identification.diagnosis.effect_selection import Selection
from truepose.identification.diagnosis.unnamed import UNNAMED

from truepose.identification.diagnosis import naming
from truepose.identification.diagnosis.alarms import Alarm, Structure
from truepose.identification.diagnosis.candidates import SECOND_TERM, TOGETHER, Catalogue, catalogue
from truepose.identification.diagnosis.judgement import Judgement
from truepose.identification.diagnosis.naming import likelier
from truepose.identification.diagnosis.remainder import of_pile
from truepose.identification.diagnosis.result import Alternative, Finding, Form, Remainder
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.load import load_recording
from truepose.identification.report.diagnosis_words import form_words
from truepose.models.load import load_machine
from truepose.models.machine import Machine

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
def weighed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Machine, Catalogue]:
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


def test_priors_of_all_candidates_add_up_to_one(weighed: tuple[Machine, Catalogue]) -> None:
    assert np.sum(np.exp(weighed[1].log_prior)) == pytest.approx(1.0)


def test_one_joint_alone_is_likelier_than_two_at_once(weighed: tuple[Machine, Catalogue]) -> None:
    cat = weighed[1]
    share = {1: 0.0, 2: 0.0}
    for placed, log in zip(cat.candidates, cat.log_prior, strict=True):
        if placed.effect.slug == "zero-shift":
            share[len(placed.place)] += float(np.exp(log))
    assert share[2] / (share[1] + share[2]) == pytest.approx(TOGETHER)


def test_a_second_term_of_a_cause_has_paid_for_slug_and_place(weighed: tuple[Machine, Catalogue]) -> None:
    cat = weighed[1]
    of_q2 = [
        k for k, c in enumerate(cat.candidates) if (c.effect.slug, c.place) == ("transmission-error", ("q2",))
    ]
    first, second = of_q2[:2]
    elsewhere = next(k for k, c in enumerate(cat.candidates) if c.place == ("q3",))
    assert cat.log_odds(second, [elsewhere]) == cat.log_prior[second]
    assert cat.log_odds(second, [first]) > cat.log_prior[second]
    for present in ([first], [first, second]):
        total = sum(np.exp(cat.log_odds(k, present)) for k in of_q2 if k not in present)
        assert total == pytest.approx(SECOND_TERM)
    assert cat.log_odds(first, [first]) == cat.log_prior[first]  # a term is no reason for itself


def test_mounts_are_rivals_as_curves_of_drivers_only_and_the_volume_once(
    weighed: tuple[Machine, Catalogue],
) -> None:
    cat = weighed[1]
    nameless = [c for c in cat.candidates if c.effect.slug == UNNAMED]
    mounts = [c for c in nameless if c.place in (("base",), ("tool",))]
    assert {name for c in mounts for name in c.drivers} == {"time", "temperature.air"}
    assert all(c.drivers for c in mounts)
    assert [c.place for c in nameless].count(("sensor",)) == 1
    assert len({c.label for c in nameless}) == len(nameless)


def at(cat: Catalogue, slug: str, *place: str) -> list[int]:
    return [k for k, c in enumerate(cat.candidates) if (c.effect.slug, c.place) == (slug, place)]


def test_a_class_is_headed_by_the_cause_that_has_the_most_of_it_at_all_settings(
    weighed: tuple[Machine, Catalogue],
) -> None:
    cat = weighed[1]
    shift, drifts = at(cat, "frame-shift", "tool")[0], at(cat, "mount-drift", "tool")[:3]
    members = [Member(k, p, 9.0) for k, p in zip(drifts, (0.1, 0.3, 0.2), strict=True)]
    named = Named(shift, 0.4, 1.0, 9.0, tuple(members))
    assert likelier(cat, named) == drifts[1]  # 0.6 in all against 0.4, and its likeliest setting
    assert likelier(cat, replace(named, probability=0.7)) is None
    # other settings of the term's own cause are on its side
    own = Named(drifts[0], 0.2, 1.0, 9.0, (Member(shift, 0.45, 9.0), Member(drifts[1], 0.3, 9.0)))
    assert likelier(cat, own) is None


@pytest.mark.parametrize("stays", [True, False])
def test_a_likelier_cause_takes_a_terms_place_where_it_stays_likelier_in_its_own_fit(
    weighed: tuple[Machine, Catalogue], monkeypatch: pytest.MonkeyPatch, stays: bool
) -> None:
    machine, cat = weighed
    shift, drift = at(cat, "frame-shift", "tool")[0], at(cat, "mount-drift", "tool")[0]
    first = Named(shift, 0.4, 1.0, 9.0, (Member(drift, 0.6, 9.0),))
    later = Named(drift, 0.6, 1.0, 9.0, (Member(shift, 0.4 if stays else 0.7, 9.0),))
    selections = {
        term: SimpleNamespace(
            accepted={term: 1.0}, catalogue=cat, signatures=SimpleNamespace(machine=machine)
        )
        for term in (shift, drift)
    }
    classes = {shift: [first], drift: [later]}
    monkeypatch.setattr(naming, "restricted", lambda selection, *_: selection)
    monkeypatch.setattr(naming, "_classes", lambda selection: classes[next(iter(selection.accepted))])
    monkeypatch.setattr(naming, "_exchanged", lambda *_: selections[drift])
    chosen, named = naming.name_terms(cast(Selection, selections[shift]), np.zeros(0, dtype=bool), None)
    assert list(chosen.accepted) == [drift if stays else shift]
    assert named == classes[drift if stays else shift]


FINDING = Finding(
    effect="backlash",
    place=("q2",),
    probability=0.9,
    certainty=0.99,
    log_bayes_factor=40.0,
    equivalents=(Alternative("friction-hysteresis", ("q2",), 0.09, 39.0),),
    parameters={},
    settings=({},),
    prior_dependent=False,
    flip_lambda=None,
    explanation="Joint q2 has play.",
    experiment="",
)


def test_names_keep_their_share_beside_a_remainder_and_the_rest_has_no_name(
    weighed: tuple[Machine, Catalogue],
) -> None:
    (less,) = doubted(weighed[0], [FINDING], Remainder(("q3",), "q1", Form("curve"), 1.2), failing=True)
    assert less.probability == pytest.approx(KEPT * FINDING.probability)
    named = less.probability + sum(o.probability for o in less.equivalents if o.effect != UNNAMED)
    (unnamed,) = [o for o in less.equivalents if o.effect == UNNAMED]
    assert unnamed.place == ("q3",)
    assert named + unnamed.probability == pytest.approx(FINDING.certainty, abs=0.01)
    assert [o.probability for o in less.equivalents] == sorted(
        (o.probability for o in less.equivalents), reverse=True
    )


def other(effect: str, *place: str, gain: float = 40.0) -> Finding:
    return replace(FINDING, effect=effect, place=place, log_bayes_factor=gain)


PILES: list[tuple[list[Finding], list[float]]] = [
    ([], [1.0]),
    ([other("zero-shift", "q3")], [1.0, 1.0]),
    ([other("zero-shift", "q2")], [KEPT, KEPT]),
    ([other("axis-coupling", "q3", "q2")], [KEPT, KEPT]),
    ([other("link-bending", "link2")], [KEPT, KEPT]),
    ([other("link-bending", "link1")], [1.0, 1.0]),
    # what is much smaller says nothing against a name, but is doubted itself
    ([other("zero-shift", "q2", gain=1.0)], [1.0, KEPT]),
    # what many parts share is on none of them
    ([other("actuator-scale", "q1", "q2", "q3")], [1.0, 1.0]),
    # one kind of fault at every joint is no pile, three kinds are
    ([other("backlash", "q1"), other("backlash", "q3")], [1.0] * 3),
    ([other("gravity-sag", "q1"), other("actuator-scale", "q3")], [KEPT] * 3),
    # unless they are geometry that was stated wrongly
    ([other("zero-shift", "q1"), other("actuator-scale", "q3")], [1.0] * 3),
]


@pytest.mark.parametrize(("beside", "kept"), PILES)
def test_names_that_pile_up_keep_less(
    weighed: tuple[Machine, Catalogue], beside: list[Finding], kept: list[float]
) -> None:
    said = doubted(weighed[0], [FINDING, *beside], None, failing=False)
    assert [f.probability for f in said] == pytest.approx([k * FINDING.probability for k in kept])
    for finding, share in zip(said, kept, strict=True):
        assert any(o.effect == UNNAMED for o in finding.equivalents) == (share < 1.0)
        assert sum(o.probability for o in finding.equivalents) + finding.probability == pytest.approx(0.99)


WITHHELD = {
    "three names on a part": ([FINDING, other("wrong-constant", "q2.d"), other("zero-shift", "q2")], False),
    "two effects and something left": ([FINDING, other("gravity-sag", "q1")], True),
    "two names on a part and something left": ([FINDING, other("zero-shift", "q2")], True),
}


@pytest.mark.parametrize(("names", "failing"), WITHHELD.values(), ids=WITHHELD)
def test_names_of_which_none_keeps_more_than_the_least_are_withheld(
    weighed: tuple[Machine, Catalogue], names: list[Finding], failing: bool
) -> None:
    assert doubted(weighed[0], names, None, failing=failing) == ()
    strong = replace(FINDING, place=("q1",), log_bayes_factor=2000.0)
    kept = doubted(weighed[0], [strong, *names], None, failing=failing)
    assert kept[0].probability == pytest.approx((KEPT if failing else 1.0) * FINDING.probability)
    assert [f.probability for f in kept[1:]] == pytest.approx([LEAST_KEPT * FINDING.probability] * len(names))


def test_names_that_explain_the_lesser_part_are_withheld_unless_a_constant_is_wrong(
    weighed: tuple[Machine, Catalogue],
) -> None:
    constant = other("wrong-constant", "q2.d")
    for share, physics in ((0.6, 1), (0.4, 0)):
        assert len(doubted(weighed[0], [FINDING], None, failing=True, explained=share)) == physics
        assert len(doubted(weighed[0], [constant], None, failing=True, explained=share)) == 1
    assert doubted(weighed[0], [FINDING], None, failing=False, explained=0.0) == (FINDING,)


def test_a_name_shares_its_part_with_something_unnamed_there_only(weighed: tuple[Machine, Catalogue]) -> None:
    arm = weighed[0]
    assert same_part(arm, ("q2.d",), Remainder(("q2",), "q1", Form("curve"), 1.2))
    assert same_part(arm, ("q3", "q2"), Remainder(("q2",), "q1", Form("curve"), 1.2))
    assert not same_part(arm, ("q3",), Remainder(("q2",), "q1", Form("curve"), 1.2))
    assert not same_part(arm, ("q2",), None)


def test_withheld_names_say_where_they_meet_and_what_it_looks_like() -> None:
    fit = cast(Estimate, SimpleNamespace(chi2_per_dof=4.0))
    meeting = [other("axis-coupling", "q3", "q1"), other("backlash", "q3")]
    left = of_pile(meeting, fit, Structure(QUIET, "q2", 9.0, 0.1))
    assert (left.place, left.driver, left.size_sigma) == (("q3",), "q2", 2.0)
    assert "axis-coupling at q3+q1, backlash at q3" in form_words(left) and "hypothesised" in form_words(left)
    apart = of_pile(
        [other("axis-coupling", "q2", "q1"), other("backlash", "q3")], fit, Structure(QUIET, "q2", 9.0, 0.1)
    )
    assert apart.place == ("q2", "q1")


QUIET = Alarm(1.0, 0.5)


def judgement(*, residual: Alarm = QUIET, stated: float = 0.5, stubborn: float = 0.5) -> Judgement:
    alarms = {"residual": residual, "prior_conflict": Alarm(9.0, stated), "structure": QUIET}
    return Judgement(alarms, Structure(QUIET, "time", 0.3, 0.0), stubborn)


def test_a_model_fails_by_what_misstated_tolerances_and_sigmas_do_not_explain() -> None:
    assert not judgement(stated=1e-20).leaves  # likely tolerances explain it
    assert judgement(stated=1e-20, stubborn=1e-6).leaves
    misfit = judgement(residual=Alarm(2.0, 1e-6, "stated sigma"))
    assert misfit.leaves
    assert not misfit.fails  # a sigma that is wrong by less than three
    assert judgement(residual=Alarm(2.0, 1e-6, "replicates")).fails
    assert judgement(residual=Alarm(10.0, 1e-6, "stated sigma")).fails
