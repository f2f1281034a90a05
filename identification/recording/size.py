"""How much a recording may hold."""

from __future__ import annotations

from pathlib import Path

from truepose.errors import InputError
from truepose.models.file.limits import COLUMNS, LINE, RECORDING_BYTES, ROWS


def check_file(path: Path) -> None:
    """Refuse what has no end, such as a device, and what would take minutes to read. Raises InputError."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: expected a file, found a device or a pipe")
    if path.is_file() and path.stat().st_size > RECORDING_BYTES:
        raise InputError(
            f"{path}: found {path.stat().st_size / 1e9:.1f} GB, expected at most {RECORDING_BYTES / 1e9:.1f} GB"
        )


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
