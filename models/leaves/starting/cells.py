"""Cells of a Denavit-Hartenberg table as data sheets print them: ``pi/2``, ``-90``, ``90°``, ``θ1 - 90``, ``±170``."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from truepose.errors import InputError

_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3, "in": 25.4, "inch": 25.4}
_DEG = {
    "deg": 1.0,
    "°": 1.0,
    "degree": 1.0,
    "degrees": 1.0,
    "rad": 180.0 / math.pi,
    "radian": 180.0 / math.pi,
}
UNITS = {"length": _MM, "angle": _DEG}
"""Factors to mm and to deg."""
_NUMBER = r"(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][-+]?\d+)?"
_PI = re.compile(rf"^([-+]?)({_NUMBER})?\*?(?:pi|π)(?:/({_NUMBER}))?$", re.IGNORECASE)
_PLAIN = re.compile(rf"^[-+]?{_NUMBER}$")
_UNIT = re.compile(r"^(.*?[\d.,iπ])\s*(mm|cm|m|um|µm|inch|in|deg|°|degrees?|rad|radian)$", re.IGNORECASE)
_LETTER = r"(?:θ|theta|th|q|d|var)_?\{?\d*\}?\*?"
_VARIABLE = re.compile(rf"^([-+]?)({_LETTER})", re.IGNORECASE)
_VARIABLE_LAST = re.compile(rf"^(.*?)\s*\+\s*({_LETTER})$", re.IGNORECASE)
_PRINTED = str.maketrans("−–º˚₀₁₂₃₄₅₆₇₈₉", "--°°0123456789")
_RADIANS = (math.pi / 4, math.pi / 2, math.pi, 3 * math.pi / 2)


@dataclass(frozen=True)
class Cell:
    """A number in mm or deg, and whether its text (or its column) says in which unit it stood."""

    value: float
    unit_said: bool


def cell(text: str, dimension: str, unit: str, where: str, *, variable: bool = False) -> Cell:
    """A number of ``dimension`` (length, angle) in mm or deg; ``unit`` is the column's, empty where it names none.

    With ``variable`` the joint's own variable may stand before it (``θ1 - 90``). Empty text and a dash are 0.
    Raises InputError, opened by ``where``, for what is no number, and for an angle that looks like radians although
    nothing says so.
    """
    plain = _normal(text)
    if variable:
        plain = _without_variable(plain, where, text)
    if plain in ("", "-"):
        return Cell(0.0, unit_said=True)
    found = _UNIT.match(plain)
    own = found[2].lower() if found else ""
    said = own or unit
    if said and said not in UNITS[dimension]:
        raise InputError(f"{where}: found {text!r}, expected {_expected(dimension)}")
    number = found[1].strip() if found else plain
    turned = _PI.match(number) if dimension == "angle" else None
    if turned:
        sign = -1.0 if turned[1] == "-" else 1.0
        return Cell(sign * _float(turned[2] or "1") * 180.0 / _float(turned[3] or "1"), unit_said=True)
    if not _PLAIN.match(number):
        raise InputError(f"{where}: found {text!r}, expected {_expected(dimension)}")
    value = _float(number)
    if dimension == "angle" and not said and any(abs(abs(value) - r) < 5e-4 * r for r in _RADIANS):
        raise InputError(
            f"{where}: found {text!r} without a unit, which looks like radians, expected a header such as "
            "`alpha [rad]` or `alpha [deg]`"
        )
    return Cell(
        value * UNITS[dimension][said or ("mm" if dimension == "length" else "deg")], unit_said=bool(said)
    )


def interval(text: str, dimension: str, unit: str, where: str) -> tuple[float, float]:
    """A range in mm or deg: ``-170..170``, ``-170 to 170``, ``±170``, ``[-170, 170]``. Raises InputError otherwise."""
    plain = _normal(text).strip("[]()")
    symmetric = re.match(r"^(?:±|\+/-|\+-)(.*)$", plain)
    if symmetric:
        high = cell(symmetric[1], dimension, unit, where).value
        return -high, high
    parts = [part for part in re.split(r"\s*(?:\.\.\.?|\bto\b|;|,(?=\s)|/)\s*", plain) if part]
    if len(parts) != 2:
        raise InputError(f"{where}: found {text!r}, expected two numbers such as -170..170, or ±170")
    ends = [cell(part, dimension, unit, where).value for part in parts]
    return min(ends), max(ends)


def variable_in(text: str) -> str:
    """Return the joint's variable that a cell names, as in ``θ1``, ``q2 - 90``, ``90 + q2``; empty where it names none."""
    plain = _normal(text)
    found = _VARIABLE.match(plain) or _VARIABLE_LAST.match(plain)
    return found[2].lower() if found else ""


def _without_variable(text: str, where: str, found: str) -> str:
    last = _VARIABLE_LAST.match(text)
    match = _VARIABLE.match(text)
    if last and not match:
        return last[1]
    if not match:
        return text
    if match[1] == "-":
        raise InputError(
            f"{where}: found {found!r}, a joint that turns against its axis, expected a positive variable: turn its "
            "axis round in the table (alpha + 180)"
        )
    rest = text[match.end() :].strip()
    return re.sub(r"^([-+])\s+", r"\1", rest).removeprefix("+")


def _normal(text: str) -> str:
    """Text with plain minus signs and digits, without spaces at its ends."""
    return text.strip().translate(_PRINTED)


def _float(text: str) -> float:
    return float(text.replace(",", "."))


def _expected(dimension: str) -> str:
    return (
        "a length such as 425, 0.425 m or 425 mm"
        if dimension == "length"
        else "an angle such as 90, -pi/2 or 90 deg"
    )
