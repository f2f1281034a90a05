"""What commands say beside their files: a diagnosis in plain lines, displays on a terminal, files that cannot be written."""

from __future__ import annotations

import errno
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, cast

import pandas as pd
import pytest

from truepose.commands import challenge, common
from truepose.errors import InputError
from truepose.files import write_table
from truepose.identification.diagnosis.alarms import Alarm
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    BlockProof,
    Diagnosis,
    Finding,
    Form,
    Proof,
    Quantity,
    Remainder,
    Replication,
    SetOfEffects,
)
from truepose.identification.report import terminal as words
from truepose.identification.report.diagnosis_words import headline


def finding(probability: float, parameters: int) -> Finding:
    """One of so many parameters, with a rival that has a name and one that has none."""
    return Finding(
        effect="backlash",
        place=("q1", "q2"),
        probability=probability,
        certainty=0.99,
        log_bayes_factor=40.0,
        equivalents=(
            Alternative("friction-hysteresis", ("q2",), 0.1, 38.0),
            Alternative(UNNAMED, ("q2",), 0.01, 36.0),
        ),
        parameters={f"a{k}": Quantity(1.5 * k, 0.01, "mm" if k else "1") for k in range(parameters)},
        settings=({},),
        prior_dependent=False,
        flip_lambda=None,
        explanation="They have play.",
        experiment="",
    )


def diagnosis(verdict: str, *findings: Finding, **others: object) -> Diagnosis:
    quiet: dict[str, object] = {
        "concealed": False,
        "remainder": None,
        "outlier_rows": (),
        "terms": (),
        "sets": (),
        "leading": (),
        "untestable": (),
        "applied": None,
    }
    quiet |= {
        "proof": None,
        "disagreement": 0.0,
        "noise": 1.0,
        "structure": SimpleNamespace(alarm=Alarm(0.1, 0.5)),
    }
    quiet |= {
        "fits": fits(1.01),
        "machine": SimpleNamespace(name="arm"),
        "verdict": verdict,
        "findings": findings,
    }
    return cast(Diagnosis, SimpleNamespace(**quiet | others))


def fits(after: float) -> dict[str, object]:
    one = {"worst_parameter_sigma": 1.0, "worst_allowed": 3.0}
    return {
        name: SimpleNamespace(chi2_per_dof=chi2, **one) for name, chi2 in (("before", 12.0), ("after", after))
    }


@pytest.mark.parametrize("parameters", [words.SHOWN, words.SHOWN + 3])
def test_a_finding_is_told_with_its_first_numbers_and_its_rivals(parameters: int) -> None:
    lines = words.diagnosis_lines(diagnosis("missing-physics", finding(0.9995, parameters)), Path("out"))
    assert lines[0] == "arm: physics is missing"
    assert "  backlash at q1, q2 (probability > 99.9 %): They have play." in lines
    assert "    a0 = 0 +- 0.01" in lines and "    a1 = 1.5 +- 0.01 mm" in lines
    assert sum(" +- " in line for line in lines) == words.SHOWN
    assert ("    and 3 more in diagnosis.json" in lines) == (parameters > words.SHOWN)
    assert "    could also be: friction-hysteresis at q2; something without a name" in lines
    assert lines[-2:] == [
        "  chi2 per degree of freedom: before 12, after 1.01",
        f"report: {Path('out') / 'report.html'}",
    ]


def test_what_has_no_name_is_told_by_what_it_follows() -> None:
    remainder = Remainder((), "temperature.air", Form("linear", 0.4), 1.5)
    found = diagnosis("unknown", finding(0.5, 1), concealed=True, remainder=remainder, outlier_rows=(3, 17))
    lines = words.diagnosis_lines(found, Path("out"))
    assert (
        lines[0]
        == "arm: something is missing; neither its place nor its driver is known, though the ordinary fit looked good"
    )
    assert "  backlash at q1, q2 (probability 50.0 %): They have play." in lines
    (form,) = (line for line in lines if line.startswith("  remainder follows temperature.air: "))
    assert form.endswith("linear in temperature.air; explains 40 % of the remainder; hypothesised")
    assert "  rows left out as outliers: 3, 17" in lines


