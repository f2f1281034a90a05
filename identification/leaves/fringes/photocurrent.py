"""The long table of a photocurrent, ``pose t I``, as one series for every move."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.recording.table import Table, read_table
from truepose.models.units import UnitSystem, convert
from truepose.wording import close_matches

_NEEDED: Final = ("pose", "t", "I")
_FEWEST: Final = 32


@dataclass(frozen=True)
class Series:
    """The samples of one move in order of time: t in s, the signal as recorded, wavelengths in mm.

    ``row``: where its first sample stands in the file, from 1; ``sign``: +1 or -1 where the table says it.
    """

    row: int
    t: Array
    signal: Array
    wavelength: Array | None
    sign: int | None


@dataclass(frozen=True)
class SampleTable:
    """A table of samples, and the series of each pose in the order of the file."""

    file: str
    series: Mapping[int, Sequence[Series]]
    notes: tuple[str, ...]


def read_samples(path: Path | str, units: UnitSystem) -> SampleTable:
    """Read CSV or Parquet with columns ``pose``, ``t`` (s), ``I`` (any unit), perhaps ``wavelength``, ``sign``.

    ``wavelength`` without a unit of its own is in the file's unit of length. Raises InputError naming file, row
    and column: for a missing column, what is no number, and times that do not increase within a pose's series.
    """
    table = read_table(path)
    for name in _NEEDED:
        if name not in table:
            raise InputError(f"{table.file}: missing column {name!r}; {close_matches(name, table.names)}")
    pose = table.integers("pose")
    values = {name: table.numbers(name) for name in ("t", "I", "wavelength", "sign") if name in table}
    values["t"] = convert(values["t"], table.unit("t", "s", "s"), "s")
    table.unit("I", "1", "any")
    if "wavelength" in values:
        unit = table.unit("wavelength", units.length, "mm")
        values["wavelength"] = convert(values["wavelength"], unit, "mm")
        _refuse(table, "wavelength", values["wavelength"] <= 0.0, "a wavelength > 0")
    if "sign" in values:
        _refuse(table, "sign", ~np.isin(values["sign"], (-1.0, 0.0, 1.0)), "-1, 1, or 0 for unknown")
    ignored = [name for name in table.names if name not in (*_NEEDED, "wavelength", "sign")]
    notes = [f"{table.file}: ignored columns that mean nothing here: {', '.join(map(repr, ignored))}"]
    return SampleTable(table.file, _series(table, pose, values), tuple(notes if ignored else []))


def _series(
    table: Table, pose: NDArray[np.int64], values: Mapping[str, Array]
) -> dict[int, tuple[Series, ...]]:
    """Unbroken runs of rows of one pose, by pose."""
    bounds = np.concatenate([[0], np.flatnonzero(pose[1:] != pose[:-1]) + 1, [len(pose)]])
    back = np.flatnonzero(np.diff(values["t"]) <= 0.0) + 1
    back = back[~np.isin(back, bounds)]
    if len(back):
        row = int(back[0])
        raise InputError(
            f"{table.where('t', row)}: found {values['t'][row]:.9g} s after {values['t'][row - 1]:.9g} s in "
            f"pose {pose[row]}, expected times that increase within a pose"
        )
    out: dict[int, list[Series]] = {}
    for first, last in itertools.pairwise(bounds.tolist()):
        out.setdefault(int(pose[first]), []).append(_one(table, first, last, values))
    return {number: tuple(found) for number, found in out.items()}


def _one(table: Table, first: int, last: int, values: Mapping[str, Array]) -> Series:
    rows = slice(first, last)
    sign = None
    if "sign" in values:
        signs = values["sign"][rows]
        other = np.flatnonzero(signs != signs[0])
        if len(other):
            row = first + int(other[0])
            raise InputError(
                f"{table.where('sign', row)}: found {values['sign'][row]:g} after {signs[0]:g}, expected one "
                "sign in all rows of a series"
            )
        sign = int(signs[0]) or None
    if last - first < _FEWEST:
        raise InputError(
            f"{table.where('I', first)}: found {last - first} samples in the series, expected at least {_FEWEST}"
        )
    wavelength = values["wavelength"][rows] if "wavelength" in values else None
    return Series(first + 1, values["t"][rows], values["I"][rows], wavelength, sign)


def _refuse(table: Table, name: str, bad: Mask, expected: str) -> None:
    rows = np.flatnonzero(bad)
    if len(rows):
        cell = table.cells[name][int(rows[0])]
        raise InputError(f"{table.where(name, int(rows[0]))}: found {cell}, expected {expected}")
