"""The scorer on replies made by hand: what counts as right, and what an interval is."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from scipy.stats import norm

from support.studies import study_module
from truepose.challenge.calibration import brier, calibration_error, honest_error, reliability, wilson
from truepose.challenge.figures import at_least, at_most, between, median, quantile
from truepose.challenge.findings import Reply, read_reply
from truepose.challenge.headline import headline
from truepose.challenge.measures import held_out_error, parameter_bias, standard_scores
from truepose.challenge.predictions import Predicted, coefficients
from truepose.challenge.score import Score, read_score, score
from truepose.challenge.score_table import lines, markdown, table
from truepose.challenge.solutions import Geometry, HeldOut, Reference, Solution, Truth, to_text
from truepose.challenge.statements import Statement
from truepose.challenge.table_document import document
from truepose.identification.report.json_text import json_text

GEOMETRY = Geometry(("a", "b"), (1.0, 2.0), (0.1, 0.2), ((1.0, 0.0),))
HELD = HeldOut(("x",), ("mm",), (0.01,), ((1.0,), (2.0,)))
PLAY = Truth("play", "backlash", ("rho1",), 2.0, 1.0, 0.5, 20.0, equivalents=(("zero-shift", ("rho1",)),))
BEND = Truth("bend", "platform-deformation", ("platform",), 3.0, 1.0, 0.5, 30.0)
BEAT = Truth("beat", "", ("rho2",), 2.0, 1.0, 0.5, 20.0)


def key(*truths: Truth, stratum: str = "single", concealed: bool = False) -> Solution:
    return Solution(
        "case001", "telescope", stratum if truths else "null", "", truths, concealed, 1.1, {"leg1": "rho1"},
        GEOMETRY, HELD, Reference(4.0, 10.0), Reference(1.0, 1.0),
    )  # fmt: skip


def finding(
    effect: str, place: str, probability: float = 0.97, gain: float = 10.0, *others: tuple[str, str, float]
) -> dict[str, Any]:
    return {
        "effect": effect, "place": place.split("+"), "probability": probability, "certainty": 0.99,
        "log_bayes_factor": gain,
        "equivalents": [{"effect": e, "place": p.split("+"), "probability": q} for e, p, q in others],
    }  # fmt: skip


def reply(tmp_path: Path, verdict: str, *findings: dict[str, Any], concealed: bool = False) -> Reply:
    document = {
        "verdict": verdict, "concealed": concealed, "findings": list(findings),
        "parameters": {"a": {"value": 1.2}, "b": {"value": 9.0}},
    }  # fmt: skip
    (tmp_path / "diagnosis.json").write_text(json.dumps(document))
    read = read_reply(tmp_path / "diagnosis.json")
    assert read is not None
    return read


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


def test_held_out_error_is_in_sigma() -> None:
    assert held_out_error(pd.DataFrame({"x": [1.01, 2.01], "x.std": [1, 1]}), HELD) == pytest.approx(1.0)
    assert held_out_error(pd.DataFrame({"x": [1.0, np.nan]}), HELD) is None
    assert held_out_error(pd.DataFrame({"y": [1.0, 2.0]}), HELD) is None


@given(st.floats(-0.01, 0.01), st.floats(0.0, 3.1))
def test_rotations_are_compared_as_rotations(turn: float, angle: float) -> None:
    held = HeldOut(("rx", "ry", "rz"), ("rad",) * 3, (0.001,) * 3, ((0.0, 0.0, angle),))
    whole = 360.0 if angle + turn > np.pi else 0.0  # the same turn the other way round
    said = pd.DataFrame({"rx": [0.0], "ry": [0.0], "rz": [np.degrees(angle + turn) - whole]})
    assert held_out_error(said, held) == pytest.approx(abs(turn) / 0.001 / np.sqrt(3), abs=1e-6)


def test_bias_is_of_combinations_that_are_known() -> None:
    assert parameter_bias({"a": 1.2, "b": 99.0}, GEOMETRY) == pytest.approx(2.0)
    assert parameter_bias({"a": 1.2}, GEOMETRY) is None


def test_ratios_are_to_the_oracle_and_from_the_ordinary_fit(tmp_path: Path) -> None:
    found = score(
        key(PLAY), reply(tmp_path, "missing-physics", finding("backlash", "rho1")), predicted=Predicted(1.3)
    )
    assert found.held_out_ratio == pytest.approx(1.3)
    assert found.bias_ratio == pytest.approx(10.0 / 2.0)


@given(st.integers(0, 300), st.integers(1, 300))
def test_wilson_ends_are_where_the_share_is_just_credible(hits: int, n: int) -> None:
    """Both ends p satisfy |share - p| = z sqrt(p (1 - p) / n): the score test's definition."""
    hits = min(hits, n)
    low, high = wilson(hits, n)
    assert 0.0 <= low <= hits / n <= high <= 1.0

    z = norm.ppf(0.975)

    def off(p: float) -> float:
        return float(abs(hits / n - p) - z * np.sqrt(p * (1 - p) / n))

    assert off(low) == pytest.approx(0.0, abs=1e-9) and off(high) == pytest.approx(0.0, abs=1e-9)
    assert low < high  # a share of 0 or 1 is a root itself, and no interval