def test_what_speaks_against_a_name_and_what_else_is_likely_is_told() -> None:
    """Halves that disagree or of which one alone is silent, blocks that get worse, a placebo, chains that differ."""
    loud = replace(finding(0.9, 2), replication=Replication((0.99, 0.9), agree=False))
    quiet = replace(finding(0.9, 2), effect="zero-shift", replication=Replication((0.05, 0.9), agree=True))
    blocks = (BlockProof("outermost poses", 12, 1.4), BlockProof("quarter 1", 10, 0.4))
    found = diagnosis(
        "missing-physics",
        loud,
        quiet,
        proof=Proof("blocks", blocks, 0.5, (0.4, 0.6), 9.0, 0.9, True),
        disagreement=0.08,
        sets=(SetOfEffects((("backlash", ("q1",)), ("zero-shift", ("q2",))), 0.41), SetOfEffects((), 0.3)),
    )
    lines = words.diagnosis_lines(found, Path("out"))
    against = [line.removeprefix("  speaks against it: ") for line in lines if "speaks against it" in line]
    assert len(against) == 5
    for said, told in zip(
        ("halves of the recording do not agree", "not name it (probability 5.0 %)", "known to 8.0 %", "the outermost poses"
         " (12 rows) get worse: rms rises to 1.40", "placebo"),
        against,
        strict=True,
    ):  # fmt: skip
        assert said in told
    assert "  likeliest sets: backlash at q1; zero-shift at q2 (41.0 %) | no effect (30.0 %)" in lines
    calm = replace(finding(0.9, 2), replication=Replication((0.8, 0.9), agree=True))
    assert not any(
        "against" in line for line in words.diagnosis_lines(diagnosis("missing-physics", calm), Path())
    )


MISFITS = [
    (
        "adequate",
        1.9,
        1.4,
        (),
        "a stated sigma that is too small (1.4 times): noise of that size explains it",
    ),
    ("adequate", 1.9, 1.0, (), "something missing: noise does not explain it"),
    ("unknown", 1.9, 1.4, (), "something missing"),
    ("missing-physics", 1.9, 1.4, ("name",), "for something smaller beside what is named"),
    ("missing-physics", 4.0, 1.4, ("name",), "something missing"),
    ("adequate", 0.5, 0.7, (), "a stated sigma that is too large (residuals are 0.71 of it)"),
    ("adequate", 0.5, 1.0, (), "a stated sigma that is too large"),
]


@pytest.mark.parametrize(("verdict", "chi2", "noise", "names", "reason"), MISFITS)
def test_a_misfit_far_from_noise_is_said_in_the_first_sentence(
    verdict: str, chi2: float, noise: float, names: tuple[str, ...], reason: str
) -> None:
    """In both directions, with what speaks for a misstated sigma and what for something missing."""
    findings = [finding(0.99, 1) for _ in names]
    found = diagnosis(verdict, *findings, fits=fits(chi2), noise=noise)
    first = headline(found)[0].partition(". ")[0]
    (line, *_) = words.diagnosis_lines(found, Path("out"))
    for told in (first, line):
        assert f"chi2 per degree of freedom {chi2:.2f}".rstrip("0") in told and reason in told


@pytest.mark.parametrize("chi2", [0.78, 1.0, 1.29, float("nan")])
def test_a_usual_misfit_is_not_worth_a_word(chi2: float) -> None:
    found = diagnosis("adequate", fits=fits(chi2), noise=1.0)
    assert "degree of freedom" not in headline(found)[0]


@pytest.mark.parametrize("on_terminal", [True, False])
def test_progress_is_shown_on_a_terminal_only_and_never_on_standard_output(
    on_terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stream in (sys.stdout, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: on_terminal)
    monkeypatch.setattr(common, "DELAY", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    shown = ""
    with common.progress("calibrating") as say:
        for turn in range(500 if on_terminal else 1):  # ten seconds at most
            say(f"turn {turn}")
            shown += capsys.readouterr().err
            if "turn" in shown or "calibrating" in shown:
                break
            time.sleep(0.02)
    with challenge._bar("sitting") as hear:
        hear(1, 2, "case001")
    out = capsys.readouterr()
    assert out.out == ""
    assert ("calibrating" in shown or "turn" in shown) == on_terminal
    assert ("sitting: case001" in out.err) == on_terminal


def test_a_table_that_cannot_be_written_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(InputError, match=r"table\.parquet: cannot write the file: No space left on device"):
        write_table(tmp_path / "table.parquet", pd.DataFrame({"a": [1.0]}))
    assert not list(tmp_path.iterdir())
