"""TPOINT's text format as a table: what a mount's encoders said of a star, and where the star was.

Lines that begin with ``!`` are comments, the first other line is a caption, lines that begin with ``:`` are options,
then comes one line that begins with the latitude (deg m s), then a star a line: right ascension (h m s) and declination
(deg m s), both again as the encoders say, and the sidereal time (h m). ``END`` ends the file.

What follows the latitude on that line is the date, temperature (degC), pressure (hPa), height (m) and humidity (0 to 1).

The columns are those of a machine of type ``mount``: its encoders (``ha dec``, or ``az alt``), where the star was (``star.ha
star.dec``, or ``star.az star.alt``), and the weather. For machine files of type ``serial`` the same stands there once more: q1
about the pole (or the vertical), right-handed, so that it is minus the hour angle (or minus the azimuth), q2 the declination
(or altitude), and the star as a point at ``DISTANCE``, x where the meridian cuts the equator (or the horizon in the north), z
at the pole (or the zenith).
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.recording.table import Column, Table
from truepose.identification.recording.text import ArrowCells
from truepose.wording import cut

DISTANCE: Final = 1000.0
"""mm: a direction's error of 1 mrad is one of 1 mm."""
_OPTION: Final = re.compile(r"^\s*:\s*([A-Za-z]+)", re.MULTILINE)
_OPTIONS: Final = frozenset(
    {"NODA", "EQUAT", "ALTAZ", "ALLSKY", "GIMBAL", "J2000", "ROTNL", "ROTNR", "ROTTEL"}
)
WHOLE_MOST: Final = 10_000.0
"""Hours or degrees: no star and no encoder is further round."""
_FIELDS = 14
_ENOUGH = 5
"""Stars from which on a gap between them may be where the axis never was."""
STAR: Final = "star"
"""Name of the sensor whose readings the stars are."""
NAMES: Final[Mapping[str, tuple[str, str]]] = {"equatorial": ("ha", "dec"), "alt-az": ("az", "alt")}
_WEATHER: Final = (
    ("temperature.air", 6, 1.0, -90.0, 60.0),
    ("pressure", 7, 1.0, 400.0, 1100.0),
    ("humidity", 9, 100.0, -1.0, 101.0),
)
"""Column, word on the line, factor, and between which values it is believed."""
_UNITS: Final[Mapping[str, str]] = {"temperature.air": "degC", "pressure": "hPa", "humidity": "%"}


def is_tpoint(text: str) -> bool:
    """Return True if a text has one of the format's options."""
    return any(found[1].upper() in _OPTIONS for found in _OPTION.finditer(text))


@dataclass(frozen=True)
class Site:
    """What a file says of the mount and the night: kind, latitude (rad), and the weather by column, in its unit."""

    kind: str
    latitude: float
    weather: Mapping[str, float]


def read_tpoint(text: str, file: str) -> Table:
    """Return columns of the encoders, of the stars and of the weather. Raises InputError naming file and line."""
    site, stars = _read(text, file)
    if not stars:
        raise InputError(f"{file}: found no star, expected lines of right ascensions and declinations")
    ra, dec, ra_read, dec_read, sidereal = np.array([_numbers(*star, file) for star in stars]).T
    true, read = (sidereal - ra, dec), (sidereal - ra_read, dec_read)
    if site.kind == "alt-az":
        true, read = (_horizontal(*angles, site.latitude) for angles in (true, read))
    first, second = NAMES[site.kind]
    level = np.cos(true[1])
    point = [level * np.cos(true[0]), -level * np.sin(true[0]), np.sin(true[1])]
    angles = {
        first: _in_one_piece(read[0]),
        second: _in_one_piece(read[1]),
        f"{STAR}.{first}": _wrapped(true[0]),
        f"{STAR}.{second}": true[1],
    }
    values = {name: ("deg", np.degrees(angle)) for name, angle in angles.items()}
    values |= {name: (_UNITS[name], np.full(len(stars), value)) for name, value in site.weather.items()}
    values |= {"q1": ("deg", np.degrees(-_wrapped(read[0]))), "q2": ("deg", np.degrees(read[1]))}
    values |= {axis: ("mm", DISTANCE * part) for axis, part in zip("xyz", point, strict=True)}
    columns = tuple(Column(name, unit) for name, (unit, _) in values.items())
    cells = {name: ArrowCells(v) for name, (_, v) in values.items()}
    note = (
        f"{file}: {site.kind} mount at latitude {np.degrees(site.latitude):.4f} deg; refraction is left in; q1 q2 x y z say "
        f"the same for a machine file of type serial that sees stars as points at {DISTANCE:g} mm"
    )
    where = [number for number, _ in stars]
    return Table(file, columns, cells, len(stars), where.__getitem__, (note,))


