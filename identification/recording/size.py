"""How much a recording may hold."""

from __future__ import annotations

from truepose.errors import InputError
from truepose.models.limits import COLUMNS, LINE, ROWS


def check_size(file: str, columns: int, rows: int) -> None:
    """Refuse a table that would take minutes and gigabytes. Raises InputError."""
    if columns > COLUMNS:
        raise InputError(f"{file}: found {columns:,} columns, expected at most {COLUMNS:,}")
    if rows > ROWS:
        raise InputError(
            f"{file}: found {rows:,} rows, expected at most {ROWS:,}: average what was read at one pose, or split the file"
        )


def check_line(file: str, line: str) -> str:
    """The line, unless it is longer than any row. Raises InputError."""
    if len(line) > LINE:
        raise InputError(f"{file}: found a line of more than {LINE:,} characters, expected rows of cells")
    return line


__all__ = ["check_line", "check_size"]
