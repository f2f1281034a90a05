"""Verdicts, findings and what speaks for and against them, as sentences that a person reads."""

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
    Levels,
    Remainder,
    Replication,
    Together,
)
from truepose.identification.report.diagnosis_words import (
    alarm_name,
    alarm_question,
    certainty_words,
    effect_title,
    explanation,
    follows,
    form_words,
    headline,
    separating_experiment,
    set_words,
    tolerance_words,
)
from truepose.identification.report.level_words import (
    driver_clauses,
    levels_words,
    title,
    together_words,
    with_article,
)
from truepose.identification.report.naming import far_row_words
from truepose.identification.report.verdict import untestable_lines
from truepose.identification.signatures.untestable import Untestable

NAN = float("nan")
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
            "leaves out backlash at q1 and misses that q5 follows the position of other joints.",
        ),
    ],
)
def test_a_headline_has_verbs_for_what_is_absent_wrong_and_without_a_law(
    findings: list[Finding], told: str
) -> None:
    assert said(*findings) == f"The model of arm {told}"
    assert headline(diagnosis("missing-physics", *findings))[1] == "warn"


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
    levels = Levels(0.5, "load", 0.4)
    leads = [
        SimpleNamespace(effect="backlash", place=(f"q{k}",), levels=levels, probability=0.3) for k in range(5)
    ]
    left = Remainder(("q2",), "temperature.air", Form("linear", 0.4), 1.5)
    text = said(verdict="unknown", leading=tuple(leads), remainder=left)
    lacks = "The model of arm lacks something whose place and driver are not known."
    assert text.startswith(
        f"{lacks} What is left seems to follow temperature.air at q2 (a hypothesis). Leading: "
    )
    assert [f"backlash at q{k} " in text for k in range(5)] == [True] * 3 + [False] * 2
    assert said(verdict="unknown") == lacks
    assert said(finding(0.5, 1), verdict="unknown") == lacks


def test_an_adequate_model_may_stand_beside_something_of_its_rows() -> None:
    calm = "The model of arm is adequate."
    assert said(verdict="adequate") == f"{calm} These readings show nothing that it leaves out."
    assert headline(diagnosis("adequate"))[1] == "good"
    beside = said(named("backlash", "q1"), verdict="adequate")
    assert beside == f"{calm} Apart from backlash at q1, these readings show nothing that it leaves out."
    assert said(verdict="missing-physics").startswith(calm)


