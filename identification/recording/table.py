"""Tables of measured rows, from text, Parquet, Excel or memory: headers, cells, and what is wrong with them.

Nothing here knows a robot. `read_table` keeps the cells as they stand; `Table.numbers`, `integers` and
`texts` turn a column into values and refuse, naming file, row and column, whatever is not one. Rows count
from 1: the first line of data; messages add the line of the file.

Names of columns as people write them: case, units glued on with an underscore, letters swapped.
"""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.files import check_input
from truepose.identification.recording.text import SI, ArrowCells, TextTable, digest_of, read_text
from truepose.leaves import modules_named
from truepose.models.units import is_unit, parse_unit
from truepose.wording import close_matches, meant

_SI_UNITS: Final = {"mm": "m", "rad": "rad"}
_PARQUET_MAGIC: Final = b"PAR1"
_LARGEST_INTEGER: Final = 2**53  # beyond it a float holds no odd number


@dataclass(frozen=True)
class Column:
    """A header: the column's name, and the unit its suffix gives (``x [um]``), None without one."""

    name: str
    unit: str | None = None

    @property
    def header(self) -> str:
        """The header as a file has it."""
        return self.name if self.unit is None else f"{self.name} [{self.unit}]"


@dataclass(frozen=True)
class Table:
    """Cells of one file as they stand: text in CSV; number, text, bool or None elsewhere.

    `line` gives the line of the file that a 0-based row stands on, None where there are no lines. `digest`: SHA-256 of the
    file; `date`: the day that its comments name, both empty where there is none; `shuffled`: they say so of the rows.
    """

    file: str
    columns: tuple[Column, ...]
    cells: Mapping[str, Sequence[object]]
    n_rows: int
    line: Callable[[int], int] | None = None
    notes: tuple[str, ...] = ()
    digest: str = ""
    date: str = ""
    shuffled: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns, without units."""
        return tuple(column.name for column in self.columns)

    @property
    def stated_units(self) -> dict[str, str | None]:
        """Units that headers give, by the columns' names; None without one."""
        return {column.name: column.unit for column in self.columns}

    def __contains__(self, name: str) -> bool:
        return name in self.cells

    def where(self, name: str, row: int | None = None) -> str:
        """Opening of a message about a column, or about its cell in 0-based `row`."""
        if row is None:
            return f"{self.file}: column {name!r}"
        line = "" if self.line is None else f" (line {self.line(row)})"
        return f"{self.file}: row {row + 1}{line}, column {name!r}"

    def refuse(self, name: str, wrong: Mask, found: Callable[[int], str], expected: str) -> None:
        """Raise InputError about the first row (0-based) of a column that is ``wrong`` (n,), if there is one."""
        rows = np.flatnonzero(wrong).tolist()
        if rows:
            raise InputError(f"{self.where(name, rows[0])}: found {found(rows[0])}, expected {expected}")

    def unit(self, name: str, default: str, dimension: str) -> str:
        """The unit a column is in: its suffix, else `default`. Checked to be a `dimension`."""
        unit = self.stated_units[name]
        if unit == SI:
            return _SI_UNITS.get(dimension, default)
        return default if unit is None else parse_unit(unit, dimension, self.where(name))

    def numbers(self, name: str) -> Array:
        """(n,) finite numbers of a column. Raises InputError for text, an empty cell, NaN or infinity."""
        return self._numbers(name, lost=False)

    def readings(self, name: str) -> Array:
        """(n,) numbers of a column, NaN where its cell is empty: a reading that was lost.

        Outside of texts NaN is an empty cell. Raises InputError for text, infinity, and `nan` as a text.
        """
        return self._numbers(name, lost=True)

    def _numbers(self, name: str, *, lost: bool) -> Array:
        cells = self.cells[name]
        plain = cells.numbers(lost=lost) if isinstance(cells, ArrowCells) else None
        if plain is not None:
            return plain
        values = np.empty(len(cells))
        for row, cell in enumerate(cells):
            values[row] = _number(cell)
            if not math.isfinite(values[row]) and not (lost and _empty(cell)):
                hint = "; leave the cell empty where a reading was lost" if lost else ""
                raise InputError(f"{self.where(name, row)}: {_fault(cell)}, expected a finite number{hint}")
        return values

    def integers(self, name: str) -> npt.NDArray[np.int64]:
        """(n,) whole numbers of a column."""
        values = self.numbers(name)
        wrong = (values != np.round(values)) | (np.abs(values) > _LARGEST_INTEGER)
        self.refuse(name, wrong, lambda row: f"{values[row]:g}", "a whole number")
        return values.astype(np.int64)

    def texts(self, name: str) -> tuple[str, ...]:
        """A column as labels that are not empty, (n,)."""
        labels = tuple("" if cell is None else _label(cell) for cell in self.cells[name])
        if "" in labels:
            raise InputError(f"{self.where(name, labels.index(''))}: found an empty cell, expected a label")
        return labels

    def is_empty(self, name: str) -> bool:
        """Whether a column is there and holds nothing, as in a form that was not filled in."""
        return name in self and all(_empty(cell) for cell in self.cells[name])

    def with_numbers(self, added: Mapping[str, Array]) -> Table:
        """The table with further columns (n,) at its end."""
        columns = (*self.columns, *(Column(name) for name in added))
        cells = {name: ArrowCells(values) for name, values in added.items()}
        return replace(self, columns=columns, cells={**self.cells, **cells})

    def renamed(self, names: Mapping[str, str]) -> Table:
        """The table with other names for some of its columns."""
        columns = tuple(replace(c, name=names.get(c.name, c.name)) for c in self.columns)
        return replace(self, columns=columns, cells={names.get(n, n): c for n, c in self.cells.items()})

    def with_note(self, note: str) -> Table:
        """The table with one more note."""
        return replace(self, notes=(*self.notes, note))

    def without(self, names: Sequence[str]) -> Table:
        """The table without some of its columns."""
        columns = tuple(column for column in self.columns if column.name not in names)
        return replace(self, columns=columns, cells={n: c for n, c in self.cells.items() if n not in names})