@given(st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=60))
def test_every_statement_is_in_one_bin(pairs: list[tuple[float, bool]]) -> None:
    statements = [Statement(p, right) for p, right in pairs]
    bins = reliability(statements)
    assert sum(b.n for b in bins) == len(pairs)
    assert sum(b.hits for b in bins) == sum(right for _, right in pairs)
    assert brier(statements) == pytest.approx(np.mean([(p - r) ** 2 for p, r in pairs]))
    # what each tenth is off by, weighed by how much is in it
    off = sum(b.n * abs(b.said - b.hits / b.n) for b in bins) / len(pairs)
    assert calibration_error(statements) == pytest.approx(off, abs=1e-12)
    assert all(b.holds == (b.interval[0] <= b.said <= b.interval[1]) for b in bins)
    tenths = sorted({min(int(10 * p + 1e-9), 9) for p, _ in pairs})
    for tenth, one in zip(tenths, bins, strict=True):
        assert tenth / 10 - 1e-9 <= one.said <= (tenth + 1) / 10 + 1e-9


def test_honest_probabilities_have_the_calibration_error_of_chance() -> None:
    """Simulated once more: the mean over many honest engines is what one engine is compared with."""
    rng = np.random.default_rng(4)
    p = rng.random(150)
    errors = []
    for _ in range(300):
        said = [Statement(float(q), bool(right)) for q, right in zip(p, rng.random(150) < p, strict=True)]
        errors.append(calibration_error(said) or 0.0)
    # both means of hundreds of errors of a fifth of scatter each
    assert honest_error(said) == pytest.approx(float(np.mean(errors)), rel=0.05)
    assert honest_error([Statement(1.0, False)]) == 0.0 and honest_error([]) is None


def _all(tmp_path: Path) -> list[Score]:
    named = reply(tmp_path, "missing-physics", finding("backlash", "rho1"))
    out = [
        score(key(), reply(tmp_path, "adequate"), predicted=Predicted(4.0)),
        score(key(), None, failure="crash"),
    ]
    out += [
        score(key(PLAY, stratum=s), named, predicted=Predicted(1.2))
        for s in ("single", "concealed", "look-alike")
    ]
    out.append(score(key(PLAY, BEND, stratum="two"), named, predicted=Predicted(2.0)))
    return [*out, score(key(BEAT, stratum="out-of-library"), reply(tmp_path, "unknown"))]


