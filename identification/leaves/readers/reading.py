"""Kinds of files that are read as tables beside text and Parquet: ROS bags, and Excel workbooks.

Workbooks (.xlsx, .xls) are read by python-calamine (extra ``excel``): the one sheet that holds something.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from truepose.errors import InputError
from truepose.identification.leaves.readers.bags import is_bag, read_bag
from truepose.identification.recording.text import TextTable
from truepose.wording import cut, shortened

MAGIC = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1")
"""What .xlsx and .xls begin with."""


def read_cells(path: Path, readings: Sequence[str]) -> TextTable | None:
    """Return the cells of a bag, a row for each stretch in which all joints stand, or of a workbook; None for other files."""
    if is_bag(path):
        return read_bag(path, None, (), readings)
    with path.open("rb") as stream:
        workbook = stream.read(8).startswith(MAGIC)
    return read_spreadsheet(path) if workbook else None


def read_spreadsheet(path: Path) -> TextTable:
    """Return the first row that is no comment as headers, all further ones as rows; an empty cell is None.

    Raises InputError without python-calamine, for what is no workbook, and for several sheets with data.
    """
    try:
        import python_calamine as calamine
    except ImportError:
        raise InputError(
            f"{path}: an Excel workbook needs python-calamine: pip install 'truepose[excel]'"
        ) from None
    try:
        with calamine.CalamineWorkbook.from_path(path) as book:
            sheets = {
                name: book.get_sheet_by_name(name).to_python(skip_empty_area=False)
                for name in book.sheet_names
            }
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as exc:  # its reader is Rust, whose panics are no Exception
        reason = cut(str(exc) or repr(exc))
        raise InputError(f"{path}: cannot read the file: no Excel workbook ({reason})") from None
    full = {name: rows for name, rows in sheets.items() if any(map(_is_said, rows))}
    if len(full) != 1:
        found = shortened([repr(cut(name, 60)) for name in full], 8) or "none"
        raise InputError(f"{path}: found sheets with data: {found}; expected one")
    kept = [(k, row) for k, row in enumerate(next(iter(full.values())), start=1) if _is_said(row)]
    if not kept:
        raise InputError(f"{path}: found no header, expected a row with the names of the columns")
    (_, header), *rows = kept
    lines = [k for k, _ in rows]
    cells = [[None if cell == "" else cell for cell in row] for _, row in rows]
    used = [
        k for k, name in enumerate(header) if str(name).strip() or any(row[k] is not None for row in cells)
    ]
    return TextTable(
        [str(header[k]) for k in used], [[row[k] for row in cells] for k in used], lines.__getitem__
    )


def _is_said(row: Sequence[object]) -> bool:
    """Return True if a row is neither empty nor a comment."""
    first = next((str(cell) for cell in row if str(cell).strip()), "#")
    return not first.lstrip().startswith("#")
