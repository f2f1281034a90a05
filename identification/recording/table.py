"""Tables of measured rows, from CSV or Parquet: headers, cells, and what is wrong with them.

Nothing here knows a robot. `read_table` keeps the cells as they stand; `Table.numbers`, `integers` and
`texts` turn a column into values and refuse, naming file, row and column, whatever is not one. Rows count
from 1: the first line of data. Large files are read by whole columns (`arrow_columns`).
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]

from truepose.errors import InputError
from truepose.identification.recording.arrow_columns import ArrowCells, read_plain_csv
from truepose.models.units import FloatArray, parse_unit

LARGE = 1 << 20
"""Bytes from which a text is read by columns."""
_HEADER: Final = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]$")
_PARQUET_MAGIC: Final = b"PAR1"
_LARGEST_INTEGER: Final = 2**53  # beyond it a float holds no odd number


@dataclass(frozen=True)
class Column:
    """A header: the column's name, and the unit its suffix gives (``x [um]``), None without one."""

    name: str
    unit: str | None = None


@dataclass(frozen=True)
class Table:
    """Cells of one file as they stand: text in CSV; number, text, bool or None in Parquet."""

    file: str
    columns: tuple[Column, ...]
    cells: Mapping[str, Sequence[object]]
    n_rows: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, without units."""
        return tuple(column.name for column in self.columns)

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def where(self, name: str, row: int | None = None) -> str:
        """Opening of a message about a column, or about its cell in 0-based `row`."""
        place = f"{self.file}: " if row is None else f"{self.file}: row {row + 1}, "
        return f"{place}column {name!r}"

    def unit(self, name: str, default: str, dimension: str) -> str:
        """The unit a column is in: its suffix, else `default`. Checked to be a `dimension`."""
        unit = next(column.unit for column in self.columns if column.name == name)
        return default if unit is None else parse_unit(unit, dimension, self.where(name))

    def numbers(self, name: str) -> FloatArray:
        """(n,) finite numbers of a column. Raises InputError for text, an empty cell, NaN or infinity."""
        cells = self.cells[name]
        plain = cells.numbers() if isinstance(cells, ArrowCells) else None
        if plain is not None:
            return plain
        values = np.array([_number(cell) for cell in cells], dtype=np.float64)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            row = int(bad[0])
            raise InputError(f"{self.where(name, row)}: {_fault(cells[row])}, expected a finite number")
        return values

    def integers(self, name: str) -> npt.NDArray[np.int64]:
        """(n,) whole numbers of a column."""
        values = self.numbers(name)
        bad = np.flatnonzero((values != np.round(values)) | (np.abs(values) > _LARGEST_INTEGER))
        if bad.size:
            row = int(bad[0])
            raise InputError(f"{self.where(name, row)}: found {values[row]:g}, expected a whole number")
        return values.astype(np.int64)

    def texts(self, name: str) -> tuple[str, ...]:
        """A column as labels that are not empty, (n,)."""
        labels = tuple("" if cell is None else _label(cell) for cell in self.cells[name])
        if "" in labels:
            raise InputError(f"{self.where(name, labels.index(''))}: found an empty cell, expected a label")
        return labels

    def with_numbers(self, added: Mapping[str, FloatArray]) -> Table:
        """The table with further columns (n,) at its end."""
        columns = (*self.columns, *(Column(name) for name in added))
        cells = {name: ArrowCells(values) for name, values in added.items()}
        return replace(self, columns=columns, cells={**self.cells, **cells})


def read_table(path: Path | str) -> Table:
    """Read CSV (comma, ``#`` comments) or Parquet, told apart by content.

    Raises InputError for an unreadable file, a row of the wrong length, a column given twice (also
    ``x`` and ``x [um]``) and a table without rows.
    """
    file = str(path)
    try:
        headers, columns = _read(Path(path))
    except OSError as exc:
        reason = exc.strerror or str(exc)
        raise InputError(f"{file}: cannot read the file: {reason}") from None
    except UnicodeDecodeError:
        raise InputError(f"{file}: cannot read the file: neither text in UTF-8 nor Parquet") from None
    except (csv.Error, pa.ArrowException) as exc:
        raise InputError(f"{file}: cannot read the file: {str(exc).splitlines()[0]}") from None
    parsed = tuple(_parse_header(header) for header in headers)
    _refuse_duplicates(file, parsed)
    cells = {column.name: values for column, values in zip(parsed, columns, strict=True)}
    n_rows = len(columns[0]) if columns else 0
    if n_rows == 0:
        raise InputError(f"{file}: found no row of data, expected at least one")
    return Table(file, parsed, cells, n_rows)


def _read(path: Path) -> tuple[list[str], Sequence[Sequence[object]]]:
    """Headers, and cells column by column."""
    with path.open("rb") as stream:
        if stream.read(4) == _PARQUET_MAGIC:
            return _read_parquet(path)
    plain = read_plain_csv(path.read_bytes()) if path.stat().st_size >= LARGE else None
    return _read_csv(path) if plain is None else plain


def _parse_header(header: str) -> Column:
    match = _HEADER.match(header.strip())
    return Column(match["name"], match["unit"].strip()) if match else Column(header.strip())


def _refuse_duplicates(file: str, columns: Sequence[Column]) -> None:
    seen: set[str] = set()
    for column in columns:
        if column.name in seen and column.name:
            raise InputError(f"{file}: column {column.name!r}: found twice, expected once")
        seen.add(column.name)


def _data_lines(stream: Iterator[str]) -> Iterator[str]:
    return (line for line in stream if line.strip() and not line.lstrip().startswith("#"))


def _read_csv(path: Path) -> tuple[list[str], list[list[object]]]:
    with path.open(encoding="utf-8-sig", newline="") as stream:
        reader = csv.reader(_data_lines(stream), strict=True)
        headers = next(reader, [])
        rows = list(reader)
    if not headers:
        raise InputError(f"{path}: found no header, expected a line with the names of the columns")
    if len(headers) == 1 and (";" in headers[0] or "\t" in headers[0]):
        raise InputError(
            f"{path}: found {headers[0][:40]!r} as the only column, expected commas between columns"
        )
    for number, row in enumerate(rows, start=1):
        if len(row) != len(headers):
            raise InputError(f"{path}: row {number}: found {len(row)} cells, expected {len(headers)}")
    columns: list[list[object]] = [[row[k] for row in rows] for k in range(len(headers))]
    return headers, columns


def _read_parquet(path: Path) -> tuple[list[str], list[ArrowCells]]:
    table: Any = pq.ParquetFile(path).read()
    return list(table.column_names), [ArrowCells(column) for column in table.columns]


def _number(cell: object) -> float:
    """The number in a cell, NaN when there is none."""
    if isinstance(cell, str):
        if "_" in cell:  # Python reads 1_000, nobody measures it
            return math.nan
        try:
            return float(cell)
        except ValueError:
            return math.nan
    if isinstance(cell, (int, float)) and not isinstance(cell, bool):
        return float(cell)
    return math.nan


def _fault(cell: object) -> str:
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return "found an empty cell"
    return f"found {cell.strip() if isinstance(cell, str) else cell!r}"


def _label(cell: object) -> str:
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return str(cell).strip()