def test_the_figures_of_a_small_examination(tmp_path: Path) -> None:
    figures = {f.name: f for f in headline(_all(tmp_path))}
    assert (figures["false alarms, null and decoys"].hits, figures["false alarms, null and decoys"].n) == (
        1,
        2,
    )
    assert figures["concealed stratum: detected and named"].value == 1.0
    assert figures["first name right, from 3 limits on"].n == 4
    assert figures["two effects, both from 3 limits on: exact pair"].met is False
    assert figures["out of library: unknown, or as good a name first"].value == 1.0
    assert figures["out of library, lenient: unknown or honest"].value == 1.0
    assert figures["no diagnosis, or no prediction"].hits == 1
    ratio = figures["held-out error over the oracle's, median"]
    assert (ratio.n, ratio.value, ratio.met) == (5, 1.2, False)  # one has no prediction


def test_effects_below_three_limits_are_apart(tmp_path: Path) -> None:
    faint = score(key(replace(PLAY, size=1.0)), reply(tmp_path, "adequate"))
    assert {f.name: f.n for f in headline([faint])}["first name right, from 3 limits on"] == 0
    assert any("below 3 limits" in f.name for f in table([faint]).details)


def test_the_table_is_written_in_all_forms(tmp_path: Path) -> None:
    found = table(_all(tmp_path), ["case009: tiny: nothing"])
    text = markdown(found)
    assert text.count("| case001 |") == 7 and "crash" in text and "case009" in text
    for line in text.splitlines():
        assert not line.startswith("|") or line.endswith("|")
    assert len(lines(found)) == len(found.headline)
    assert json.loads(json_text(document(found)))["cases"] == 7
    assert markdown(table([])) and lines(table([]))


def test_the_page_holds_the_table_between_its_marks(tmp_path: Path) -> None:
    page, text = study_module("challenge_page"), markdown(table(_all(tmp_path)))
    told = f"before\n{page.BEGIN}\nwhat stood here\n{page.END}\nafter\n"
    once = page.filled(told, text)
    assert once.startswith("before\n") and once.endswith("\nafter\n") and "what stood here" not in once
    assert "\n### By stratum\n" in once and page.filled(once, text) == once
    with pytest.raises(ValueError, match="found no marks"):
        page.filled("nothing", text)
    whole = page.PAGE.read_text(encoding="utf-8")
    assert page.filled(whole, text).count(page.BEGIN) == 1


def test_targets_and_medians() -> None:
    assert at_least(0.9).met(0.9) and not at_least(0.9).met(0.8)
    assert at_most(0.05).met(0.05) and not at_most(0.05).met(0.06)
    middle = median("m", [1.0, 2.0, None, float("nan"), 9.0])
    assert (middle.value, middle.n) == (2.0, 3)
    assert middle.interval is not None and middle.interval[0] <= 2.0 <= middle.interval[1]


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


def test_what_is_said_beside_a_remainder_is_counted_apart(tmp_path: Path) -> None:
    document_ = {
        "verdict": "missing-physics", "concealed": False, "findings": [finding("backlash", "rho2", 0.6)],
        "parameters": {}, "remainder": {"place": ["rho2"]}, "sets": [{"effects": [], "probability": 1.0}],
        "inclusion": [
            {"effect": "backlash", "place": ["rho1"], "probability": 0.3},
            {"effect": "empirical", "place": ["rho2"], "probability": 0.9},
        ],
    }  # fmt: skip
    (tmp_path / "d.json").write_text(json.dumps(document_))
    beside = read_reply(tmp_path / "d.json")
    assert beside is not None and beside.remainder and [s.effect for s in beside.inclusion] == ["backlash"]
    both = [
        score(key(PLAY), beside),
        score(key(PLAY), reply(tmp_path, "missing-physics", finding("backlash", "rho1"))),
    ]
    assert [(s.probability, s.right) for s in both[0].listed] == [(0.3, True)]
    figures = {f.name: f for f in headline(both)}
    assert figures["names beside a remainder: expected calibration error"].value == pytest.approx(0.6)
    assert figures["names: expected calibration error"].value == pytest.approx((0.6 + 0.03) / 2)


