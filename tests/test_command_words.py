"""What commands say beside their files: a diagnosis in plain lines, displays on a terminal, files that cannot be written."""

from __future__ import annotations

import errno
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn, cast

import pandas as pd
import pytest
from truepose.identification.diagnosis.unnamed import UNNAMED

from truepose.commands import challenge, common
from truepose.errors import InputError
from truepose.files import write_table
from truepose.identification.diagnosis.result import (
    Alternative,
    Diagnosis,
    Finding,
    Form,
    Quantity,
    Remainder,
)
from truepose.identification.report import terminal as words


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
    fields = {"concealed": False, "remainder": None, "outlier_rows": ()} | others
    fits = {"before": SimpleNamespace(chi2_per_dof=12.0), "after": SimpleNamespace(chi2_per_dof=1.01)}
    machine = SimpleNamespace(name="arm")
    return cast(
        Diagnosis, SimpleNamespace(machine=machine, verdict=verdict, findings=findings, fits=fits, **fields)
    )


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
    assert lines[0] == "arm: something is missing, unnamed, though the ordinary fit looked good"
    assert "  backlash at q1, q2 (probability 50.0 %): They have play." in lines
    (form,) = (line for line in lines if line.startswith("  remainder follows temperature.air: "))
    assert form.endswith("linear in temperature.air; explains 40 % of the remainder; hypothesised")
    assert "  rows left out as outliers: 3, 17" in lines


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
