"""Rows of a text file, a block at a time: what stands in the cells of each column, and on which line a row ends."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path
from typing import Any, TextIO

import pyarrow as pa  # type: ignore[import-untyped]

from truepose.errors import InputError
from truepose.identification.recording.plain_text import SPACES, counts, plain_columns
from truepose.identification.recording.size import check_line
from truepose.models.file.limits import LINE

BLOCK = 1 << 22
"""Characters that are read at a time."""


@dataclass(frozen=True)
class TextRows:
    """A text file and how it is written; ``above``: lines that count over the first row."""

    path: Path
    encoding: str
    separator: str
    headers: tuple[str, ...]
    above: int = 1

    def blocks(self) -> Iterator[list[Any]]:
        """Arrays of texts, one for each column, of some rows at a time.

        Raises InputError for a row of the wrong length, csv.Error for quotes that do not close.
        """
        done = 0
        with open_text(self.path, self.encoding) as stream:
            self._skip_above(filter(counts, iter(stream.readline, "")))
            while block := stream.read(BLOCK) + check_line(str(self.path), stream.readline(LINE + 1)):
                columns = plain_columns(block, len(self.headers), self.separator)
                columns = columns or self._by_rows(block, stream, done)
                yield columns
                done += len(columns[0])

    def line(self, row: int) -> int:
        """The line of the file that a 0-based row ends on."""
        with open_text(self.path, self.encoding) as stream:
            lines = _Counted(stream)
            self._skip_above(lines)
            next(islice(self._cells(lines), row, None))
            return lines.number

    def _skip_above(self, lines: Iterator[str]) -> None:
        for _ in islice(lines, self.above):
            pass

    def _cells(self, lines: Iterable[str]) -> Iterator[list[str]]:
        """Cells of each row, of lines that count."""
        if self.separator == SPACES:
            return map(str.split, lines)
        return csv.reader(lines, delimiter=self.separator, strict=True)

    def _by_rows(self, block: str, stream: TextIO, done: int) -> list[Any]:
        """Arrays of a block that is not plain; a row that goes on behind it is read to its end from the stream."""
        lines, count = io.StringIO(block, newline=""), len(self.headers)
        cells: list[str] = []
        for row in self._cells(filter(counts, chain(lines, iter(stream.readline, "")))):
            if len(row) != count:
                raise self._wrong_length(done + len(cells) // count, len(row))
            cells += row
            if lines.tell() == len(block):
                break
        return [pa.array(cells[k::count], pa.string()) for k in range(count)]

    def _wrong_length(self, row: int, found: int) -> InputError:
        expected = len(self.headers)
        twice = self.separator == "," and found == 2 * expected
        hint = "; decimal commas need a semicolon or a tab between columns" if twice else ""
        return InputError(
            f"{self.path}: row {row + 1} (line {self.line(row)}): found {found} cells, expected {expected}{hint}"
        )


class _Counted(Iterator[str]):
    """Lines that count; ``number`` is that of the last one given, in all lines."""

    def __init__(self, lines: Iterable[str]) -> None:
        self.number = 0
        self._lines = ((k, line) for k, line in enumerate(lines, start=1) if counts(line))

    def __next__(self) -> str:
        self.number, line = next(self._lines)
        return line


def open_text(path: Path, encoding: str) -> TextIO:
    """The file, its ends of lines as they stand."""
    return path.open(encoding=encoding, newline="")


__all__ = ["TextRows", "open_text"]
