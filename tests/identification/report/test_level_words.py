"""Findings in words at the deepest level that is known: the law, what drives the place, one of several places, the place."""

from __future__ import annotations

from dataclasses import replace

import pytest

from truepose.identification.diagnosis.result import Alternative, Finding, Lead, Levels, Replication
from truepose.identification.report.level_words import (
    driver_clauses,
    known_words,
    lead_words,
    level_of,
    levels_words,
    pooled,
    spanned,
    title,
)
from truepose.models.file.driver import DriverKind


def finding(
    effect: str,
    place: str,
    law: float,
    driver: float,
    known: float,
    kind: DriverKind = "load",
    equivalents: tuple[Alternative, ...] = (),
) -> Finding:
    return Finding(
        effect=effect,
        place=tuple(place.split("+")),
        probability=law,
        certainty=law,
        log_bayes_factor=20.0,
        equivalents=equivalents,
        parameters={},
        settings=({},),
        flip_lambda=None,
        explanation="",
        experiment="",
        levels=Levels(known, kind, driver),
    )


@pytest.mark.parametrize(
    ("law", "driver", "place", "level"),
    [
        (0.95, 0.99, 1.0, "law"),
        (0.5, 0.95, 1.0, "driver"),
        (0.2, 0.6, 0.95, "place"),
        (0.2, 0.5, 0.6, "none"),
    ],
)
def test_the_deepest_level_that_is_known_is_spoken_of(
    law: float, driver: float, place: float, level: str
) -> None:
    assert level_of(finding("joint-compliance", "q2", law, driver, place)) == level


def test_what_has_no_law_is_never_known_by_one() -> None:
    assert level_of(finding("empirical", "q2", 0.0, 0.99, 1.0)) == "driver"


def test_places_of_one_driver_stand_together_with_what_is_known_of_their_laws() -> None:
    soft = [finding("joint-compliance", f"q{k}", p, 0.99, 1.0) for k, p in ((2, 0.57), (3, 0.62))]
    bent = finding("link-bending", "link2", 0.4, 0.95, 1.0)
    curve = finding("empirical", "q5", 0.0, 0.95, 1.0, "coupling")
    load, other = driver_clauses([*soft, curve, bent])
    assert load.startswith("link2, q2 and q3 give way under the load that they carry (")
    assert f"{title('joint-compliance')}: 57 % to 62 %" in load and f"{title('link-bending')}: 40 %" in load
    assert other == "q5 follows the position of other joints"
    loose = finding("empirical", "q4", 0.0, 0.95, 1.0)
    (clause,) = driver_clauses([*soft, loose])
    assert clause.endswith(f"({title('joint-compliance')}: 57 % to 62 %; else a form without a name)")
    assert driver_clauses([loose]) == ["q4 gives way under the load that it carries"]


def test_twins_are_pooled_where_they_agree() -> None:
    """The mount that drifts is not known; that one of the two does, is."""
    twin = Alternative("mount-drift", ("tool",), 0.41, 18.0, kind="time")
    beside = Alternative("thermal-expansion", ("tool",), 0.02, 18.0, kind="temperature")
    drift = finding("mount-drift", "base", 0.55, 0.56, 0.57, "time", (twin, beside))
    assert level_of(drift) == "pooled"
    places, probability = pooled(drift)
    assert places == ["base", "tool"] and probability == pytest.approx(0.97)
    (clause,) = driver_clauses([drift])
    assert clause == "base or tool drifts with time (97.0 %; not told apart, base with 56 %)"


def test_all_three_levels_are_told_of_a_finding() -> None:
    said = levels_words(finding("joint-compliance", "q2", 0.57, 0.95, 0.99))
    assert said == (
        "Probability 99.0 % that something is at q2, 95.0 % that it follows the weight carried, "
        "57 % that it is a compliant joint (joint-compliance)."
    )
    nameless = levels_words(finding("empirical", "q5", 0.0, 0.95, 0.99, "coupling"))
    assert nameless.endswith("95.0 % that it follows other joints; no law of the catalogue stands for it.")
    coupled = levels_words(finding("axis-coupling", "q4+q3", 0.6, 0.9, 0.95, "coupling"))
    assert "something is at q4," in coupled  # the driven joint errs, not the one that drives


def test_what_leads_below_the_level_of_a_finding_is_shown() -> None:
    lead = Lead("backlash", ("q3",), Levels(0.46, "arrival", 0.45), 0.4)
    assert lead_words(lead) == "backlash at q3 (40 %; something follows the side of arrival there: 45 %)"


def test_a_finding_is_called_by_the_deepest_level_that_is_known() -> None:
    """A law of 0.7 % gives no title, however sure its place and driver are."""
    assert known_words(finding("joint-compliance", "q2", 0.98, 0.99, 0.99)) == (
        "compliant joint at q2",
        "98.0 %",
    )
    said, sure = known_words(finding("joint-compliance", "q2", 0.007, 0.9995, 0.9995))
    assert said == "q2 gives way under the load that it carries"
    assert sure == "over 99.9 %; which law is open"
    said, sure = known_words(finding("empirical", "q5", 0.0, 0.95, 0.99, "coupling"))
    assert (said, sure) == ("q5 follows the position of other joints", "95.0 %; no law of the catalogue")


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


# -- at the limits -----------------------------------------------------------------------------------


def own(
    law: float, driver: float, place: float, where: str = "q2", effect: str = "joint-compliance"
) -> Finding:
    return finding(effect, where, law, driver, place)


