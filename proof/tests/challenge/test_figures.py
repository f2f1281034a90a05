"""Figures of an examination, what they are held against, and the tables that tell them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from challenge.figures import at_least, at_most, between, median, quantile
from challenge.findings import read_reply
from challenge.headline import headline
from challenge.score import score
from challenge.score_table import lines, markdown, table
from challenge.studies import page
from challenge.table_document import document
from proof_support.challenge_replies import PLAY, examination, finding, key, reply
from truepose.identification.report.json_text import json_text


def test_the_figures_of_a_small_examination(tmp_path: Path) -> None:
    figures = {f.name: f for f in headline(examination(tmp_path))}
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


def test_the_table_is_written_in_all_forms(tmp_path: Path) -> None:
    found = table(examination(tmp_path), ["case009: tiny: nothing"])
    text = markdown(found)
    assert text.count("| case001 |") == 7 and "crash" in text and "case009" in text
    for line in text.splitlines():
        assert not line.startswith("|") or line.endswith("|")
    assert len(lines(found)) == len(found.headline)
    assert json.loads(json_text(document(found)))["cases"] == 7
    assert markdown(table([])) and lines(table([]))


def test_the_page_holds_the_table_between_its_marks(tmp_path: Path) -> None:
    text = markdown(table(examination(tmp_path)))
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


def test_what_has_no_prediction_is_the_worst() -> None:
    assert quantile("q", [1.0, 2.0, np.inf], 0.5).value == 2.0
    assert quantile("q", [1.0] * 8 + [np.inf] * 2, 0.9).value == np.inf
    assert quantile("q", [1.0] * 9 + [np.inf], 0.9).value == 1.0
    assert between(0.8, 1.3).met(1.0) and not between(0.8, 1.3).met(1.4) and not between(0.8, 1.3).met(0.7)
