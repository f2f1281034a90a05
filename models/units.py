"""Units: texts parsed by pint, values turned into the program's own units.

Inside the program lengths are mm, angles rad, torques N*m, forces N, masses kg, times s, temperatures
degC, pressures hPa and plain numbers "1". Files choose their own: a `UnitSystem` says which.

Use `parse_unit` to check a unit text a user wrote, `convert` for a value or an array, and the
types of `truepose.models.file.fields` for everything written in a machine file. Angles are told apart from
plain numbers (pint itself does not): a length, a pure angle and a pure number never stand in for one
another, while in a compound unit such as rad/(N*m) the radian counts as 1.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar, cast

import pint

from truepose.arrays import Array
from truepose.errors import InputError

N = TypeVar("N", float, Array)
INTERNAL: Final[Mapping[str, str]] = {
    "length": "mm", "angle": "rad", "time": "s", "temperature": "degC", "mass": "kg", "force": "N",
    "torque": "N*m", "stiffness": "N/mm", "pressure": "hPa", "number": "1",
}  # fmt: skip
"""Internal unit of each named dimension."""

_ARTICLE = {"angle": "an angle", "number": "a plain number"}
_LONGEST_UNIT = 60
# pint computes powers while it parses: 9**9**9 would never end
_TOWER = re.compile(r"(\*\*|\^)[^A-Za-z]*(\*\*|\^)|\d{3,}")
_COUNTS = re.compile(r"(turn|mm)/(-?\d+(?:\.\d+)?(?:e[+-]?\d+)?)")
COUNT_WORDS: Final = (
    "count", "counts", "inc", "incs", "increment", "increments", "lsb", "pulse", "pulses", "tick", "ticks",
)  # fmt: skip
"""What headers call an encoder's counts."""


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    return pint.UnitRegistry(cache_folder=None)


@functools.cache
def _unit(text: str) -> pint.Unit | None:
    """The unit a text means, None when it means none."""
    counts = _COUNTS.fullmatch(text)
    if counts:
        name = "counts_" + re.sub(r"\W", "_", text.replace("-", "_minus_"))
        _registry().define(f"{name} = {1.0 / float(counts[2])!r} * {counts[1]}")
        return _registry().Unit(name)
    if len(text) > _LONGEST_UNIT or _TOWER.search(text):
        return None
    try:
        return _registry().Unit(text.strip() or "?")
    except Exception:  # pint raises its own, tokenizer, type and attribute errors on bad text
        return None


@functools.cache
def _kind(text: str) -> tuple[tuple[str, float], ...]:
    """What must agree between two convertible units: dimensions, and what pure numbers count."""
    unit = _unit(text)
    if unit is None:
        raise InputError(f"unknown unit {text!r}")
    if unit.dimensionless:
        _, root = _registry().get_root_units(unit)
        return tuple(sorted((f"{name} counted", cast("float", power)) for name, power in root._units.items()))
    return tuple(sorted((str(name), cast("float", power)) for name, power in unit.dimensionality.items()))


def _describe(kind: tuple[tuple[str, float], ...]) -> str:
    for dimension, unit in INTERNAL.items():
        if _kind(unit) == kind:
            return _ARTICLE.get(dimension, f"a {dimension}")
    return "of dimension " + " ".join(f"{name}^{power:g}" for name, power in kind)


def parse_unit(text: object, dimension: str, where: str) -> str:
    """Check a unit a user wrote and return it.

    `dimension` is a key of `INTERNAL`, ``any``, ``reading`` (what a joint may be read in: a length, an
    angle or a count), or any unit text to be convertible to; `where` opens the message (file and
    field). Raises InputError for an unknown unit and for a wrong dimension.
    """
    what = _expected(dimension)
    prefix = f"{where}: " if where else ""
    if not isinstance(text, str):
        raise InputError(f"{prefix}expected the unit as text, {what}, found {text!r}")
    if _unit(text) is None:
        raise InputError(f"{prefix}unknown unit {text!r}, expected {what}")
    kind = _kind(text)
    if dimension == "reading":
        fits = kind == _kind("mm") or all(name.endswith("counted") for name, _ in kind)
    else:
        fits = dimension == "any" or kind == _kind(INTERNAL.get(dimension, dimension))
    if not fits:
        raise InputError(f"{prefix}unit {text!r} is {_describe(kind)}, expected {what}")
    return text.strip()


