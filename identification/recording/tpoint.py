"""TPOINT's text format as a table: what a mount's encoders said of a star, and where the star was.

Lines that begin with ``!`` are comments, the first other line is a caption, lines that begin with ``:`` are options,
then comes one line that begins with the latitude (deg m s), then a star a line: right ascension (h m s) and declination
(deg m s), both again as the encoders say, and the sidereal time (h m). ``END`` ends the file.

The mount is a machine of two revolute joints: q1 about the pole (or the vertical), right-handed, so that it is minus the
hour angle (or minus the azimuth), and q2 the declination (or altitude). A star is a point at ``DISTANCE`` in its
direction, x where the meridian cuts the equator (or the horizon in the north), z at the pole (or the zenith).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.recording.arrow_columns import ArrowCells
from truepose.identification.recording.table import Column, Table

Array = NDArray[np.float64]
DISTANCE: Final = 1000.0
"""mm: a direction's error of 1 mrad is one of 1 mm."""
_OPTION: Final = re.compile(r"^\s*:\s*([A-Za-z]+)", re.MULTILINE)
_OPTIONS: Final = frozenset(
    {"NODA", "EQUAT", "ALTAZ", "ALLSKY", "GIMBAL", "J2000", "ROTNL", "ROTNR", "ROTTEL"}
)
_FIELDS = 14


def is_tpoint(text: str) -> bool:
    """Whether a text has one of the format's options."""
    return any(found[1].upper() in _OPTIONS for found in _OPTION.finditer(text))


def read_tpoint(text: str, file: str) -> Table:
    """Columns q1, q2 (deg) of the encoders and x y z (mm) of the stars. Raises InputError naming file and line."""
    options = {found[1].upper() for found in _OPTION.finditer(text)}
    if "GIMBAL" in options:
        raise InputError(f"{file}: option :GIMBAL: expected a mount that is equatorial or altazimuth")
    lines = [(k, line.split()) for k, line in enumerate(text.splitlines(), start=1) if _says(line)]
    _, (site, *stars) = lines[:1], lines[1:] or [(0, [])]  # the caption says nothing
    latitude = _latitude(site, file)
    rows = _until_end(stars)
    if not rows:
        raise InputError(f"{file}: found no star, expected lines of right ascensions and declinations")
    numbers = np.array([_numbers(row, file) for row in rows])
    ra, dec, ra_read, dec_read, sidereal = numbers.T
    true, read = (sidereal - ra, dec), (sidereal - ra_read, dec_read)
    if "ALTAZ" in options:
        true, read = _horizontal(*true, latitude), _horizontal(*read, latitude)
    turned = -np.angle(np.exp(1j * read[0]))
    point = np.column_stack(
        [np.cos(true[1]) * np.cos(true[0]), -np.cos(true[1]) * np.sin(true[0]), np.sin(true[1])]
    )
    values = [np.degrees(turned), np.degrees(read[1]), *(DISTANCE * point).T]
    columns = (Column("q1", "deg"), Column("q2", "deg"), *(Column(axis, "mm") for axis in "xyz"))
    cells = {column.name: ArrowCells(v) for column, v in zip(columns, values, strict=True)}
    about = "the vertical, q2 the altitude" if "ALTAZ" in options else "the pole, q2 the declination"
    note = (
        f"{file}: q1 turns about {about}; stars are points at {DISTANCE:g} mm, seen from latitude "
        f"{np.degrees(latitude):.4f} deg; refraction is left in"
    )
    where = [number for number, _ in rows]
    return Table(file, columns, cells, len(rows), where.__getitem__, (note,))


def _says(line: str) -> bool:
    return bool(line.strip()) and line.lstrip()[0] not in "!:"


def _latitude(site: tuple[int, Sequence[str]], file: str) -> float:
    number, words = site
    try:
        return float(_angle(words[:3], 1.0))
    except ValueError:
        raise InputError(
            f"{file}: line {number}: found {' '.join(words)!r}, expected a latitude first: deg m s"
        ) from None


def _until_end(stars: Sequence[tuple[int, Sequence[str]]]) -> list[tuple[int, Sequence[str]]]:
    out = []
    for number, words in stars:
        if words[0].upper() == "END":
            break
        out.append((number, words))
    return out


def _numbers(row: tuple[int, Sequence[str]], file: str) -> list[float]:
    """Right ascension, declination, both as read, sidereal time: rad."""
    number, words = row
    try:
        if len(words) < _FIELDS:
            raise ValueError
        pairs = [(words[k : k + 3], 15.0 if k % 6 == 0 else 1.0) for k in range(0, 12, 3)]
        return [*(_angle(fields, scale) for fields, scale in pairs), _angle([*words[12:14], "0"], 15.0)]
    except ValueError:
        raise InputError(
            f"{file}: line {number}: found {' '.join(words)!r}, expected right ascension (h m s) and declination "
            "(deg m s), the same as read, and the sidereal time (h m)"
        ) from None


def _angle(words: Sequence[str], scale: float) -> float:
    """Radians of h m s or deg m s; the sign stands at the first."""
    whole, minutes, seconds = (abs(float(word)) for word in words)
    if minutes >= 60.0 or seconds >= 60.0:
        raise ValueError
    size = scale * (whole + minutes / 60.0 + seconds / 3600.0)
    return float(np.radians(-size if words[0].startswith("-") else size))


def _horizontal(hour: Array, dec: Array, latitude: float) -> tuple[Array, Array]:
    """Azimuth from the north by the east, and altitude, rad."""
    east = -np.cos(dec) * np.sin(hour)
    north = np.sin(dec) * np.cos(latitude) - np.cos(dec) * np.cos(hour) * np.sin(latitude)
    up = np.sin(dec) * np.sin(latitude) + np.cos(dec) * np.cos(hour) * np.cos(latitude)
    return np.arctan2(east, north), np.arcsin(np.clip(up, -1.0, 1.0))


__all__ = ["DISTANCE", "is_tpoint", "read_tpoint"]
