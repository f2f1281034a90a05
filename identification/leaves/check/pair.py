"""A machine file and its recordings as documents that can be mended and written again."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.files import atomic_directory
from truepose.identification.recording.load import tables
from truepose.identification.recording.table import Table
from truepose.models.file.yaml_document import parse_document, read_text
from truepose.models.file.yaml_edit import edited_text
from truepose.models.load import load_machine
from truepose.models.machine.urdf_lengths import rescaled

Array = NDArray[np.float64]
Field = tuple[str | int, ...]
_DESCRIPTION: Field = ("mechanism", "file")
"""Where a machine file names its URDF."""


@dataclass(frozen=True)
class Sheet:
    """A recording as it stands: cells by column, and the unit in each header (None without one)."""

    file: str
    cells: pd.DataFrame
    units: Mapping[str, str | None]

    @classmethod
    def of(cls, table: Table) -> Sheet:
        """The sheet of a table that was read."""
        cells = {c.name: list(table.cells[c.name]) for c in table.columns}
        return cls(table.file, pd.DataFrame(cells, dtype=object), {c.name: c.unit for c in table.columns})

    def numbers(self, name: str) -> Array:
        """(n,) a column's values as they stand; NaN where there is none."""
        return pd.to_numeric(self.cells[name], errors="coerce").to_numpy(dtype=float)

    def in_unit(self, names: Iterable[str], unit: str) -> Sheet:
        """The same numbers, said to be in another unit."""
        return replace(self, units={**self.units, **{n: unit for n in names if n in self.units}})

    def with_numbers(self, values: Mapping[str, Array]) -> Sheet:
        """Columns with other numbers (n,); NaN is an empty cell."""
        cells = self.cells.copy()
        for name, column in values.items():
            if name in cells:
                texts = ["" if np.isnan(v) else repr(float(v)) for v in column]
                cells[name] = pd.Series(texts, dtype=object, index=cells.index)
        return replace(self, cells=cells)

    def renamed(self, names: Mapping[str, str]) -> Sheet:
        """Headers exchanged: ``{"q4": "q5", "q5": "q4"}``."""
        cells = self.cells.rename(columns=dict(names))
        return replace(self, cells=cells, units={names.get(n, n): unit for n, unit in self.units.items()})

    def rows(self, places: Sequence[int] | NDArray[np.intp]) -> Sheet:
        """Some rows, in this order."""
        return replace(self, cells=self.cells.iloc[list(places)].reset_index(drop=True))

    def text(self) -> str:
        """The sheet as CSV."""
        headers = [n if self.units[n] is None else f"{n} [{self.units[n]}]" for n in self.cells.columns]
        return str(self.cells.to_csv(index=False, header=headers, lineterminator="\n"))


@dataclass(frozen=True)
class Pair:
    """A machine file (its text as it stood, its document as it is mended) and the sheets of its recordings.

    described: by how much the lengths of the robot description that it names have to grow.
    """

    machine: str
    text: str
    document: Mapping[str, Any]
    sheets: tuple[Sheet, ...]
    described: float = 1.0

    @classmethod
    def read(cls, machine: Path, recordings: Sequence[Path]) -> Pair:
        """From the files."""
        sheets = tuple(Sheet.of(table) for table in tables(list(recordings), _readings(machine)))
        text = read_text(machine)
        return cls(str(machine), text, parse_document(text, machine), sheets)

    def each(self, change: Callable[[Sheet], Sheet]) -> Pair:
        """Every sheet changed alike."""
        return replace(self, sheets=tuple(change(sheet) for sheet in self.sheets))

    def with_field(self, field: Field, value: object) -> Pair:
        """A field of the machine file set, made where it is not there yet."""
        document = copy.deepcopy(dict(self.document))
        at: Any = document
        for step, following in pairwise(field):
            if isinstance(at, dict) and step not in at:
                at[step] = [] if isinstance(following, int) else {}
            at = at[step]
        at[field[-1]] = value
        return replace(self, document=document)

    def get(self, field: Field) -> Any:
        """What a field holds; None where there is none."""
        at: Any = self.document
        for step in field:
            if isinstance(at, Mapping):
                at = at.get(step)
            elif isinstance(at, list) and isinstance(step, int) and step < len(at):
                at = at[step]
            else:
                return None
        return at

    def write(self, directory: Path) -> list[str]:
        """Both into a directory, under their own names (recordings as CSV); the paths written.

        The machine file keeps its comments. A robot description that it names goes with it.

        Raises InputError where that would write over the files that were read.
        """
        names = [Path(self.machine).name, *(f"{Path(s.file).stem}.csv" for s in self.sheets)]
        if len(set(names)) != len(names):
            names = [names[0], *(f"{k}_{name}" for k, name in enumerate(names[1:], start=1))]
        sources = {Path(f).resolve() for f in (self.machine, *(s.file for s in self.sheets))}
        if any((directory / name).resolve() in sources for name in names):
            raise InputError(
                f"--fix {directory}: holds the files that are checked, expected another directory"
            )
        with atomic_directory(directory) as partial:
            for name, text in zip(names, self._texts(), strict=True):
                (partial / name).write_text(text, encoding="utf-8", newline="")
            names += self._copied(partial)
        return [str(directory / name) for name in names]

    def _texts(self) -> list[str]:
        return [edited_text(self.text, self._beside().document), *(sheet.text() for sheet in self.sheets)]

    def _beside(self) -> Pair:
        """The pair whose robot description stands beside the machine file."""
        named = self.get(_DESCRIPTION)
        return self if named is None else self.with_field(_DESCRIPTION, Path(named).name)

    def _copied(self, directory: Path) -> list[str]:
        named = self.get(_DESCRIPTION)
        if named is None:
            return []
        source = Path(self.machine).parent / named
        if self.described == 1.0:
            (directory / source.name).write_bytes(source.read_bytes())
        else:
            text = rescaled(read_text(source), self.described)
            (directory / source.name).write_text(text, encoding="utf-8", newline="")
        return [source.name]


def _readings(machine: Path) -> tuple[str, ...]:
    """Return the joints of a machine file; none where it is not right, which is told elsewhere."""
    try:
        return load_machine(machine).mechanism.readings
    except InputError:
        return ()


__all__ = ["Field", "Pair", "Sheet"]
