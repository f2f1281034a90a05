"""Tables that cannot be written."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any, NoReturn

import pandas as pd
import pytest

from support.told_diagnoses import diagnosis, finding, fits
from truepose.errors import InputError
from truepose.files import write_table
from truepose.identification.report.verdict import headline

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
    assert f"chi2 per degree of freedom {chi2:.2f}".rstrip("0") in first and reason in first


@pytest.mark.parametrize("chi2", [0.78, 1.0, 1.29, float("nan")])
def test_a_usual_misfit_is_not_worth_a_word(chi2: float) -> None:
    found = diagnosis("adequate", fits=fits(chi2), noise=1.0)
    assert "degree of freedom" not in headline(found)[0]


def test_a_table_that_cannot_be_written_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(InputError, match=r"table\.parquet: cannot write the file: No space left on device"):
        write_table(tmp_path / "table.parquet", pd.DataFrame({"a": [1.0]}))
    assert not list(tmp_path.iterdir())
