"""The scorer on replies made by hand: what counts as right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from challenge.findings import read_reply
from challenge.headline import headline
from challenge.score import Score, score
from challenge.solutions import Solution, Truth
from proof_support.challenge_replies import BEAT, BEND, PLAY, finding, key, reply


def marks(s: Score) -> str:
    """The first letters of what is true."""
    names = {
        "V": s.verdict, "D": s.detected, "N": s.named, "E": s.top_effect, "P": s.top_place, "X": s.exact,
        "W": s.confident_wrong, "H": bool(s.honest), "R": s.right,
    }  # fmt: skip
    return "".join(letter for letter, value in names.items() if value)


SINGLE = [
    ("missing-physics", [finding("backlash", "rho1")], "VDNEPXR"),
    ("missing-physics", [finding("backlash", "leg1")], "VDNEPXR"),  # the leg that this reading moves
    ("missing-physics", [finding("zero-shift", "rho1")], "VDNEPXR"),  # as good as the truth
    ("missing-physics", [finding("backlash", "rho2")], "VDEW"),
    ("missing-physics", [finding("backlash", "rho2", 0.6)], "VDE"),
    ("missing-physics", [finding("actuator-scale", "rho1")], "VDPW"),
    ("missing-physics", [finding("wrong-constant", "leg1.length", 0.5)], "VDP"),
    ("missing-physics", [finding("actuator-scale", "rho1", 0.5, 9, ("backlash", "rho1", 0.4))], "VDNP"),
    ("missing-physics", [finding("backlash", "rho1+rho2")], "VDNE"),  # more places than there are
    ("missing-physics", [finding("backlash", "rho1"), finding("axis-coupling", "rho1", 0.98, 20)], "VDNPW"),
    ("missing-physics", [finding("backlash", "rho1", 0.9, 20), finding("gravity-sag", "base", 0.5, 4)], "VDNEP"),
    ("missing-physics", [finding("backlash", "rho1"), finding("outliers", "17")], "VDNEPXR"),
    ("unknown", [], "D"),
    ("adequate", [], ""),
]  # fmt: skip


@pytest.mark.parametrize(("verdict", "findings", "wanted"), SINGLE)
def test_one_effect(tmp_path: Path, verdict: str, findings: list[dict[str, Any]], wanted: str) -> None:
    assert marks(score(key(PLAY), reply(tmp_path, verdict, *findings))) == wanted


TWO = [
    ([finding("backlash", "rho1"), finding("platform-deformation", "platform")], "VDNEPXR"),
    ([finding("platform-deformation", "platform"), finding("zero-shift", "rho1")], "VDNEPXR"),
    ([finding("backlash", "rho1")], "VDEP"),
    ([finding("backlash", "rho1"), finding("backlash", "rho1")], "VDEP"),  # one truth is not two
    ([finding("backlash", "rho1"), finding("platform-deformation", "platform"), finding("gravity-sag", "base")],
     "VDNEPW"),
]  # fmt: skip


@pytest.mark.parametrize(("findings", "wanted"), TWO)
def test_two_effects(tmp_path: Path, findings: list[dict[str, Any]], wanted: str) -> None:
    solution = key(PLAY, BEND, stratum="two")
    assert marks(score(solution, reply(tmp_path, "missing-physics", *findings))) == wanted


def test_an_effect_at_several_places_may_be_found_one_by_one(tmp_path: Path) -> None:
    both = key(replace(PLAY, place=("rho1", "rho2"), equivalents=()))
    one, two = finding("backlash", "rho1"), finding("backlash", "rho2")
    assert marks(score(both, reply(tmp_path, "missing-physics", one, two))) == "VDNEXR"
    assert marks(score(both, reply(tmp_path, "missing-physics", one))) == "VDNE"


OUTSIDE = [
    ("unknown", [], "VDHR"),
    ("missing-physics", [finding("backlash", "rho2", 0.99)], "DPW"),
    ("missing-physics", [finding("backlash", "rho2", 0.9)], "DPHR"),
    ("missing-physics", [finding("backlash", "rho2", 0.5, 9, ("zero-shift", "rho2", 0.96))], "DPW"),
    ("adequate", [], ""),
]  # fmt: skip


@pytest.mark.parametrize(("verdict", "findings", "wanted"), OUTSIDE)
def test_outside_the_library(
    tmp_path: Path, verdict: str, findings: list[dict[str, Any]], wanted: str
) -> None:
    assert marks(score(key(BEAT, stratum="out-of-library"), reply(tmp_path, verdict, *findings))) == wanted


def test_outside_the_library_a_name_that_the_data_cannot_tell_from_it_is_honest(tmp_path: Path) -> None:
    alike = replace(BEAT, equivalents=(("axis-coupling", ("rho2", "rho1")),))
    said = reply(tmp_path, "missing-physics", finding("axis-coupling", "rho1+rho2"))
    found = score(key(alike, stratum="out-of-library"), said)
    assert found.honest and found.abstained


@pytest.mark.parametrize(
    ("truth", "place", "right"),
    [(BEAT, BEAT.place[0], True), (BEAT, "base", False), (PLAY, PLAY.place[0], False)],
)
def test_without_a_name_it_is_rightly_said_where_the_truth_has_none(
    tmp_path: Path, truth: Truth, place: str, right: bool
) -> None:
    """At its part; where the truth has a name, `unknown` is no right word for it."""
    said = finding("axis-coupling", place, 0.7, 9, ("unknown", place, 0.2))
    told = score(key(truth, stratum="out-of-library"), reply(tmp_path, "missing-physics", said)).statements
    assert [(s.probability, s.right) for s in told] == [(0.7, False), (0.2, right)]


@pytest.mark.parametrize(("verdict", "probability"), [("unknown", None), ("missing-physics", 0.3)])
def test_a_faint_wrong_name_is_honest_but_no_abstention(
    tmp_path: Path, verdict: str, probability: float | None
) -> None:
    names = [] if probability is None else [finding("backlash", "rho2", probability)]
    found = score(key(BEAT, stratum="out-of-library"), reply(tmp_path, verdict, *names))
    assert found.honest
    assert found.abstained is (verdict == "unknown")


@pytest.mark.parametrize(
    ("verdict", "findings", "alarm"),
    [
        ("adequate", [], False),
        ("adequate", [finding("outliers", "17")], False),
        ("unknown", [], True),
        ("missing-physics", [finding("backlash", "rho1")], True),
    ],
)
def test_nothing_missing(tmp_path: Path, verdict: str, findings: list[dict[str, Any]], alarm: bool) -> None:
    found = score(key(), reply(tmp_path, verdict, *findings))
    assert (found.detected, found.right, found.verdict) == (alarm, not alarm, not alarm)
    assert found.confident_wrong == (verdict == "missing-physics")


def test_no_diagnosis_is_wrong_everywhere() -> None:
    assert score(key(), None).detected  # a false alarm
    for solution in (key(PLAY), key(BEAT, stratum="out-of-library")):
        found = score(solution, None, failure="timeout after 900 s")
        assert marks(found) == "" and found.failure
    assert score(key(BEAT, stratum="out-of-library"), None).honest is False
    assert score(key(BEAT, stratum="out-of-library"), None).abstained is False


def test_a_wrong_class_is_told_though_its_members_share_the_probability(tmp_path: Path) -> None:
    said = finding("transmission-error", "rho3", 0.8, 9, ("encoder-eccentricity", "rho3", 0.2))
    found = score(key(PLAY), reply(tmp_path, "missing-physics", said))
    assert (found.confident_wrong, found.wrong_class) == (False, True)


def test_effects_on_rows_leave_the_verdict(tmp_path: Path) -> None:
    solution = key(Truth("slip", "fringe-miscount", ("rows",), 1.0, 1.0, 0.1, 50.0))
    assert marks(score(solution, reply(tmp_path, "adequate", finding("fringe-miscount", "17")))) == "VDNEPXR"
    assert marks(score(solution, reply(tmp_path, "adequate"))) == "V"


def test_concealment_is_judged_where_something_was_found(tmp_path: Path) -> None:
    solution = key(PLAY, stratum="concealed", concealed=True)
    said = finding("backlash", "rho1")
    assert score(solution, reply(tmp_path, "missing-physics", said, concealed=True)).flag is True
    assert score(solution, reply(tmp_path, "missing-physics", said)).flag is False
    assert score(solution, reply(tmp_path, "adequate")).flag is None


def test_what_is_not_a_diagnosis_is_none(tmp_path: Path) -> None:
    for k, text in enumerate(("", "[]", "{}", '{"verdict": "fine", "findings": []}')):
        (tmp_path / f"{k}.json").write_text(text)
        assert read_reply(tmp_path / f"{k}.json") is None
    assert read_reply(tmp_path / "none.json") is None


FAMILY = tuple(
    Truth("give", "leg-compliance", (f"rho{k}",), size, 1.0, 0.5, 10.0 * size, family="give")
    for k, size in ((1, 4.0), (2, 3.0), (3, 1.0))
)


def many(*truths: Truth) -> Solution:
    return replace(key(*truths, stratum="real-like"), rows=tuple(range(1, 41)), wild=(3, 7))


def test_a_family_counts_at_each_of_its_places(tmp_path: Path) -> None:
    """Said at once or place by place, with the leg's name or its reading's, it is the same."""
    wide = finding("leg-compliance", "leg1+rho2+rho3", 0.95)
    apart = [finding("leg-compliance", f"rho{k}", 0.95) for k in (1, 2, 3)]
    for findings in ([wide], apart):
        found = score(many(*FAMILY, BEND), reply(tmp_path, "missing-physics", *findings))
        assert found.found == (True, True, True, False)
        assert [hit for hit, _ in found.large] == [True, True, False]  # the third is of 2 limits, BEND of 6
        assert all(s.right for s in found.statements)
    elsewhere = finding("leg-compliance", "rho1+rho2+rho4", 0.95)  # one leg too many is no truth
    found = score(many(*FAMILY), reply(tmp_path, "missing-physics", elsewhere))
    assert not any(s.right for s in found.statements)


def test_real_like_names_are_counted_from_nine_tenths_on(tmp_path: Path) -> None:
    sure = [finding("leg-compliance", "rho1", 0.9), finding("gravity-sag", "base", 0.97)]
    faint = finding("backlash", "rho5", 0.89)
    found = score(many(*FAMILY, BEND), reply(tmp_path, "missing-physics", *sure, faint))
    figures = {f.name: f for f in headline([found])}
    said = figures["real-like: names said with 0.9 or more, the very truth"]
    assert (said.hits, said.n, said.met) == (1, 2, False)
    named = figures["real-like: effects above 5 limits, named"]
    assert (named.hits, named.n) == (1, 3)
    assert not found.right


@pytest.mark.parametrize(
    ("wild", "places", "false", "kept", "invented"),
    [
        ((3, 7), ["3", "7"], 0, 0, False),
        ((3, 7), ["3", "9", "11"], 2, 1, False),
        ((3, 7), [], 0, 2, False),
        ((), ["9"], 1, 0, True),
        ((), ["77"], 0, 0, False),  # for validation: no row of the fit
    ],
)
def test_rows_set_aside_are_scored(
    tmp_path: Path, wild: tuple[int, ...], places: list[str], false: int, kept: int, invented: bool
) -> None:
    solution = replace(key(PLAY), rows=tuple(range(1, 41)), wild=wild)
    rows = [finding("outliers", "+".join(places))] if places else []
    found = score(solution, reply(tmp_path, "missing-physics", finding("backlash", "rho1"), *rows))
    assert (found.rows.false, found.rows.kept, found.rows.invented) == (false, kept, invented)
    assert (found.rows.calm, found.rows.wild) == (40 - len(wild), len(wild))
    # among names a finding of outliers is wrong where none were put in; elsewhere it is a statement of its own
    assert [s.right for s in found.statements] == [True, *([False] if places and not wild else [])]
    assert [s.right for s in found.aside] == [len({*places} & {"3", "7"}) > len(places) / 2] * bool(places)
    assert found.exact  # rows decide no verdict
