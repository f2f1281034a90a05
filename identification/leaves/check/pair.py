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

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.files import atomic_directory
from truepose.identification.recording.load import tables
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models.file.yaml_document import parse_document, read_text
from truepose.models.file.yaml_edit import edited_text
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.urdf_lengths import rescaled

# -- A machine file and its recordings as documents that can be mended and written again

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

    def in_unit(self, units: Mapping[str, str]) -> Sheet:
        """The same numbers, said to be in other units."""
        return replace(self, units={**self.units, **{n: u for n, u in units.items() if n in self.units}})

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

    def with_cells_of(self, names: Iterable[str], rows: Index) -> Sheet:
        """Some columns with the cells that they have in other rows (n,)."""
        cells = self.cells.copy()
        for name in set(names) & set(cells):
            cells[name] = self.cells[name].to_numpy()[rows]
        return replace(self, cells=cells)

    def rows(self, places: Sequence[int] | Index) -> Sheet:
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

    def in_unit(self, units: Mapping[str, str]) -> Pair:
        """Columns of every sheet said to be in other units."""
        return self.each(lambda sheet: sheet.in_unit(units))

    def renamed(self, names: Mapping[str, str]) -> Pair:
        """Headers of every sheet exchanged."""
        return self.each(lambda sheet: sheet.renamed(names))

    def negated(self, names: Sequence[str]) -> Pair:
        """Columns of every sheet with the other sign."""
        return self.each(lambda s: s.with_numbers({n: -s.numbers(n) for n in names if n in s.units}))

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
        named = self.get(_DESCRIPTION)
        beside = self if named is None else self.with_field(_DESCRIPTION, Path(named).name)
        texts = [edited_text(self.text, beside.document), *(sheet.text() for sheet in self.sheets)]
        with atomic_directory(directory) as partial:
            for name, text in zip(names, texts, strict=True):
                (partial / name).write_text(text, encoding="utf-8", newline="")
            names += [] if named is None else [self._copied(Path(self.machine).parent / named, partial)]
        return [str(directory / name) for name in names]

    def _copied(self, source: Path, directory: Path) -> str:
        """Copy the robot description, its lengths as they have to be; return its name."""
        if self.described == 1.0:
            (directory / source.name).write_bytes(source.read_bytes())
        else:
            text = rescaled(read_text(source), self.described)
            (directory / source.name).write_text(text, encoding="utf-8", newline="")
        return source.name


def _readings(machine: Path) -> tuple[str, ...]:
    """Return the joints of a machine file; none where it is not right, which is told elsewhere."""
    try:
        return load_machine(machine).mechanism.readings
    except InputError:
        return ()


# -- What a hypothesis says of the rows and of the machine, and where base and tool then stand

MOST_ROWS = 45
"""Rows that a hypothesis is judged by: enough to tell slips apart, few enough for a hundred hypotheses in a second."""


@dataclass(frozen=True)
class Scene:
    """What a hypothesis says: all rows (their readings may be changed), constants p (np,), the factors by which it changed
    measured lengths (size) and angles (width), and the rows (n,) that it leaves without a reading.

    drawn, stated: the factors by which it changed the lengths of the mechanism and those of tolerances. exchanged: whether base
    and tool have each other's tolerances. coarse, turned: the factors by which the sigmas
    of lengths grow, and the sigmas and tolerances of angles.
    """

    rows: Recording
    p: Array
    size: float = 1.0
    width: float = 1.0
    lost: Mask | None = None
    drawn: float = 1.0
    stated: float = 1.0
    exchanged: bool = False
    coarse: float = 1.0
    turned: float = 1.0

    def with_joints(self, q: Array) -> Scene:
        """The same with other readings of the joints (n, nq)."""
        return replace(self, rows=replace(self.rows, q=q))

    def with_joint_columns(self, columns: Mapping[int, Array]) -> Scene:
        """The same with other readings (n,) of some joints."""
        q = self.rows.q.copy()
        for k, column in columns.items():
            q[:, k] = column
        return self.with_joints(q)

    def with_readings_of(self, rows: Index) -> Scene:
        """The same with the sensors' readings of other rows (n,)."""
        return self.with_columns({n: v[rows] for n, v in self.rows.observations.items()})

    def without(self, lost: Mask) -> Scene:
        """The same with more rows (n,) left without a reading."""
        return replace(self, lost=lost if self.lost is None else lost | self.lost)

    def with_columns(self, columns: Mapping[str, Array], size: float = 1.0, width: float = 1.0) -> Scene:
        """The same with other columns (n,) of the sensors, multiplied by ``size`` (lengths) and ``width`` (angles)."""
        seen = {**self.rows.observations, **columns}
        rows = replace(self.rows, observations=seen)
        return replace(self, rows=rows, size=self.size * size, width=self.width * width)