@pytest.mark.parametrize(
    ("driver", "place", "told"),
    [
        ("order", ("q1",), "vary with the order of acquisition (a hypothesis)"),
        ("q2", ("q2",), "follow q2 (a hypothesis)"),
        ("q2", ("q1",), "follow q2 at q1 (a hypothesis)"),
        ("q2", ("q2", "q3"), "follow q2 at q2, q3 (a hypothesis)"),
        ("q2", (), "follow q2 (a hypothesis)"),
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
    own = named("backlash", "q1")
    assert explanation(own) == "They have play."
    more = explanation(replace(own, family="backlash"))
    assert more.startswith("They have play. It was found at more places of this kind")
    alone = "Not replicated: one half of the rows alone would not name it"
    for halves, agree, shown, said_ in (
        ((0.49, 0.9), True, (True, True), f"{alone} (probability 49 %). "),
        ((0.9, 0.05), True, (True, True), f"{alone} (probability 5.0 %). "),
        ((0.01, 0.05), True, (False, True), f"{alone} (probability 5.0 %). "),
        ((0.5, 0.9), True, (True, True), ""),
        ((0.01, 0.9), True, (False, True), ""),
        ((0.01, 0.01), True, (False, False), ""),
        ((0.9, 0.9), False, (True, True), "Not replicated: the halves of the recording do not agree on its amplitude. "),
    ):  # fmt: skip
        text = explanation(replace(own, replication=Replication(halves, agree, shown)))
        assert text == f"{said_}They have play."


def test_an_experiment_against_the_likeliest_rival_is_told_beside_its_own() -> None:
    own = named("backlash", "q1", experiment="reverse the joint")
    same = replace(RIVAL, effect="backlash")
    for rivals, more in (
        ((), ""),
        ((NAMELESS,), ""),
        ((NAMELESS, RIVAL), "; against friction-hysteresis: reverse slowly"),
        ((same, RIVAL), ""),
        ((replace(RIVAL, experiment=""), RIVAL), ""),
    ):
        assert separating_experiment(replace(own, equivalents=rivals)) == f"reverse the joint{more}"


def test_whether_a_name_rests_on_tolerances() -> None:
    free = "The naming does not rest on tolerances: no widening up to a hundred times would flip it."
    alone = "The naming rests on the drawing tolerances alone: free geometry could imitate this effect."
    turn = "With every tolerance 3.0 times wider the verdict would flip."
    for flip, told in ((None, free), (3.0, f"{alone} {turn}"), (NAN, alone)):
        assert tolerance_words(named("backlash", "q1", flip_lambda=flip)) == told


def test_how_sure_a_finding_is_without_levels_and_with_them() -> None:
    own = named("backlash", "q1", probability=0.999)
    assert certainty_words(own) == (
        "Probability 99.9 % that it is backlash at q1. No other explanation of the catalogue comes close."
    )
    assert certainty_words(replace(own, probability=0.6)).endswith(
        "60 % that it is backlash at q1. The rest is shared by others: see how explanations were weighed."
    )
    rivals = replace(own, equivalents=(RIVAL, NAMELESS), certainty=0.97)
    assert certainty_words(rivals).endswith(
        "; 97.0 % that it is one of the 3 explanations below, which these readings cannot tell apart."
    )
    levels = Levels(0.99, "arrival", 0.98)
    deep = certainty_words(replace(rivals, levels=levels))
    assert deep.startswith(
        "Probability 99.0 % that something is at q1, 98.0 % that it follows the side of arrival, "
    )
    assert deep.endswith(" 97.0 % that it is one of the 2 explanations below that have a name.")
    for alone in (replace(rivals, equivalents=(NAMELESS,)), replace(rivals, effect="empirical")):
        assert "that it is one of" not in certainty_words(replace(alone, levels=levels))


def test_titles_articles_and_slugs() -> None:
    assert effect_title("joint-compliance") == "compliant joint (joint-compliance)"
    assert effect_title("backlash") == "backlash"
    assert effect_title("no-such-effect") == title("no-such-effect") == "no-such-effect"
    assert with_article("encoder-eccentricity") == "an eccentric encoder disc"
    assert with_article("joint-compliance") == "a compliant joint"
    assert with_article("backlash") == "backlash" and with_article("no-such-effect") == "no-such-effect"
    assert set_words([]) == "no effect"
    assert set_words([("backlash", ("q1", "q2")), ("empirical", ())]) == (
        "backlash at q1, q2; a smooth remainder without a place"
    )
    assert (alarm_name("residual"), alarm_name("other")) == ("lack of fit", "other")
    assert (
        alarm_question("structure").startswith("do residuals under tolerances") and alarm_question("x") == "x"
    )


# -- levels --------------------------------------------------------------------------------------------


def clause(*places: str, **more: Any) -> list[str]:
    levels = more.pop("levels", Levels(0.99, "load", 0.95))
    return driver_clauses([named("empirical", place, levels=levels, **more) for place in places])


def test_places_are_listed_by_their_numbers_and_six_of_them_at_most() -> None:
    assert clause("q10", "q2") == ["q2 and q10 give way under the load that they carry"]
    six = [f"q{k}" for k in range(6)]
    assert clause(*six) == ["q0, q1, q2, q3, q4 and q5 give way under the load that they carry"]
    assert clause(*six, "q6") == ["q0, q1, q2, q3, q4, q5 and 1 more give way under the load that they carry"]
    together = Together("load", (*six, "q6"), 0.98)
    text = together_words(together)
    assert text.startswith(
        "q0, q1, q2, q3, q4, q5 and 1 more gives way under the load that it carries (98.0 % that"
    )
    assert together_words(replace(together, places=("q1", "q2"))).startswith("q1 or q2 gives way ")


@pytest.mark.parametrize(
    ("place", "driver", "told"),
    [
        (0.95, 0.6, "something at q1 errs, likely with the weight carried (60 %)"),
        (0.6, 0.5, "probably something at q1 errs, likely with the weight carried (50 %)"),
    ],
)
def test_a_place_without_a_driver_is_hedged(place: float, driver: float, told: str) -> None:
    assert clause("q1", levels=Levels(place, "load", driver)) == [told]


def test_what_could_not_be_tested_is_told_by_its_likeliest_name() -> None:
    levels = Levels(0.99, "load", 0.95)
    own = named("empirical", "q1", levels=levels, tested=False, equivalents=(RIVAL,))
    text = f"something at q1 errs, likely a {title(RIVAL.effect)} at q2 (10 %), which could not be tested"
    assert driver_clauses([own]) == [text]
    assert levels_words(own) == f"Probability 99.0 % that {text}."
    bare = replace(own, equivalents=())
    assert driver_clauses([bare]) == ["q1 gives way under the load that it carries"]
    law = named("joint-compliance", "q1", levels=levels, tested=False, equivalents=(RIVAL,))
    assert levels_words(law).endswith("(joint-compliance) (whether its form is another could not be tested).")
    nowhere = replace(law, place=(), tested=True)
    assert levels_words(nowhere).startswith("Probability 99.0 % that something is at the recording, ")


# -- rows and what could not be tested -----------------------------------------------------------------


def test_ten_rows_of_each_of_two_files_are_named() -> None:
    def rows(file: str, count: int) -> list[dict[str, Any]]:
        return [{"file": file, "row": 20 - k, "sigma": 5.0 + k} for k in range(count)]

    first, second = far_row_words([*rows("a/one.csv", 12), *rows("two.csv", 10), *rows("three.csv", 1)])
    assert first.startswith("rows 9, 10, 11, 12, 13, 14, 15, 16, 17, 18 and 2 more of one.csv do not fit: ")
    assert "residuals of up to 16 sigma" in first
    assert second.startswith("rows 11, 12, 13, 14, 15, 16, 17, 18, 19, 20 of two.csv do not fit")


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
