"""The line above a point list that names its columns: which are x, y and z, in which units, and which name a point."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from truepose.identification.leaves.readers.headings import XYZ, length_or_angle, read_column
from truepose.identification.recording.table import Column

_TURNS: Final = frozenset({"rx", "ry", "rz", "roll", "pitch", "yaw", "q0", "q1", "q2", "q3", "i", "j", "k"})
_NAMES: Final = re.compile(
    r".*(?:name|point|target|punkt|group|collection|station|object).*|(?:id|pt|nr|no|num(?:ber)?)\.?",
    re.IGNORECASE,
)
"""Headings of columns that name a point."""


@dataclass(frozen=True)
class Header:
    """What the columns of a point list are called, their units, and where x, y and z stand among them."""

    columns: tuple[Column, ...]
    axes: tuple[int, ...]

    def turns(self, kept: Collection[int]) -> tuple[str, ...]:
        """Return the columns of rotations, which the list does not explain, but for those that are ``kept``."""
        names = [column.name.casefold() for k, column in enumerate(self.columns) if k not in kept]
        return tuple(name for name in names if name in _TURNS)

    def names_point(self, column: int) -> bool:
        """Return True if a column says which point it is."""
        return _NAMES.fullmatch(self.columns[column].name) is not None

    def units(self) -> list[str | None]:
        """Units of x, y and z."""
        return [self.columns[k].unit for k in self.axes]

    def with_units(self, words: Sequence[str]) -> Header:
        """Return the header with the units of a line below it: one for each column, for x, y and z, or the same for all."""
        units = [length_or_angle(word.strip("[]()")) for word in words]
        at = self.axes if len(units) != len(self.columns) else range(len(self.columns))
        if len(units) < len(at) or len(set(units)) == 1:
            units = [units[0]] * len(at)
        below = dict(zip(at, units, strict=False))
        columns = (replace(c, unit=c.unit or below.get(k)) for k, c in enumerate(self.columns))
        return replace(self, columns=tuple(columns))


def columns_of_line(words: Sequence[str]) -> list[Column]:
    """Return the columns of a line of headings; a unit in brackets may be a word of its own."""
    joined: list[str] = []
    for word in words:
        if joined and re.fullmatch(r"[\[(].*[\])]", word):
            joined[-1] += f" {word}"
        else:
            joined.append(word)
    return [read_column(word) for word in joined]


def are_units(words: Sequence[str]) -> bool:
    """Whether a line holds units and nothing else."""
    told = [word.strip("[]()") for word in words]
    return any(told) and all(not word or length_or_angle(word) is not None for word in told)


def header_of(columns: Sequence[Column], chosen: Mapping[str, str]) -> Header | None:
    """What a line of headings says of the columns; None where it is no such line."""
    names = [column.name for column in columns]
    wanted = [chosen.get(axis, axis) for axis in XYZ]
    if any(names.count(name) != 1 for name in wanted):
        return None
    return Header(tuple(columns), tuple(names.index(name) for name in wanted))


def numbered_header(words: Sequence[str], chosen: Mapping[str, str]) -> Header | None:
    """The header of a list without one, whose columns are chosen by number."""
    numbers = [chosen.get(axis, "") for axis in XYZ]
    if not all(number.isdecimal() and 1 <= int(number) <= len(words) for number in numbers):
        return None
    return Header(
        tuple(Column(str(k)) for k in range(1, len(words) + 1)), tuple(int(number) - 1 for number in numbers)
    )