@dataclass(frozen=True)
class Stand:
    """Where base and tool stand best: constants p (np,), and what is left.

    misfit: whitened rms over the rows that fit best; length: rms of the 3-D error, mm, None where no length is read; residual
    (n, m) whitened; rows: places (n,) of the rows judged.
    """

    p: Array
    misfit: float
    length: float | None
    residual: Array
    rows: Index
    scene: Scene

    @property
    def bad(self) -> bool:
        """Whether nothing could be fitted."""
        return not np.isfinite(self.misfit)


def usable(machine: Machine, scene: Scene) -> Index:
    """Return the places of all rows to judge by; where rows count from others, of motions and the rows that they start at."""
    use = ~scene.rows.validation
    if scene.lost is not None:
        use &= ~scene.lost
    rows = np.flatnonzero(use)
    if len(rows) and differs(machine) and scene.rows.from_row is not None:
        return _with_origins(scene.rows.q, rows, scene.rows.from_row)
    return rows


def chosen(machine: Machine, scene: Scene) -> Index:
    """Return the places of the rows to judge by, spread over the recording; with those that ``from`` names."""
    rows = usable(machine, scene)
    if differs(machine) and scene.rows.from_row is not None:
        return rows
    return _spread(rows)


def _spread(rows: Index) -> Index:
    step = np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).round().astype(int)
    return np.asarray(rows[np.unique(step)])


def _with_origins(q: Array, rows: Index, origin: NDArray[np.int64]) -> Index:
    """The first row of each motion that was read, so that repeats do not crowd out poses, and the rows that they start at."""
    told = np.column_stack([q[rows], q[origin[rows]]])
    moved = rows[np.any(q[rows] != q[origin[rows]], axis=1)]
    first = np.sort(np.unique(told, axis=0, return_index=True)[1])
    wanted = np.intersect1d(rows[first], moved)
    wanted = _spread(wanted) if len(wanted) else rows[:1]
    while True:
        closed = np.unique(np.concatenate([wanted, origin[wanted]]))
        if len(closed) == len(wanted):
            return closed
        wanted = closed


def differs(machine: Machine) -> bool:
    """Whether a sensor reads changes since another row."""
    return any(sensor.differs_from_row for sensor in machine.sensors)


# -- A slip that may have been made between a machine and its files: what would be right, how likely it is, and how to mend it

Change = Callable[[Scene], Scene]
Mend = Callable[[Pair], Pair]
USUAL, SELDOM, RARE = 1e-2, 1e-3, 1e-5
"""Odds of one slip against none, before readings are looked at: what every workshop has seen, what happens, what hardly does.

A slip whose size is searched for is rare: a size that happens to fit is one of many hundred.
"""


@dataclass(frozen=True)
class Slip:
    """One hypothesis: its kind, the columns or fields it is about, what it says, and what it does to scene and files.

    says: what would be true ("readings are in m"); fix: what to change, in words; change: the scene as it would then be;
    mend: the files as they then should be; odds: how likely it is before readings are looked at; between: whether it is about
    which rows belong together, so that it says nothing of a row by itself.
    """

    kind: str
    where: tuple[str, ...]
    says: str
    fix: str
    change: Change
    mend: Mend
    odds: float = USUAL
    between: bool = False
