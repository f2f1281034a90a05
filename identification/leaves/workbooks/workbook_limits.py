"""An .xlsx looked at before it is read: what its parts inflate to, and how far its cells reach.

A workbook is a zip of XML. A few kilobytes may inflate to gigabytes, and one cell in the last corner of a sheet makes it a
table of sixteen billion cells, which the reader lays out in full.
"""

from __future__ import annotations

import re
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from truepose.errors import InputError

INFLATED_MOST: Final = 100 << 20
"""Bytes that the parts of a workbook may inflate to: 100 MiB, some three million cells."""
PARTS_MOST: Final = 2000
"""Files in the zip."""
CELLS_MOST: Final = 5_000_000
"""Cells of a sheet from the first corner to the last cell."""
_PIECE: Final = 1 << 20
_REFERENCE: Final = re.compile(rb"\br\s*+=\s*+[\"']([A-Za-z]{0,3})([0-9]{1,9})[\"']")
_CELL: Final = re.compile(rb"<(?:\w+:)?c[\s/>]")


@dataclass
class _Reach:
    """The last row and column that a sheet names, and its cells with and without a name."""

    row: int = 1
    column: int = 1
    cells: int = 0
    named: int = 0

    def add(self, data: bytes) -> None:
        self.cells += len(_CELL.findall(data))
        for letters, digits in _REFERENCE.findall(data):
            self.row = max(self.row, int(digits))
            if letters:
                self.named += 1
                self.column = max(self.column, _column(letters))

    @property
    def size(self) -> int:
        """Cells of the table: those without a name may all stand in one row."""
        return self.row * max(self.column, self.cells - self.named)


def check_workbook(path: Path) -> None:
    """Raise InputError for an .xlsx that inflates, or reaches, beyond the limits, and for a broken zip."""
    if not zipfile.is_zipfile(path):
        return  # an .xls, or no workbook: the reader says so
    try:
        with zipfile.ZipFile(path) as book:
            parts = book.infolist()
            if len(parts) > PARTS_MOST:
                raise InputError(
                    f"{path}: found {len(parts)} parts of a workbook, expected at most {PARTS_MOST}"
                )
            left = INFLATED_MOST
            for part in parts:
                left -= _inflated(book, part, left, path)
    except (
        zipfile.BadZipFile,
        zlib.error,
        OSError,
        EOFError,
        NotImplementedError,
        RuntimeError,
        ValueError,
    ) as exc:
        raise InputError(f"{path}: cannot read the file: no Excel workbook ({str(exc)[:200]})") from None


def _inflated(book: zipfile.ZipFile, part: zipfile.ZipInfo, left: int, path: Path) -> int:
    """Bytes of a part, whatever the zip says of them; at most ``left``."""
    part.file_size = left + 2 * _PIECE  # read what is there, beyond what is allowed
    reach, count, tail = _Reach(), 0, b""
    with book.open(part) as stream:
        while data := stream.read(_PIECE):
            count += len(data)
            if count > left:
                found = f"a workbook that inflates to more than {INFLATED_MOST >> 20} MiB"
                raise InputError(f"{path}: found {found}, expected at most that; save the sheet as CSV")
            whole, mark, rest = (tail + data).rpartition(b"<")  # a tag may go on in what follows
            reach.add(whole)
            tail = (mark + rest)[:_PIECE]
    reach.add(tail)
    if reach.size > CELLS_MOST:
        found = f"a sheet whose cells reach to row {reach.row} and column {reach.column}"
        raise InputError(f"{path}: found {found}, expected at most {CELLS_MOST} cells up to the last one")
    return count


def _column(letters: bytes) -> int:
    out = 0
    for letter in letters.upper():
        out = 26 * out + letter - ord("A") + 1
    return out
