"""Rows that do not fit, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from truepose.identification.report.numbers import significant
from truepose.wording import shortened

ROWS, FILES = 10, 2
"""Most rows of a file, and most files, that are named."""


def far_row_words(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """``rows 12, 40 of r.csv do not fit: residuals of up to 30 sigma; look at them before the model is suspected``, by file.

    ``rows`` are those of ``fit.json``, farthest first.
    """
    files: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        files.setdefault(str(row["file"]), []).append(row)
    said = []
    for name, own in list(files.items())[:FILES]:
        numbers = shortened([str(row) for row in sorted(row["row"] for row in own)], ROWS)
        largest = significant(max(float(row["sigma"]) for row in own), 2)
        who, does, up_to = ("row", "does", "") if len(own) == 1 else ("rows", "do", "up to ")
        said.append(
            f"{who} {numbers} of {Path(name).name} {does} not fit: residuals of {up_to}{largest} sigma;"
            " look there before the model is suspected"
        )
    return said


def excluded_words(rows: Sequence[int], most: int) -> str:
    """Return ``1 row excluded as an outlier: row 7``, with at most so many numbers."""
    numbers = shortened([str(row) for row in rows], most)
    if len(rows) == 1:
        return f"1 row excluded as an outlier: row {numbers}"
    return f"{len(rows)} rows excluded as outliers: rows {numbers}"
