"""What commands say beside their files: a diagnosis in plain lines, displays on a terminal, files that cannot be written."""

from __future__ import annotations

import errno
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import pandas as pd
import pytest

from support.told_diagnoses import diagnosis, finding, fits
from truepose.commands import progress
from truepose.errors import InputError
from truepose.files import write_table
from truepose.identification.diagnosis.result import (
    BlockProof,
    Form,
    Proof,
    Remainder,
    Replication,
    SetOfEffects,
)
from truepose.identification.report import terminal as words
from truepose.identification.report.naming import FEW
from truepose.identification.report.verdict import doubts, headline


@pytest.mark.parametrize("parameters", [FEW, FEW + 3])
def test_a_finding_is_told_with_its_numbers_on_one_line_and_its_rivals(parameters: int) -> None:
    lines = words.diagnosis_lines(diagnosis("missing-physics", finding(0.9995, parameters)), Path("out"))
    assert lines[0] == "arm: physics is missing"
    assert "  backlash at q1, q2, over 99.9 %: They have play." in lines
    (numbers,) = (line for line in lines if " +- " in line or "rms;" in line or "orders" in line)
    assert numbers == (
        "    a0 = 0 +- 0.01, a1 = 1.5 +- 0.01 mm, a2 = 3 +- 0.01 mm"
        if parameters == FEW
        else "    a0, 0 rms; 5 orders, 7.87 mm rms"
    )
    assert "    could also be: friction-hysteresis at q2; something without a name" in lines
    assert "  chi2 per degree of freedom: free 1, before 12, after 1.01" in lines
    assert lines[-1] == f"report: {Path('out') / 'report.html'}"


def test_what_has_no_name_is_told_by_what_it_follows() -> None:
    remainder = Remainder((), "temperature.air", Form("linear", 0.4), 1.5)
    found = diagnosis("unknown", finding(0.5, 1), concealed=True, remainder=remainder, outlier_rows=(3, 17))
    lines = words.diagnosis_lines(found, Path("out"))
    first = "arm: something is missing; neither its place nor its driver is known, though the ordinary fit looked good"
    assert " ".join(line.strip() for line in lines).startswith(first)
    assert "  backlash at q1, q2, 50 %: They have play." in lines
    (at,) = (k for k, line in enumerate(lines) if line.startswith("  remainder follows temperature.air: "))
    form = f"{lines[at]} {lines[at + 1].strip()}"
    assert "linear in temperature.air; explains 40 % of the remainder; hypothesised" in form
    assert "  2 rows excluded as outliers: rows 3, 17" in lines


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
    text = " ".join(line.strip() for line in lines)
    for said in ("halves of the recording do not agree", "not name it (probability 5.0 %)", "known to 8.0 %"):
        assert said in text
    assert text.count("against it: ") == 5
    whole = doubts(found)
    assert len(whole) == 5 and "placebo" in whole[-1]
    assert "the outermost poses (12 rows) get worse: rms rises to 1.40" in whole[-2]
    assert "  likeliest sets: backlash at q1; zero-shift at q2 (41 %) | no effect (30 %)" in lines
    calm = replace(finding(0.9, 2), replication=Replication((0.8, 0.9), agree=True))
    assert not any(
        "against it" in line for line in words.diagnosis_lines(diagnosis("missing-physics", calm), Path())
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
    line = " ".join(said.strip() for said in words.diagnosis_lines(found, Path("out"))[:2])
    for told in (first, line):
        assert f"chi2 per degree of freedom {chi2:.2f}".rstrip("0") in told and reason in told


@pytest.mark.parametrize("chi2", [0.78, 1.0, 1.29, float("nan")])
def test_a_usual_misfit_is_not_worth_a_word(chi2: float) -> None:
    found = diagnosis("adequate", fits=fits(chi2), noise=1.0)
    assert "degree of freedom" not in headline(found)[0]


@pytest.mark.parametrize("on_terminal", [True, False])
def test_progress_is_shown_as_a_bar_on_a_terminal_only_and_never_on_standard_output(
    on_terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stream in (sys.stdout, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: on_terminal)
    monkeypatch.setattr(progress, "DELAY", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    shown = ""
    with progress.progress("calibrating") as say:
        for turn in range(500):  # ten seconds at most
            say(f"turn {turn}")
            shown += capsys.readouterr().err
            if "turn" in shown or "calibrating" in shown:
                break
            time.sleep(0.02)
    assert "calibrating" in shown or "turn" in shown
    assert ("\x1b" in shown) == on_terminal
    with progress.counted("sitting") as hear:
        for _ in range(500):
            hear(1, 2, "case001")
            out = capsys.readouterr()
            assert out.out == ""
            if "sitting: case001" in out.err:
                return
            time.sleep(0.02)
    raise AssertionError("nothing was shown of steps that are counted")


def test_a_table_that_cannot_be_written_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(InputError, match=r"table\.parquet: cannot write the file: No space left on device"):
        write_table(tmp_path / "table.parquet", pd.DataFrame({"a": [1.0]}))
    assert not list(tmp_path.iterdir())
