"""Long tables read and written by whole columns: what ``table.read_table`` gives, of a million rows in a second.

Cells are converted by pyarrow. Whatever it does not take as plain numbers and separators (quotes, comments between rows,
cells with blanks around them, whatever is wrong) is left to ``read_table`` and ``Table``, which also say what is wrong.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.compute as pc  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]

from truepose.identification.table import Column, Table, _parse_header, read_table
from truepose.models.units import FloatArray

LARGE = 1 << 20
"""Bytes from which a file is read by columns."""
MANY = 10_000
"""Rows from which a table is written by columns."""
_NOT_PLAIN = (b'"', b"#", b"\0")


class Cells(Mapping[str, Sequence[object]]):
    """Columns of pyarrow by name; as lists only where somebody asks for them."""

    def __init__(self, columns: Mapping[str, Any]) -> None:
        self.columns = dict(columns)
        self._lists: dict[str, list[object]] = {}

    def __getitem__(self, name: str) -> Sequence[object]:
        if name not in self._lists:
            self._lists[name] = self.columns[name].to_pylist()
        return self._lists[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)


@dataclass(frozen=True)
class LongTable(Table):
    """A table whose columns become numbers without a look at every cell."""

    def numbers(self, name: str) -> FloatArray:
        """As ``Table.numbers``."""
        values = _plain_numbers(self.cells.columns[name]) if isinstance(self.cells, Cells) else None
        if values is None or not np.isfinite(values).all():
            return super().numbers(name)  # cell by cell: it says which is wrong
        return values


def read_path_table(path: Path | str) -> Table:
    """As ``read_table``, by columns where the file is large and plain."""
    found = _read_columns(Path(path))
    if found is None:
        return read_table(path)
    names, columns = found
    headers = tuple(_parse_header(name) for name in names)
    unique = {header.name for header in headers}
    rows = len(columns[0]) if columns else 0
    if len(unique) < len(headers) or not rows:
        return read_table(path)
    cells = Cells({header.name: column for header, column in zip(headers, columns, strict=True)})
    return LongTable(str(path), headers, cells, rows)


def with_columns(table: Table, added: Mapping[str, FloatArray]) -> Table:
    """The table with further columns of numbers at its end."""
    columns = (*table.columns, *(Column(name) for name in added))
    if isinstance(table.cells, Cells):
        arrow = {**table.cells.columns, **{name: pa.array(values) for name, values in added.items()}}
        return LongTable(table.file, columns, Cells(arrow), table.n_rows)
    cells = {**table.cells, **{name: values.tolist() for name, values in added.items()}}
    return Table(table.file, columns, cells, table.n_rows)


def csv_text(frame: pd.DataFrame) -> str:
    """A table as CSV, floats at full precision; what is long, by columns."""
    if len(frame) >= MANY and all(_is_plain(frame[name]) for name in frame):
        stream = io.BytesIO()
        header = frame.head(0).to_csv(index=False, lineterminator="\n")
        try:
            table = pa.Table.from_pandas(frame, preserve_index=False)
            pacsv.write_csv(table, stream, pacsv.WriteOptions(include_header=False, quoting_style="none"))
            return header + stream.getvalue().decode()
        except pa.ArrowException:
            pass  # a text with a comma in it, or cells of several kinds
    return str(frame.to_csv(index=False, lineterminator="\n"))


def _is_plain(column: pd.Series[Any]) -> bool:
    return column.dtype in (np.float64, np.int64, np.object_) or isinstance(column.dtype, pd.StringDtype)


def _read_columns(path: Path) -> tuple[list[str], list[Any]] | None:
    """Headers, and columns of pyarrow; None where the plain way cannot be taken."""
    try:
        if path.stat().st_size < LARGE:
            return None
        with path.open("rb") as stream:
            parquet = stream.read(4) == b"PAR1"
        if parquet:
            table = pq.ParquetFile(path).read()
            return list(table.column_names), list(table.columns)
        return _read_csv(path.read_bytes())
    except (OSError, UnicodeDecodeError, pa.ArrowException):
        return None


def _read_csv(data: bytes) -> tuple[list[str], list[Any]] | None:
    start = 3 if data.startswith(b"\xef\xbb\xbf") else 0
    while True:  # comments and empty lines before the header
        end = data.find(b"\n", start)
        line = data[start : end if end >= 0 else len(data)].strip()
        if end < 0 or (line and not line.startswith(b"#")):
            break
        start = end + 1
    names = line.decode("utf-8").split(",")
    body = memoryview(data)[end + 1 :]
    if end < 0 or len(names) < 2 or b'"' in line or any(data.find(mark, end) >= 0 for mark in _NOT_PLAIN):
        return None
    keys = [str(k) for k in range(len(names))]
    read = pacsv.read_csv(
        pa.BufferReader(pa.py_buffer(body)),
        read_options=pacsv.ReadOptions(column_names=keys),
        parse_options=pacsv.ParseOptions(quote_char=False),
        convert_options=pacsv.ConvertOptions(
            column_types=dict.fromkeys(keys, pa.string()), strings_can_be_null=False
        ),
    )
    return names, list(read.columns)


def _plain_numbers(column: Any) -> FloatArray | None:
    """(n,) numbers of a column of numbers, or of their texts; None for anything else."""
    kind = column.type
    if column.null_count or not (
        pa.types.is_string(kind) or pa.types.is_integer(kind) or pa.types.is_floating(kind)
    ):
        return None
    try:
        values = pc.cast(column, pa.float64(), safe=False)
    except pa.ArrowException:
        return None
    out: FloatArray = np.array(values.to_numpy(), dtype=np.float64)
    return out


__all__ = ["Cells", "LongTable", "csv_text", "read_path_table", "with_columns"]
