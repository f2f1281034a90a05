"""Errors, ratios and probabilities that a score holds, and the files that it is read from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from scipy.stats import norm

from challenge.calibration import brier, calibration_error, honest_error, reliability, wilson
from challenge.headline import headline
from challenge.measures import held_out_error, parameter_bias, standard_scores
from challenge.predictions import Predicted, coefficients
from challenge.score import Score, read_score, score
from challenge.score_table import table
from challenge.solutions import HeldOut, to_text
from challenge.statements import Statement
from challenge.table_document import document
from proof_support.challenge_replies import BEAT, GEOMETRY, HELD, PLAY, examination, finding, key, reply
from truepose.identification.report.json_text import json_text


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


def test_scores_and_keys_are_plain_data(tmp_path: Path) -> None:
    adapter = TypeAdapter(Score)
    for one in examination(tmp_path):
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
