"""Headings of tables of other programs: which columns they say are x, y and z, and what is asked where they do not."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Final

from truepose.errors import InputError
from truepose.identification.recording.table import Column, parse_header
from truepose.models.units import compatible
from truepose.wording import shortened

XYZ: Final = ("x", "y", "z")
_LISTED: Final = 40
"""Columns that a message lists."""
_GLUED: Final = re.compile(r"(?P<name>.+?)[_\-./ ](?P<unit>[A-Za-z]+)")
_NO_PLACE: Final = frozenset("rqwvafmu")
"""Letters before x, y and z in names of rotations, velocities, forces and directions."""
_NUMBERED: Final = re.compile(r"(?:[a-z]|axis|joint|theta)[ _.]?\d+|(?:[a-z_/]*[\[(]\d+[\])])", re.IGNORECASE)
_NUMBER: Final = re.compile(r"[-+]?[\d.,]+")
_USUAL: Final = {
    "hz", "v", "az", "el", "azimuth", "elevation", "horizontal", "vertical", "zenith", "distance", "dist", "range", "roll",
    "pitch", "yaw", "rx", "ry", "rz", "qw", "qx", "qy", "qz", "time", "timestamp", "name", "point", "target",
}  # fmt: skip
"""Names of columns that titles do not hold."""


def read_column(word: str) -> Column:
    """Return the column of a heading: ``X [mm]``, ``X(mm)``, ``x_mm``, and any other name as it is written."""
    column = parse_header(word.strip().strip('"'))
    glued = _GLUED.fullmatch(column.name)
    if column.unit is None and glued and glued["name"].casefold() in XYZ:
        unit = length_or_angle(glued["unit"])
        if unit is not None:
            column = Column(glued["name"], unit)
    if column.unit is not None:
        column = Column(column.name, length_or_angle(column.unit) or column.unit)
    return Column(column.name.casefold(), column.unit) if column.name.casefold() in XYZ else column


def length_or_angle(text: str) -> str | None:
    """Return the unit of a length or an angle that a text means in any case; None for another text."""
    known = (unit for unit in (text, text.casefold()) for like in ("mm", "rad") if compatible(unit, like))
    return next(known, None)


def names_columns(columns: Sequence[Column], count: int, *, is_comment: bool) -> bool:
    """Return True if a line above rows of ``count`` words names their columns: if it has as many, or one less and usual names.

    A comment needs usual names in any case.
    """
    usual = sum(
        bool(c.unit) or c.name.casefold() in _USUAL or _NUMBERED.fullmatch(c.name) is not None
        for c in columns
    )
    usual += 3 * (_triple([c.name for c in columns]) is not None)
    if len(columns) not in (count, count - 1) or any(_NUMBER.fullmatch(c.name) for c in columns):
        return False
    return usual >= 2 or (len(columns) == count and not is_comment)


def asked_columns(names: Sequence[str], where: str) -> InputError:
    """Return the error of a heading that says of no columns that they are x, y and z, with a line to copy."""
    listed = shortened([repr(name) for name in names], _LISTED)
    found = f"{where}: found the columns {listed}, expected x, y and z"
    if len(set(names)) < len(names):
        return InputError(
            f"{found} once each; say which they are by their numbers from 1: --columns x=N,y=N,z=N"
        )
    return InputError(
        f"{found} (--format table keeps the columns as they are); say which they are: {_to_copy(names)}"
    )


def is_asked(names: Sequence[str]) -> bool:
    """Return True if x, y and z are there under other names alone."""
    return not set(XYZ) & set(names) and _triple(names) is not None


def asked_numbers(count: int, where: str) -> InputError:
    """Return the error of a row of ``count`` words that no heading names."""
    return InputError(
        f"{where}: found {count} columns without a heading, expected a name and x y z; say which columns are x, y and z "
        "by their numbers from 1: --columns x=N,y=N,z=N"
    )


def _to_copy(names: Sequence[str]) -> str:
    found = _triple(names)
    if found is None:
        return "--columns x=NAME,y=NAME,z=NAME"
    turned = " --rotation quaternion" * ({"qx", "qy", "qz", "qw"} <= {name.casefold() for name in names})
    return f"--columns {shlex.quote(','.join(f'{a}={n}' for a, n in zip(XYZ, found, strict=True)))}{turned}"


def _triple(names: Sequence[str]) -> tuple[str, ...] | None:
    """Return three names that differ in x, y and z alone and may be a place; None where there are none."""
    written = {name.casefold(): name for name in names if not {",", "="} & set(name)}
    for name in written:
        for found in re.finditer("x", name):
            head, tail = name[: found.start()], name[found.end() :]
            last = re.split(r"[^a-z]", head)[-1]
            three = tuple(f"{head}{axis}{tail}" for axis in XYZ)
            if last not in _NO_PLACE and all(axis in written for axis in three):
                return tuple(written[axis] for axis in three)
    return None


def chosen_columns(text: str | None) -> Mapping[str, str]:
    """Return what ``--columns x=TCPX,y=TCPY`` says: old names by new ones. Raises InputError for another text."""
    chosen: dict[str, str] = {}
    for part in (text or "").split(",") if text is not None else ():
        new, sign, old = (word.strip() for word in part.partition("="))
        if not sign or not new or not old or new in chosen:
            raise InputError(
                f"--columns: found {part!r}, expected NEW=NAME with commas between, as in x=TCPX,y=TCPY,z=TCPZ"
            )
        chosen[new] = old
    return chosen