def read_table(path: Path | str, readings: Sequence[str] = ()) -> Table:
    """Read text (columns apart by commas, semicolons, tabs or spaces; ``#`` comments), Parquet, Excel or a ROS bag.

    Kinds are told apart by content. ``readings``: a machine's joints; others of a bag then do not matter.
    Raises InputError for an unreadable or ambiguous file, a row of the wrong length, a column given twice (also ``x`` and
    ``x [um]``) and a table without rows.
    """
    file = str(path)
    try:
        return replace(_read(Path(path), readings), digest=digest_of(Path(path)))
    except OSError as exc:
        reason = exc.strerror or str(exc)
        raise InputError(f"{file}: cannot read the file: {reason}") from None
    except (csv.Error, pa.ArrowException) as exc:
        raise InputError(f"{file}: cannot read the file: {str(exc).splitlines()[0]}") from None
    except UnicodeDecodeError:  # names of columns in Parquet are bytes
        raise InputError(f"{file}: cannot read the file: found a name that is no text in UTF-8") from None


def table_in_memory(source: Any, name: str) -> Table:
    """A DataFrame, a dict of columns or an Arrow table as a table; ``name`` opens messages. Raises InputError."""
    headers, columns = _columns_of(source, name)
    return table_of(name, TextTable(headers, columns))


def _read(path: Path, readings: Sequence[str]) -> Table:
    file = str(path)
    check_input(path)
    for leaf in modules_named("reading"):
        found: TextTable | None = leaf.read_cells(path, readings)
        if found is not None:
            return table_of(file, found)
    with path.open("rb") as stream:
        start = stream.read(8)
    if start.startswith(_PARQUET_MAGIC):
        with pq.ParquetFile(path) as parquet:
            read = parquet.read()
        columns = [ArrowCells(column.combine_chunks()) for column in read.columns]
        return table_of(file, TextTable(list(read.column_names), columns))
    return table_of(file, read_text(path))


def table_of(file: str, found: TextTable) -> Table:
    """Return cells as the table of a file. Raises InputError for a column given twice and for no rows."""
    parsed = tuple(parse_header(header) for header in found.headers)
    counts = Counter(column.name for column in parsed)
    twice = next((name for name, count in counts.items() if name and count > 1), None)
    if twice is not None:
        raise InputError(f"{file}: column {twice!r}: found twice, expected once")
    cells = {column.name: values for column, values in zip(parsed, found.columns, strict=True)}
    n_rows = len(found.columns[0]) if found.columns else 0
    if n_rows == 0:
        raise InputError(f"{file}: found no row of data, expected at least one")
    return Table(file, parsed, cells, n_rows, found.line, found.notes, "", found.date, found.shuffled)


def parse_header(header: str) -> Column:
    """Return the column of a header: ``x [um]``, and ``x[um]`` or ``x (um)`` where the brackets hold a unit, no index."""
    text = header.strip()
    for opening, closing in ("[]", "()"):
        name, found, unit = text[:-1].rpartition(opening)
        enclosed = found and text.endswith(closing) and closing not in unit
        stated = opening == "[" and name.endswith(" ")
        if enclosed and (stated or (is_unit(unit) and not unit.isdigit())):
            return Column(name.rstrip(), unit.strip())
    return Column(text)


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


def _empty(cell: object) -> bool:
    """Whether nothing is there; NaN outside of texts is nothing."""
    return cell is None or (
        not cell.strip() if isinstance(cell, str) else isinstance(cell, float) and math.isnan(cell)
    )


def _fault(cell: object) -> str:
    if cell is None or (isinstance(cell, str) and not cell.strip()):
        return "found an empty cell"
    return f"found {cell.strip() if isinstance(cell, str) else cell!r}"


def _label(cell: object) -> str:
    if isinstance(cell, float) and cell.is_integer():
        return str(int(cell))
    return str(cell).strip()


def is_table(source: object) -> bool:
    """Whether a source holds columns itself: a mapping, a DataFrame, or anything that gives Arrow columns."""
    return isinstance(source, (Mapping, pd.DataFrame)) or hasattr(source, "__arrow_c_stream__")