MACHINE: Final = """# A telescope's mount, begun from {file}. Lines marked CHECK are yours to check.
schema: truepose/machine/1
name: mount
mechanism:
  type: mount
  kind: {kind}
  latitude: {latitude:.6f}
frames:
  base: {{in: world, tolerance: {{xyz: 0, rpy: [2, 2, 0]}}}}  # CHECK: deg, how well the first axis was aligned
  tool: {{in: flange, tolerance: {{xyz: 0, rpy: [0, 0, 1]}}}} # CHECK: deg, squareness of the tube to the second
sensor:
  type: direction # of the star, which the tube points at
  name: {star}
  angles: [{first}, {second}]
  sigma: {{angle: 10 arcsec}} # CHECK: seeing and centring
tolerances: {{angle: 0.5, {first}.offset: .inf, {second}.offset: .inf}} # CHECK: deg, of {second}.tilt; zeros are unknown
"""
"""Tolerances of a portable mount; an observatory's are a tenth of them."""


def machine_text(text: str, file: str) -> str:
    """Return a machine file to start from for the recording of such a text. Raises InputError as ``read_tpoint`` does."""
    site, _ = _read(text, file)
    first, second = NAMES[site.kind]
    latitude = np.degrees(site.latitude)
    name = file.rsplit("/", 1)[-1]
    return MACHINE.format(file=name, kind=site.kind, latitude=latitude, star=STAR, first=first, second=second)


def _read(text: str, file: str) -> tuple[Site, list[tuple[int, Sequence[str]]]]:
    """Return what the head says, and the lines of stars with their numbers."""
    options = {found[1].upper() for found in _OPTION.finditer(text)}
    if "GIMBAL" in options:
        raise InputError(f"{file}: option :GIMBAL: expected a mount that is equatorial or altazimuth")
    said = [(k, line.split()) for k, line in enumerate(text.splitlines(), start=1)]
    lines: list[tuple[int, Sequence[str]]] = [
        (k, words) for k, words in said if words and words[0][0] not in "!:"
    ]
    number, words = lines[1] if len(lines) > 1 else (0, [])  # the first line is a caption, which says nothing
    try:
        latitude = _angle(words[:3], 1.0)
    except ValueError:
        raise InputError(
            f"{file}: line {number}: found {cut(' '.join(words))!r}, expected a latitude first: deg m s"
        ) from None
    stars = list(itertools.takewhile(lambda star: star[1][0].upper() != "END", lines[2:]))
    return Site("alt-az" if "ALTAZ" in options else "equatorial", latitude, _weather(words)), stars


def _weather(words: Sequence[str]) -> dict[str, float]:
    """Return temperature, pressure and humidity, as far as they are there and possible."""
    out = {}
    for name, at, scale, low, high in _WEATHER:
        try:
            value = scale * float(words[at])
        except (IndexError, ValueError):
            break
        if low < value < high:
            out[name] = value
    return out


def _numbers(number: int, words: Sequence[str], file: str) -> list[float]:
    """Return right ascension, declination, both as read, and sidereal time of a star's line, rad."""
    try:
        if len(words) < _FIELDS:
            raise ValueError
        angles = [_angle(words[k : k + 3], 15.0 if k % 6 == 0 else 1.0) for k in range(0, 12, 3)]
        return [*angles, _angle([*words[12:14], "0"], 15.0)]
    except ValueError:
        raise InputError(
            f"{file}: line {number}: found {cut(' '.join(words))!r}, expected right ascension (h m s) and declination "
            "(deg m s), the same as read, and the sidereal time (h m)"
        ) from None


def _angle(words: Sequence[str], scale: float) -> float:
    """Return h m s or deg m s in radians; the sign stands at the first. Raises ValueError for what is none."""
    whole, minutes, seconds = (abs(float(word)) for word in words)
    if not (whole <= WHOLE_MOST and minutes < 60.0 and seconds < 60.0):
        raise ValueError
    size = scale * (whole + minutes / 60.0 + seconds / 3600.0)
    return float(np.radians(-size if words[0].startswith("-") else size))


def _wrapped(angle: Array) -> Array:
    """Return angles in half a turn on both sides of 0."""
    return np.asarray(np.angle(np.exp(1j * angle)))


def _in_one_piece(angle: Array) -> Array:
    """Return angles without a jump of a turn where the axis went through: cut in the widest gap that no star was seen in."""
    turned = _wrapped(angle)
    if len(turned) < _ENOUGH:
        return turned
    order = np.sort(turned)
    gaps = np.diff([*order, order[0] + 2 * np.pi])
    cut = order[np.argmax(gaps)] + gaps.max() / 2
    out = np.where(turned > cut, turned - 2 * np.pi, turned)
    return np.asarray(out - 2 * np.pi * np.round(np.median(out) / (2 * np.pi)))


def _horizontal(hour: Array, dec: Array, latitude: float) -> tuple[Array, Array]:
    """Return azimuth from the north by the east, and altitude, rad."""
    east = -np.cos(dec) * np.sin(hour)
    north = np.sin(dec) * np.cos(latitude) - np.cos(dec) * np.cos(hour) * np.sin(latitude)
    up = np.sin(dec) * np.sin(latitude) + np.cos(dec) * np.cos(hour) * np.cos(latitude)
    return np.arctan2(east, north), np.arcsin(np.clip(up, -1.0, 1.0))