def _expected(dimension: str) -> str:
    if dimension == "any":
        return "a unit such as rad/(N*m)"
    if dimension == "reading":
        return "a length, an angle or a count such as mm, deg or turn"
    if dimension in INTERNAL:
        return f"{_ARTICLE.get(dimension, f'a {dimension}')} such as {INTERNAL[dimension]}"
    return f"a unit convertible to {dimension}"


def counts_unit(counts: float, unit: str) -> str:
    """Return the unit of an encoder's counts, so many a turn, or a mm where readings in ``unit`` are lengths."""
    return f"{'mm' if compatible(unit, 'mm') else 'turn'}/{counts:.17g}"


def is_unit(text: str) -> bool:
    """Whether a text is a unit."""
    return _unit(text) is not None


def compatible(unit: str, to: str) -> bool:
    """Whether a known unit can be converted to another."""
    return _unit(unit) is not None and _kind(unit) == _kind(to)


@functools.cache
def _scale(unit: str, to: str) -> float | None:
    """Factor from one unit to another, None when zeros differ (absolute temperatures)."""
    quantity = _registry().Quantity
    if quantity(0.0, _unit(unit)).to(_unit(to)).magnitude != 0.0:
        return None
    scale: float = quantity(1.0, _unit(unit)).to(_unit(to)).magnitude
    return scale


def convert(value: N, unit: str, to: str, where: str = "") -> N:
    """A value or an array of any shape, given in `unit`, in the unit `to`.

    Raises InputError, opening with `where`, when the unit is unknown or of another dimension.
    """
    if unit == to:
        return value
    parse_unit(unit, to, where)
    scale = _scale(unit, to)
    if scale is not None:
        return value * scale
    converted: N = _registry().Quantity(value, _unit(unit)).to(_unit(to)).magnitude
    return converted


@dataclass(frozen=True)
class UnitSystem:
    """The units a file is written in.

    `joint` is the unit of joint readings that are neither lengths nor angles of the mechanism itself
    (motor turns of a leg, say); such readings stay as recorded and `gain` is a length by that unit.
    """

    length: str = "mm"
    angle: str = "deg"
    joint: str | None = None

    def of(self, dimension: str) -> str:
        """The file's unit of `length`, `angle`, `joint`, `gain`, or of another key of INTERNAL."""
        if dimension in {"length", "angle"}:
            return self.length if dimension == "length" else self.angle
        if dimension == "joint":
            return self.joint or self.length
        if dimension == "gain":
            return "1" if self.joint is None else f"{self.length}/{self.joint}"
        return INTERNAL[dimension]

    def written(self, unit: str) -> str:
        """The file's unit for what is in ``unit`` inside: lengths, angles and their ratios; all else stays as it is."""
        ratios = {"mm/rad": f"{self.length}/({self.angle})", "rad/mm": f"{self.angle}/({self.length})"}
        return {"mm": self.length, "rad": self.angle, **ratios}.get(unit, unit)

    def of_joint(self, unit: str) -> str:
        """The unit of the column of a joint that is read in ``unit`` inside, unless its header says otherwise."""
        own = self.joint is not None and compatible(self.joint, unit)
        return self.of("joint") if own else self.written(unit)

    def internal(self, dimension: str) -> str:
        """The program's unit of the same dimension."""
        if dimension == "joint":
            return self.joint or INTERNAL["length"]
        if dimension == "gain":
            return "1" if self.joint is None else f"{INTERNAL['length']}/{self.joint}"
        return INTERNAL[dimension]

    def to_internal(self, value: N, dimension: str) -> N:
        """A value of the file, or an array of any shape, in internal units."""
        return convert(value, self.of(dimension), self.internal(dimension))

    def from_internal(self, value: N, dimension: str) -> N:
        """A value in internal units, or an array of any shape, in the units of the file."""
        return convert(value, self.internal(dimension), self.of(dimension))