def _columns_of(source: Any, where: str) -> tuple[list[str], list[Sequence[object]]]:
    """Headers and cells; NaN and None are empty cells. Raises InputError for names that are no text, unequal columns."""
    if not isinstance(source, (Mapping, pd.DataFrame)):
        try:
            table = pa.table(source)
        except pa.ArrowInvalid as exc:
            raise InputError(
                f"{where}: found one column without a name, expected a table of columns"
            ) from exc
        return list(table.column_names), [ArrowCells(column) for column in table.columns]
    names = list(source.keys())
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"{where}: found the column {name!r}, expected names that are texts")
    if isinstance(source, pd.DataFrame):
        return names, [_cells_of(source.iloc[:, k]) for k in range(len(names))]
    series = [_series(source[name], f"{where}: column {name!r}") for name in names]
    sizes = {name: len(column) for name, column in zip(names, series, strict=True)}
    if len(set(sizes.values())) > 1:
        short, long = min(sizes, key=sizes.__getitem__), max(sizes, key=sizes.__getitem__)
        raise InputError(
            f"{where}: found {sizes[short]} values in {short!r} and {sizes[long]} in {long!r}, expected as many"
        )
    return names, [_cells_of(column) for column in series]


def _series(values: Any, where: str) -> pd.Series[Any]:
    """One column, without an index that could put its values in other rows."""
    if isinstance(values, (str, bytes)) or np.ndim(values) != 1:
        raise InputError(f"{where}: expected a sequence of values, one a row")
    return pd.Series(list(values) if not isinstance(values, (np.ndarray, pd.Series)) else np.asarray(values))


def _cells_of(column: pd.Series[Any]) -> Sequence[object]:
    try:
        found = pa.array(column, from_pandas=True)
    except pa.ArrowException:  # cells of several kinds
        return [None if cell is None or pd.isna(cell) else cell for cell in column]
    return ArrowCells(found)


def in_known_case(table: Table, known: Iterable[str]) -> Table:
    """The table with ``Q1`` called `q1`, where one known name alone is meant; a note says so.

    Raises InputError where several columns could be the same one.
    """
    folded: dict[str, list[str]] = {}
    for name in dict.fromkeys(known):
        folded.setdefault(name.casefold(), []).append(name)
    found: dict[str, list[str]] = {}
    for name in table.names:
        match = folded.get(name.casefold(), [])
        if len(match) == 1 and match[0] not in table:
            found.setdefault(match[0], []).append(name)
    for name, written in found.items():
        if len(written) > 1:
            both = " and ".join(repr(text) for text in written)
            raise InputError(f"{table.file}: found the columns {both}, expected one column {name!r}")
    if not found:
        return table
    told = ", ".join(f"{written[0]!r} as {name!r}" for name, written in found.items())
    renamed = table.renamed({written[0]: name for name, written in found.items()})
    return renamed.with_note(f"{table.file}: read without case: {told}")


_VECTOR, _QUATERNION = ("rx", "ry", "rz"), ("qx", "qy", "qz", "qw")
_ANGLES = {
    ("roll", "pitch", "yaw"): "",
    ("c", "b", "a"): " --columns roll=C,pitch=B,yaw=A",
    ("w", "p", "r"): " --columns roll=W,pitch=P,yaw=R",
}
"""Roll, pitch and yaw as robots call them, and what `truepose import` has to be told of them."""


def missing_column(table: Table, name: str, known: Collection[str]) -> InputError:
    """The error of a column that is not there, with what was written in its place."""
    spare = [written for written in table.names if written not in known]
    glued = next((written for written in spare if _glued(written, name)), None)
    indexed = next((w for w in spare if w.casefold().startswith(f"{name.casefold()}[")), None)
    if indexed is not None:
        hint = f"found {indexed!r}, whose brackets hold no unit"
    elif glued is not None:
        unit = glued[len(name) + 1 :]
        hint = f"found {glued!r}: write it '{name} [{unit}]'"
    elif name.casefold() in _VECTOR and (turned := _rotation_hint({w.casefold() for w in spare})):
        hint = turned
    elif meant(name, spare):
        hint = meant(name, spare)
    else:
        hint = close_matches(name, table.names)
    return InputError(f"{table.file}: missing column {name!r}; {hint}")


def _rotation_hint(spare: set[str]) -> str:
    """Return what to do with a rotation that is there in another form; nothing where there is none."""
    if spare >= set(_QUATERNION):
        return "found a quaternion (qx, qy, qz, qw), which `truepose import` writes as rx, ry, rz"
    for names, asked in _ANGLES.items():
        if spare >= set(names):
            told = ", ".join(n.upper() if len(n) == 1 else n for n in names)
            return f"found {told}: if they are roll, pitch and yaw, `truepose import --rotation rpy{asked}` writes rx, ry, rz"
    return ""


def _glued(written: str, name: str) -> bool:
    """Whether a column is ``x_mm``: the name and a unit."""
    start, unit = written[: len(name)], written[len(name) + 1 :]
    return (
        start.casefold() == name.casefold()
        and written[len(name) :][:1] in ("_", "-", ".", "/")
        and is_unit(unit)
    )
