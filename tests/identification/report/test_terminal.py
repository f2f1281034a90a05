"""What a terminal shows of any diagnosis: at most 25 lines of 110 columns, and what to do next."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from support.examples import examples
from support.told_diagnoses import diagnosis, finding
from truepose.identification.diagnosis.result import (
    Alternative,
    Applied,
    Diagnosis,
    Finding,
    Form,
    Lead,
    Levels,
    PoseError,
    Quantity,
    Remainder,
    Replication,
    SetOfEffects,
)
from truepose.identification.report.naming import coefficient_words
from truepose.identification.report.lines import COLUMNS, LINES, listed, wrapped
from truepose.identification.report.naming import far_row_words
from truepose.identification.report.terminal import diagnosis_lines
from truepose.identification.signatures.untestable import Missing

OUT = Path("out")
WORDS = st.text(alphabet="abcdefgh ", min_size=1, max_size=400).map(lambda t: t.strip() or "a")
NAMES = st.sampled_from(["q1", "leg3.a.x", "a-place-with-quite-a-long-name", "sensor"])
PROBABILITY = st.floats(0.0, 1.0)
FORM = Form("linear", 0.4)


@st.composite
def findings(draw: st.DrawFn) -> Finding:
    place = tuple(draw(st.lists(NAMES, min_size=1, max_size=20)))
    rivals = [
        Alternative(draw(st.sampled_from(["backlash", "unknown"])), place, draw(PROBABILITY), 1.0)
        for _ in range(draw(st.integers(0, 8)))
    ]
    count = draw(st.sampled_from([0, 1, 3, 4, 126]))
    return Finding(
        effect=draw(st.sampled_from(["backlash", "empirical", "transmission-error", "wrong-constant"])),
        place=place,
        probability=draw(PROBABILITY),
        certainty=draw(PROBABILITY),
        log_bayes_factor=40.0,
        equivalents=tuple(rivals),
        parameters={f"{'ab'[k % 2]}{k // 2 + 1}": Quantity(1e-4 * k, 1e-5, "rad") for k in range(count)},
        settings=({},),
        flip_lambda=None,
        explanation=draw(WORDS),
        experiment=draw(WORDS),
        replication=draw(st.sampled_from([None, Replication((0.01, 0.9), agree=False)])),
        levels=Levels(draw(PROBABILITY), "load", draw(PROBABILITY)),
    )


@st.composite
def diagnoses(draw: st.DrawFn) -> Diagnosis:
    """Any: with many findings or none, long names and sentences, everything said or nothing."""
    verdict = draw(st.sampled_from(["adequate", "missing-physics", "unknown"]))
    found = draw(st.lists(findings(), max_size=12))
    pose = PoseError(0.4, 0.1)
    sets = tuple(SetOfEffects(((f.effect, f.place),), 0.3) for f in found[:4])
    more: dict[str, object] = {
        "concealed": draw(st.booleans()),
        "sets": sets,
        "leading": tuple(
            Lead("backlash", ("q1",), Levels(0.5, "load", 0.4), 0.3) for _ in range(draw(st.integers(0, 5)))
        ),
        "outlier_rows": tuple(range(draw(st.integers(0, 300)))),
        "missing": tuple(
            Missing(("joint-compliance",) * 3, draw(WORDS), draw(WORDS))
            for _ in range(draw(st.integers(0, 6)))
        ),
        "remainder": draw(st.sampled_from([None, Remainder(("q1",), "temperature.air", FORM, 1.5)])),
        "applied": draw(
            st.sampled_from([None, Applied("names", "role", pose, 0.5, PoseError(0.4, 0.9), 1.2)])
        ),
        "disagreement": draw(st.sampled_from([0.0, 0.2])),
        "noise": draw(st.sampled_from([1.0, 3.0])),
        "terms": draw(st.sampled_from([(), ("one",)])),
    }
    return diagnosis(verdict, *found, **more)


@settings(max_examples=examples(40))
@given(diagnoses())
def test_any_diagnosis_is_told_on_one_screen(found: Diagnosis) -> None:
    lines = diagnosis_lines(found, OUT)
    assert len(lines) <= LINES and max(map(len, lines)) <= COLUMNS
    assert lines[0].startswith("arm: ") and lines[-1] == f"report: {OUT / 'report.html'}"
    assert any(line.startswith("next: ") for line in lines) or found.verdict == "missing-physics"


@pytest.mark.parametrize("count", [1, 4, 30])
def test_findings_that_find_no_room_are_counted(count: int) -> None:
    lines = diagnosis_lines(diagnosis("missing-physics", *[finding(0.99, 3)] * count), OUT)
    told = sum(line.startswith("  backlash at ") for line in lines)
    more = [line for line in lines if line.endswith("more: see report.html") and line.startswith("  and ")]
    assert told >= 1 and more == ([f"  and {count - told} more: see report.html"] if told < count else [])


def test_before_and_after_are_told_in_the_unit_of_the_sensor() -> None:
    fits = {
        name: SimpleNamespace(
            chi2_per_dof=1.0, rms={"position": size}, validation_rms={"position": 2 * size}, **WORST
        )
        for name, size in (("free", 0.2), ("before", 0.219), ("after", 0.0575))
    }
    held = diagnosis("missing-physics", finding(0.99, 1), fits=fits, terms=("one",))
    sizes = "0.400 mm with the ordinary fit, 0.438 mm held to the drawing, 0.115 mm after"
    assert f"  position: {sizes} on held-out rows" in diagnosis_lines(held, OUT)
    for fit in fits.values():
        fit.validation_rms = None
    fitted = diagnosis("missing-physics", finding(0.99, 1), fits=fits, terms=("one",))
    sizes = "0.200 mm with the ordinary fit, 0.219 mm held to the drawing, 0.0575 mm after"
    assert f"  position: {sizes} on the fitted rows" in diagnosis_lines(fitted, OUT)
    nothing = diagnosis("adequate", fits=fits)
    assert "  position: 57.5 µm rms on the fitted rows" in diagnosis_lines(nothing, OUT)


WORST = {"worst_parameter_sigma": 1.0, "worst_allowed": 3.0}


def test_orders_of_a_wave_are_one_line_with_the_rms_of_the_wave() -> None:
    """Of sixty orders the rms over a turn, found by walking it."""
    rng = np.random.default_rng(3)
    sizes = rng.normal(0.0, 3e-5, (60, 2))
    told = {
        f"{letter}{k + 1}": Quantity(float(sizes[k, j]), 1e-6, "rad")
        for k in range(60)
        for j, letter in enumerate("ab")
    }
    angle = np.linspace(0.0, 2 * np.pi, 100_000, endpoint=False)
    wave = sum(
        sizes[k, 0] * np.sin((k + 1) * angle) + sizes[k, 1] * np.cos((k + 1) * angle) for k in range(60)
    )
    words = coefficient_words(told)
    count, rest = words.split(", ")
    assert count == "60 orders"
    assert float(rest.split()[0]) == pytest.approx(1e6 * np.sqrt(np.mean(wave**2)), rel=5e-3)  # three digits
    assert rest.split()[1:] == ["µrad", "rms"]


def test_what_to_do_next_follows_from_the_result() -> None:
    def steps(found: Diagnosis) -> str:
        said = ("next: ", "then: ", "  or: ")
        return "\n".join(line for line in diagnosis_lines(found, OUT) if line.startswith(said))

    applied = Applied("whole", "role", PoseError(0.4, 0.1), 0.5, PoseError(0.4, 0.1), 0.5)
    open_one = replace(finding(0.6, 1), experiment="reverse the joint by steps")
    undecided = steps(diagnosis("missing-physics", open_one, applied=applied))
    assert f"truepose plan MACHINE -n 40 -o poses.csv --diagnosis {OUT / 'diagnosis.json'}" in undecided
    assert "or: reverse the joint by steps" in undecided
    assert f"then: truepose codegen {OUT / 'improved.yaml'} -o controller" in undecided
    sure = steps(diagnosis("missing-physics", replace(finding(0.99, 1), equivalents=()), applied=applied))
    assert sure == f"next: truepose codegen {OUT / 'improved.yaml'} -o controller"
    assert "truepose check" in steps(diagnosis("unknown"))


def test_what_could_not_be_tested_is_told_with_what_would_change_it() -> None:
    lack = Missing(
        ("joint-compliance", "link-bending"), "no `gravity:` in kr6.yaml", "add `gravity: [0, 0, -9.81]`"
    )
    (line,) = (
        line for line in diagnosis_lines(diagnosis("adequate", missing=(lack,)), OUT) if "tested" in line
    )
    assert line == (
        "  could not be tested: joint-compliance and link-bending: no `gravity:` in kr6.yaml; add `gravity: [0, 0,"
    ) or line.endswith("add `gravity: [0, 0, -9.81]`")


def test_rows_that_do_not_fit_are_told_by_file() -> None:
    rows = [{"file": "day/r.csv", "row": 40, "sigma": 30.2}, {"file": "day/r.csv", "row": 12, "sigma": 28.0}]
    rows.append({"file": "s.csv", "row": 3, "sigma": 9.0})
    first, second = far_row_words(rows)
    assert first.startswith("rows 12, 40 of r.csv do not fit: residuals of up to 30 sigma;")
    assert second.startswith("row 3 of s.csv does not fit: residuals of 9.0 sigma;")
    assert far_row_words([]) == []


@given(st.lists(st.lists(st.just("x"), min_size=1, max_size=4), max_size=12), st.integers(0, 12))
def test_a_list_keeps_to_its_room_and_counts_the_rest(blocks: list[list[str]], room: int) -> None:
    out = listed(blocks, room)
    assert len(out) <= room
    if sum(map(len, blocks)) <= room:
        assert out == [line for block in blocks for line in block]
    elif room:
        kept = out[:-1]
        whole = next(k for k in range(len(blocks)) if sum(map(len, blocks[: k + 1])) > len(kept))
        assert out[-1] == f"  and {len(blocks) - whole} more: see report.html"


@given(WORDS, st.integers(0, 6), st.integers(1, 4))
def test_a_sentence_keeps_to_its_lines_and_says_where_it_was_cut(text: str, indent: int, most: int) -> None:
    lines = wrapped(text, indent, most)
    assert 1 <= len(lines) <= most and max(map(len, lines)) <= COLUMNS
    said = " ".join(line.strip() for line in lines)
    assert said.split() == text.split() or said.endswith(" ...") or said == "..."
