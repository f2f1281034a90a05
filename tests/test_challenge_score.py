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
from scipy.stats import norm

from truepose.challenge.calibration import brier, reliability, wilson
from truepose.challenge.figures import at_least, at_most, headline, median
from truepose.challenge.findings import Reply, read_reply
from truepose.challenge.measures import held_out_error, parameter_bias
from truepose.challenge.score import Score, Statement, score
from truepose.challenge.score_table import document, lines, markdown, table
from truepose.challenge.solutions import Geometry, HeldOut, Reference, Solution, Truth
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
    found = score(key(PLAY), reply(tmp_path, "missing-physics", finding("backlash", "rho1")), held_out=1.3)
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


def _all(tmp_path: Path) -> list[Score]:
    named = reply(tmp_path, "missing-physics", finding("backlash", "rho1"))
    out = [score(key(), reply(tmp_path, "adequate"), held_out=4.0), score(key(), None, failure="crash")]
    out += [score(key(PLAY, stratum=s), named, held_out=1.2) for s in ("single", "concealed", "look-alike")]
    out.append(score(key(PLAY, BEND, stratum="two"), named, held_out=2.0))
    return [*out, score(key(BEAT, stratum="out-of-library"), reply(tmp_path, "unknown"))]


def test_the_figures_of_a_small_examination(tmp_path: Path) -> None:
    figures = {f.name: f for f in headline(_all(tmp_path))}
    assert (figures["false alarms, null and decoys"].hits, figures["false alarms, null and decoys"].n) == (
        1,
        2,
    )
    assert figures["concealed: detected and named"].value == 1.0
    assert figures["top effect, from 3 limits on"].n == 4
    assert figures["two effects: exact pair"].met is False
    assert figures["out of library: unknown or honest"].met is True
    assert figures["no diagnosis, or no prediction"].hits == 1
    ratio = figures["held-out error over the oracle's, median"]
    assert ratio.n == 4 and ratio.met is True


def test_effects_below_three_limits_are_apart(tmp_path: Path) -> None:
    faint = score(key(replace(PLAY, size=1.0)), reply(tmp_path, "adequate"))
    assert {f.name: f.n for f in headline([faint])}["top effect, from 3 limits on"] == 0
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


def test_targets_and_medians() -> None:
    assert at_least(0.9).met(0.9) and not at_least(0.9).met(0.8)
    assert at_most(0.05).met(0.05) and not at_most(0.05).met(0.06)
    middle = median("m", [1.0, 2.0, None, float("nan"), 9.0])
    assert (middle.value, middle.n) == (2.0, 3)
    assert middle.interval is not None and middle.interval[0] <= 2.0 <= middle.interval[1]
