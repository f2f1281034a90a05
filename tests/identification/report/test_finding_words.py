"""Findings in words at the deepest level that is known, and the headline that they make."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from support.told_diagnoses import diagnosis, finding
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Finding,
    Form,
    Lead,
    Levels,
    Remainder,
    Replication,
    Together,
)
from truepose.identification.report.finding_words import (
    driver_clauses,
    explanation,
    finding_item,
    follows,
    form_words,
    is_law_known,
    known_words,
    lead_words,
    pooled,
    separating_experiment,
    set_words,
    sure_words,
    together_words,
    tolerance_words,
)
from truepose.identification.report.naming import effect_title, far_row_words, spanned, title, with_article
from truepose.identification.report.verdict import headline, untestable_lines
from truepose.identification.signatures.untestable import Untestable

NAN = float("nan")
LOADED = "at q2 follows the weight carried"
LOAD = Levels(0.99, "load", 0.95)
RIVAL = Alternative("friction-hysteresis", ("q2",), 0.1, 38.0, "reverse slowly")
NAMELESS = Alternative(UNNAMED, ("q2",), 0.01, 36.0)


def named(effect: str, *place: str, probability: float = 0.999, **more: Any) -> Finding:
    plain = replace(finding(probability, 1), equivalents=())
    return replace(plain, effect=effect, place=place, **more)


def said(*findings: Finding, verdict: str = "missing-physics", **more: Any) -> str:
    return headline(diagnosis(verdict, *findings, **more))[0]


@pytest.mark.parametrize(
    ("findings", "told"),
    [
        ([named("joint-compliance", "q2")], "leaves out a compliant joint (joint-compliance) at q2."),
        ([named("wrong-constant", "q2")], "has a grossly wrong constant (wrong-constant) at q2."),
        (
            [named("wrong-constant", "q2"), named("backlash", "q1"), named("joint-compliance", "q2", "q3")],
            "leaves out backlash at q1 and a compliant joint (joint-compliance) at q2, q3"
            " and has a grossly wrong constant (wrong-constant) at q2.",
        ),
        (
            [named("backlash", "q1"), named("empirical", "q5", levels=Levels(0.99, "coupling", 0.95))],
            "leaves out backlash at q1 and misses that something at q5 follows other joints (95.0 %).",
        ),
    ],
)
def test_a_headline_has_verbs_for_what_is_absent_wrong_and_without_a_law(
    findings: list[Finding], told: str
) -> None:
    assert said(*findings) == f"The model of arm {told}"
    assert headline(diagnosis("missing-physics", *findings))[1] == "warn"
    assert said(*findings, concealed=True) == f"The model of arm {told} The ordinary fit looked good."


def test_look_alikes_are_told_beside_a_name_that_is_not_certain() -> None:
    """One by its name, several by their number; those without a name are none."""
    unsure = named("backlash", "q1", probability=0.93)
    for rivals, told in (
        ((), "backlash at q1."),
        ((NAMELESS,), "backlash at q1."),
        (
            (RIVAL, NAMELESS),
            f"backlash at q1 or {with_article('friction-hysteresis')} (friction-hysteresis) at q2.",
        ),
        ((RIVAL, NAMELESS, RIVAL), "backlash at q1 or one of 2 look-alikes."),
    ):
        assert said(replace(unsure, equivalents=rivals)).endswith(f"leaves out {told}")
        assert said(named("backlash", "q1", equivalents=rivals)).endswith("leaves out backlash at q1.")


def test_an_unknown_verdict_tells_what_is_left_and_three_leads() -> None:
    leads = [
        SimpleNamespace(effect="backlash", place=(f"q{k}",), levels=Levels(0.5, "load", 0.4), probability=0.3)
        for k in range(5)
    ]
    left = Remainder(("q2",), "temperature.air", Form("linear", 0.4), 1.5)
    text = said(verdict="unknown", leading=tuple(leads), remainder=left)
    lacks = "The model of arm lacks something whose place and driver are not known."
    assert text.startswith(
        f"{lacks} What is left seems to follow temperature.air at q2 (a hypothesis). Leading: "
    )
    assert [f"backlash at q{k} " in text for k in range(5)] == [True] * 3 + [False] * 2
    assert said(verdict="unknown") == said(finding(0.5, 1), verdict="unknown") == lacks


def test_an_adequate_model_may_stand_beside_something_of_its_rows() -> None:
    calm = "The model of arm is adequate."
    assert said(verdict="adequate") == f"{calm} These readings show nothing that it leaves out."
    beside = said(named("backlash", "q1"), verdict="adequate")
    assert beside == f"{calm} Apart from backlash at q1, these readings show nothing that it leaves out."
    assert headline(diagnosis("adequate"))[1] == "good"


@pytest.mark.parametrize(("chi2", "told"), [(0.77, False), (0.76, True), (1.3, False), (1.31, True)])
def test_a_misfit_is_spoken_of_beyond_its_limits(chi2: float, told: bool) -> None:
    found = diagnosis("missing-physics", named("backlash", "q1"))
    found.fits["after"].chi2_per_dof = chi2  # type: ignore[misc]
    assert ("chi2 per degree of freedom" in headline(found)[0]) is told


@pytest.mark.parametrize(
    ("noise", "explains"),
    [(1.0, False), (1.08, False), (1.1, True), (1.22, True), (1.36, True), (1.4, False)],
)
def test_noise_explains_a_misfit_of_its_own_square_to_a_quarter(noise: float, explains: bool) -> None:
    found = diagnosis("adequate", noise=noise)
    found.fits["after"].chi2_per_dof = 1.5  # type: ignore[misc]
    assert ("noise of that size explains it" in headline(found)[0]) is explains


# -- levels --------------------------------------------------------------------------------------------


def own(
    law: float, driver: float, place: float, where: str = "q2", effect: str = "joint-compliance"
) -> Finding:
    return named(effect, where, probability=law, levels=Levels(place, "load", driver))


@pytest.mark.parametrize(
    ("law", "driver", "place", "told"),
    [
        (0.95, 0.99, 1.0, ("compliant joint at q2", "95.0 %")),
        (0.899, 0.95, 1.0, (f"something {LOADED}", "95.0 %; which law is open, compliant joint with 90 %")),
        (0.007, 0.9995, 1.0, (f"something {LOADED}", "over 99.9 %; which law is open")),
        (0.4, 0.0, 0.0, ("compliant joint at q2", "40 %")),
    ],
)  # fmt: skip
def test_a_finding_is_called_by_the_deepest_level_that_is_known(
    law: float, driver: float, place: float, told: tuple[str, str]
) -> None:
    """A law of 0.7 % gives no title, however sure its place and driver are."""
    assert known_words(own(law, driver, place)) == told
    assert is_law_known(own(law, driver, place)) is ("compliant" in told[0])


def test_what_has_no_law_is_never_known_by_one() -> None:
    bare = named("empirical", "q5", probability=0.0, levels=Levels(0.99, "coupling", 0.95))
    assert known_words(bare) == ("something at q5 follows other joints", "95.0 %; no law of the catalogue")
    coupled = named("axis-coupling", "q4", "q3", probability=0.6, levels=Levels(0.95, "coupling", 0.9))
    assert known_words(coupled)[0] == "something at q4 follows other joints"  # the driven joint errs
    nowhere = named("latency", probability=0.1, levels=Levels(0.99, "sensor", 0.95))
    assert known_words(nowhere)[0] == "something at the recording follows what the sensor reads"


@pytest.mark.parametrize(
    ("law", "halves", "agree", "open_"),
    [
        (0.5, (0.9, 0.9), True, "which law is open"),
        (0.6, (0.9, 0.9), True, "which law is open, compliant joint with 60 %"),
        (0.5, (0.9, 0.49), True, "its law is not replicated: one half of the rows alone would not name it"),
        (0.5, (0.9, 0.9), False, "its law is not replicated: the halves of the recording do not agree on its amplitude"),
    ],
)  # fmt: skip
def test_how_open_a_law_is(law: float, halves: tuple[float, float], agree: bool, open_: str) -> None:
    some = replace(own(law, 0.95, 0.99), replication=Replication(halves, agree=agree))
    assert known_words(some)[1] == f"95.0 %; {open_}"


def test_places_are_pooled_of_one_driver_where_one_place_is_named() -> None:
    """What has no name or follows something else is left out; together they are no likelier than sure."""
    load = Alternative("link-bending", ("link2",), 0.35, 18.0, kind="load")
    again = Alternative("gravity-sag", ("q2", "base"), 0.3, 18.0, kind="load")
    others = (
        Alternative(UNNAMED, ("q9",), 0.2, 18.0, kind="load"),
        Alternative("backlash", ("q8",), 0.2, 18.0, kind="arrival"),
        Alternative("latency", ("q7",), 0.2, 18.0),
    )
    some = replace(own(0.5, 0.55, 0.6), equivalents=(load, *others))
    places, probability = pooled(some)
    assert places == ["q2", "link2"] and probability == pytest.approx(0.9)
    assert driver_clauses([some]) == ["something at q2 or link2 follows the weight carried (90.0 %)"]
    assert pooled(replace(some, equivalents=(load, *others, again))) == (["q2", "link2", "base"], 1.0)
    for apart in (replace(some, place=("q2", "q3")), replace(some, levels=Levels(0.6, "load", 0.54))):
        assert " or " not in driver_clauses([apart])[0]


def test_places_of_one_driver_stand_together_with_how_sure_they_are() -> None:
    six = [own(0.3, p, 1.0, f"q{k}") for k, p in ((2, 0.97), (3, 0.95))]
    curve = named("empirical", "q5", probability=0.0, levels=Levels(0.99, "coupling", 0.96))
    assert driver_clauses([*six, curve]) == [
        "something at q2 and q3 follows the weight carried (95.0 % to 97.0 %)",
        "something at q5 follows other joints (96.0 %)",
    ]
    many = [own(0.3, 0.95, 1.0, f"q{k}") for k in range(7)]
    assert "q0, q1, q2, q3, q4, q5 and 1 more follows" in driver_clauses(many)[0]


def test_what_could_not_be_tested_is_told_by_its_likeliest_name() -> None:
    bare = named("empirical", "q1", levels=LOAD, tested=False, equivalents=(RIVAL,))
    text = f"something at q1 errs, likely a {title(RIVAL.effect)} at q2 (10 %), which could not be tested"
    assert driver_clauses([bare]) == [text] == [known_words(bare)[0]]
    assert sure_words(bare) == f"Probability 99.0 % that {text}."
    law = named("joint-compliance", "q1", levels=LOAD, tested=False, probability=0.6)
    assert sure_words(law).endswith("(joint-compliance) (whether its form is another could not be tested).")


def test_how_sure_a_finding_is_without_levels_and_with_them() -> None:
    plain = named("backlash", "q1", probability=0.999)
    assert sure_words(plain) == "Probability 99.9 % that it is backlash."
    rivals = replace(plain, equivalents=(RIVAL, NAMELESS), certainty=0.97)
    assert sure_words(rivals).endswith("; 97.0 % that it is one of the 2 explanations below.")
    assert sure_words(own(0.57, 0.95, 0.99)) == (
        "Probability 99.0 % that something is at q2, 95.0 % that it follows the weight carried, "
        "57 % that it is a compliant joint (joint-compliance)."
    )
    nameless = sure_words(named("empirical", "q5", levels=Levels(0.99, "coupling", 0.95)))
    assert nameless.endswith("95.0 % that it follows other joints; no law of the catalogue stands for it.")


def test_a_finding_in_a_line_has_its_size_and_four_rivals_each_once() -> None:
    rivals = tuple(Alternative(f"e{k}", ("q1",), 0.1, 1.0) for k in range(6))
    line = finding_item(replace(own(0.95, 0.98, 0.99), equivalents=(rivals[0], *rivals, NAMELESS)))
    assert line == (
        "compliant joint at q2 (joint-compliance): 95.0 %; its driver (the weight carried) 98.0 %; a0 = 0 +- 0.01;"
        " could also be e0 at q1, e1 at q1, e2 at q1, e3 at q1 and 3 more. They have play."
    )
    bare = finding_item(replace(own(0.5, 0.98, 0.99), equivalents=(NAMELESS,), parameters={}))
    assert bare.endswith(
        "(98.0 %; which law is open; could also be something without a name"
    ) or bare.endswith(": 98.0 %; which law is open; could also be something without a name. They have play.")


def test_what_leads_and_what_acts_at_one_of_several_places() -> None:
    lead = Lead("backlash", ("q3",), Levels(0.46, "arrival", 0.45), 0.4)
    assert lead_words(lead) == "backlash at q3 (40 %; something follows the side of arrival there: 45 %)"
    assert lead_words(Lead("latency", (), Levels(0.4, "time", 0.3), 0.2)).startswith("latency (20 %; ")
    assert together_words(Together("load", ("q1", "q2"), 0.98)) == (
        "q1 or q2: at least one follows the weight carried (98.0 %), which is not known"
    )


# -- what JSON says, too: these texts stay as they are ---------------------------------------------------


@pytest.mark.parametrize(
    ("driver", "place", "told"),
    [
        ("order", ("q1",), "vary with the order of acquisition (a hypothesis)"),
        ("q2", ("q2",), "follow q2 (a hypothesis)"),
        ("q2", ("q1",), "follow q2 at q1 (a hypothesis)"),
        ("", ("q1",), "follow no recorded driver at q1 (a hypothesis)"),
    ],
)
def test_what_a_remainder_follows(driver: str, place: tuple[str, ...], told: str) -> None:
    assert follows(Remainder(place, driver, Form("curve"), 1.5)) == told


@pytest.mark.parametrize(
    ("kind", "driver", "told"),
    [
        ("order", "order", "varies with the order of acquisition; explains 37 % of the remainder; hypothesised"),
        ("steps", "q1", "steps with q1; explains 37 % of the remainder; hypothesised"),
        ("linear", "q1", "linear in q1; explains 37 % of the remainder; hypothesised"),
        ("quadratic", "q1", "bent (quadratic) in q1; explains 37 % of the remainder; hypothesised"),
        ("periodic", "q1", "periodic in q1, about 4 periods over its range; explains 37 % of the remainder; hypothesised"),
        ("line", "q1", "q2 errs in proportion to q1; hypothesised"),
        ("curve", "q1", "q2 errs as a smooth curve in q1; hypothesised"),
        ("product", "q1", "q2 errs as the product of q1; hypothesised"),
        ("warp", "q1", "q2 errs as a volume warped quadratically by where the point is; hypothesised"),
    ],
)  # fmt: skip
def test_the_form_of_a_remainder(kind: str, driver: str, told: str) -> None:
    """Only forms that share the remainder with others say how much of it is theirs."""
    assert form_words(Remainder(("q2",), driver, Form(kind, 0.3704, 4), 1.5)) == told


def test_a_family_and_halves_that_disagree_are_part_of_an_explanation() -> None:
    """What is not replicated stands first. Halves that could not show it do not count."""
    plain = named("backlash", "q1")
    assert explanation(plain) == "They have play."
    more = explanation(replace(plain, family="backlash"))
    assert more.startswith("They have play. It was found at more places of this kind")
    alone = "Not replicated: one half of the rows alone would not name it"
    for halves, agree, shown, said_ in (
        ((0.49, 0.9), True, (True, True), f"{alone} (probability 49 %). "),
        ((0.01, 0.05), True, (False, True), f"{alone} (probability 5.0 %). "),
        ((0.5, 0.9), True, (True, True), ""),
        ((0.01, 0.01), True, (False, False), ""),
        ((0.9, 0.9), False, (True, True), "Not replicated: the halves of the recording do not agree on its amplitude. "),
    ):  # fmt: skip
        text = explanation(replace(plain, replication=Replication(halves, agree, shown)))
        assert text == f"{said_}They have play."


def test_an_experiment_against_the_likeliest_rival_is_told_beside_its_own() -> None:
    plain = named("backlash", "q1", experiment="reverse the joint")
    for rivals, more in (
        ((), ""),
        ((NAMELESS,), ""),
        ((NAMELESS, RIVAL), "; against friction-hysteresis: reverse slowly"),
        ((replace(RIVAL, effect="backlash"), RIVAL), ""),
        ((replace(RIVAL, experiment=""), RIVAL), ""),
    ):
        assert separating_experiment(replace(plain, equivalents=rivals)) == f"reverse the joint{more}"


def test_whether_a_name_rests_on_tolerances() -> None:
    free = "The naming does not rest on tolerances: no widening up to a hundred times would flip it."
    alone = "The naming rests on the drawing tolerances alone: free geometry could imitate this effect."
    turn = "With every tolerance 3.0 times wider the verdict would flip."
    for flip, told in ((None, free), (3.0, f"{alone} {turn}"), (NAN, alone)):
        assert tolerance_words(named("backlash", "q1", flip_lambda=flip)) == told


def test_titles_articles_slugs_and_sets() -> None:
    assert effect_title("joint-compliance") == "compliant joint (joint-compliance)"
    assert effect_title("backlash") == "backlash"
    assert effect_title("no-such-effect") == title("no-such-effect") == "no-such-effect"
    assert with_article("encoder-eccentricity") == "an eccentric encoder disc"
    assert with_article("backlash") == "backlash" and with_article("no-such-effect") == "no-such-effect"
    assert set_words([]) == "no effect"
    assert set_words([("backlash", ("q1", "q2")), ("empirical", ())]) == (
        "backlash at q1, q2; a smooth remainder without a place"
    )
    assert spanned((0.6, 0.3, 0.4)) == "30 % to 60 %" and spanned((0.9995, 0.9999)) == "over 99.9 %"


def test_ten_rows_of_each_of_two_files_are_named() -> None:
    def rows(file: str, count: int) -> list[dict[str, Any]]:
        return [{"file": file, "row": 20 - k, "sigma": 5.0 + k} for k in range(count)]

    first, second = far_row_words([*rows("a/one.csv", 12), *rows("two.csv", 1), *rows("three.csv", 1)])
    assert first.startswith("rows 9, 10, 11, 12, 13, 14, 15, 16, 17, 18 and 2 more of one.csv do not fit: ")
    assert "residuals of up to 16 sigma" in first
    assert second.startswith("row 20 of two.csv does not fit: residuals of 5.0 sigma;")
    assert far_row_words([]) == []


def test_effects_that_could_not_be_tested_stand_by_their_reason() -> None:
    """Those that a line or a column would change first; four reasons at most, and none that is no lack."""
    told = untestable_lines(
        [
            Untestable("e1", "the legs are too short"),
            Untestable("e2", "leg1: no clock; leg2: no clock"),
            Untestable("e3", "q1: no clock"),
            Untestable("e4", "no column `payload`; add it: one"),
            Untestable("e5", "nothing to vary"),
            Untestable("e6", "the recording holds one session only"),
            Untestable("e7", "a place: of two words"),
            Untestable("e8", "another lack"),
        ]
    )
    assert told == [
        "e4: no column `payload`; add it: one",
        "e1: the legs are too short",
        "e2 and e3: no clock",
        "e7: a place: of two words",
    ]