@pytest.mark.parametrize(
    ("known", "level"),
    [
        (own(0.9, 0.9, 0.9), "law"),
        (own(0.899, 0.9, 0.9), "driver"),
        (own(0.899, 0.899, 0.9), "place"),
        (own(0.899, 0.899, 0.899), "none"),
        (own(0.95, 0.9, 0.9, effect="empirical"), "driver"),
        (own(0.95, 0.8, 0.9, effect="empirical"), "place"),
    ],
)
def test_nine_in_ten_are_spoken_of_as_known(known: Finding, level: str) -> None:
    """Each level by itself; what has no name has no law, however probable."""
    assert level_of(known) == level


def test_places_are_pooled_of_one_driver_where_one_place_is_named() -> None:
    """What has no name or follows something else is left out; together they are no likelier than sure."""
    load = Alternative("link-bending", ("link2",), 0.35, 18.0, kind="load")
    again = Alternative("gravity-sag", ("q2", "base"), 0.3, 18.0, kind="load")
    others = (
        Alternative("unknown", ("q9",), 0.2, 18.0, kind="load"),
        Alternative("backlash", ("q8",), 0.2, 18.0, kind="arrival"),
        Alternative("latency", ("q7",), 0.2, 18.0),
    )
    some = finding("joint-compliance", "q2", 0.5, 0.55, 0.6, "load", (load, *others))
    places, probability = pooled(some)
    assert places == ["q2", "link2"] and probability == pytest.approx(0.9) and level_of(some) == "pooled"
    more = finding("joint-compliance", "q2", 0.5, 0.55, 0.6, "load", (load, *others, again))
    assert pooled(more) == (["q2", "link2", "base"], 1.0)
    two = finding("joint-compliance", "q2+q3", 0.5, 0.55, 0.6, "load", (load, again))
    assert level_of(two) == "none"
    assert level_of(finding("joint-compliance", "q2", 0.5, 0.54, 0.6, "load", (load, *others))) == "none"


def test_laws_that_lead_at_places_of_one_driver_are_told_with_their_range() -> None:
    """Each once; and that a form without a name leads elsewhere. Laws that are no likelier than not are open."""

    def clause(*some: Finding) -> str:
        (said,) = driver_clauses(some)
        return said

    one, two = own(0.3, 0.95, 0.99, "q1"), own(0.6, 0.95, 0.99, "q3")
    sag, bare = own(0.7, 0.95, 0.99, "q2", "gravity-sag"), own(0.0, 0.95, 0.99, "q4", "empirical")
    many = "give way under the load that they carry"
    assert clause(one, two) == f"q1 and q3 {many} (compliant joint: 30 % to 60 %)"
    assert clause(two, two) == "q3 gives way under the load that it carries (compliant joint: 60 %)"
    told = f"compliant joint: 30 %; {title('gravity-sag')}: 70 %"
    assert clause(one, sag) == f"q1 and q2 {many} ({told})"
    assert clause(one, sag, bare) == f"q1, q2 and q4 {many} ({told}; else a form without a name)"
    assert clause(bare, own(0.0, 0.95, 0.99, "q5", "empirical")) == f"q4 and q5 {many}"
    half = own(0.5, 0.95, 0.99, "q3")
    assert clause(one, half) == f"q1 and q3 {many} (which law is open)"
    assert clause(half, bare) == f"q3 and q4 {many} (which law is open)"


def test_clauses_stand_by_how_deep_they_are_known() -> None:
    """What could not be tested first, then by driver, by place and by neither; what is pooled last; laws elsewhere."""
    twin = Alternative("mount-drift", ("tool",), 0.41, 18.0, kind="time")
    drift = finding("mount-drift", "base", 0.55, 0.56, 0.57, "time", (twin,))
    bare = replace(own(0.0, 0.95, 0.99, "q7", "empirical"), tested=False, equivalents=(twin,))
    some = [
        drift,
        own(0.1, 0.5, 0.6, "q1"),
        own(0.1, 0.5, 0.95, "q2"),
        own(0.1, 0.95, 0.99, "q3"),
        bare,
        own(0.99, 0.99, 0.99),
    ]
    said = driver_clauses(some)
    assert [text.split(" errs")[0].split(" gives")[0].split(" drifts")[0] for text in said] == [
        "something at q7", "q3", "something at q2", "probably something at q1", "base or tool",
    ]  # fmt: skip


def test_what_has_no_place_is_the_sensor_s_or_the_recording_s() -> None:
    nowhere = replace(own(0.1, 0.95, 0.99, "x"), place=(), levels=Levels(0.99, "sensor", 0.95))
    assert driver_clauses([replace(nowhere, effect="empirical")]) == ["the sensor errs by itself"]
    assert known_words(nowhere) == ("the recording errs by itself", "95.0 %; which law is open")
    assert lead_words(Lead("latency", (), Levels(0.4, "time", 0.3), 0.2)) == (
        "latency (20 %; something follows time there: 30 %)"
    )


def test_a_finding_without_levels_is_called_by_its_law() -> None:
    told = replace(own(0.4, 0.0, 0.0), levels=Levels())
    assert known_words(told) == ("compliant joint at q2", "40 %")
    assert known_words(own(0.4, 0.5, 0.6))[0] == "q2 gives way under the load that it carries"


@pytest.mark.parametrize(
    ("values", "said"),
    [((0.3,), "30 %"), ((0.6, 0.3, 0.4), "30 % to 60 %"), ((0.301, 0.304), "30 %"), ((0.9995, 0.9999), "over 99.9 %")],
)  # fmt: skip
def test_probabilities_that_read_alike_are_told_once(values: tuple[float, ...], said: str) -> None:
    assert spanned(values) == said