def test_the_answer_is_held_against_the_best_model_of_as_many_columns(tmp_path: Path) -> None:
    solution = replace(key(BEAT, stratum="out-of-library"), empirical=(4.0, 2.0, 1.0))
    unknown = reply(tmp_path, "unknown")
    for columns, ratio in ((0, 0.5), (1, 1.0), (2, 2.0), (30, 2.0)):
        assert score(solution, unknown, predicted=Predicted(2.0, columns=columns)).empirical_ratio == ratio
    none = score(solution, unknown)
    assert none.empirical_ratio is None
    figures = {f.name: f for f in headline([none])}
    assert figures["out of library: held-out error over the best empirical model's, median"].value == np.inf
    assert json.loads(json_text(document(table([none]))))["figures"]


def test_coefficients_of_a_machine_file_are_counted() -> None:
    two = {"effect": "empirical", "place": ["q1"], "parameters": {"a": 1.0, "b": {"value": 2.0}}}
    assert coefficients({"effects": [two, two]}) == 4
    assert coefficients({"effects": None}) == coefficients({}) == 0


@given(st.floats(0.2, 5.0))
def test_standard_scores_scale_with_the_std(factor: float) -> None:
    held = HeldOut(("x", "rx"), ("mm", "rad"), (0.01, 0.001), tuple((1.0, 0.1) for _ in range(400)))
    z = np.random.default_rng(2).standard_normal((400, 2))
    said = pd.DataFrame(
        {
            "x": 1.0 + 0.02 * z[:, 0],
            "rx": np.degrees(0.1 + 0.003 * z[:, 1]),
            "x.std": 0.02 * factor,
            "rx.std": np.degrees(0.003 * factor),
        }
    )
    found = np.array(standard_scores(said, held)).reshape(-1, 2)
    assert np.allclose(found, z / factor, rtol=1e-3)
    assert standard_scores(said.drop(columns="x.std"), held) == ()


def test_scores_and_keys_are_plain_data(tmp_path: Path) -> None:
    adapter = TypeAdapter(Score)
    for one in _all(tmp_path):
        assert adapter.validate_json(adapter.dump_json(one)) == one


def test_a_score_is_read_from_the_files_of_drawn_cases_and_of_results(tmp_path: Path) -> None:
    drawn, sat = tmp_path / "drawn", tmp_path / "sat"
    (drawn / "answers").mkdir(parents=True)
    (sat / "results" / "case001").mkdir(parents=True)
    (drawn / "answers" / "case001.json").write_text(to_text(replace(key(PLAY), empirical=(5.0, 2.5))))
    own = sat / "results" / "case001"
    said = reply(tmp_path, "missing-physics", finding("backlash", "rho1"))
    (tmp_path / "diagnosis.json").rename(own / "diagnosis.json")
    pd.DataFrame({"x": [1.02, 2.02], "x.std": [0.01, 0.02]}).to_csv(own / "heldout_prediction.csv")
    (own / "improved.yaml").write_text("effects: [{effect: backlash, place: [rho1], parameters: {b: 1}}]")
    (own / "run.json").write_text('{"seconds": 2.0, "message": ""}')
    found = read_score(drawn, sat, "case001")
    assert said.findings and found.exact
    assert found.held_out == pytest.approx(2.0) and found.empirical_ratio == pytest.approx(0.8)
    assert (found.predicted.n, found.predicted.inside) == (2, 1)
    assert found.predicted.squares == pytest.approx(5.0, rel=1e-3)


def test_what_has_no_prediction_is_the_worst() -> None:
    assert quantile("q", [1.0, 2.0, np.inf], 0.5).value == 2.0
    assert quantile("q", [1.0] * 8 + [np.inf] * 2, 0.9).value == np.inf
    assert quantile("q", [1.0] * 9 + [np.inf], 0.9).value == 1.0
    assert between(0.8, 1.3).met(1.0) and not between(0.8, 1.3).met(1.4) and not between(0.8, 1.3).met(0.7)
