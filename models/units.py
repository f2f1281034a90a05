"""Units: texts parsed by pint, values turned into the program's own units.

Inside the program lengths are mm, angles rad, torques N*m, forces N, masses kg, times s, temperatures
degC, pressures hPa and plain numbers "1". Files choose their own: a `UnitSystem` says which, and the
annotated types below (`Length`, `AngleVector`, ...) convert while pydantic validates a section, given
`context={"units": UnitSystem(...)}`.

Use `parse_unit` to check a unit text a user wrote, `convert` for a value or an array, and the
annotated types inside a `Section` for everything written in a machine file. Angles are told apart from
plain numbers (pint itself does not): a length, a pure angle and a pure number never stand in for one
another, while in a compound unit such as rad/(N*m) the radian counts as 1.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, cast, overload

import numpy as np
import numpy.typing as npt
import pint
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from truepose.errors import InputError

FloatArray = npt.NDArray[np.float64]

INTERNAL: Final[Mapping[str, str]] = {
    "length": "mm",
    "angle": "rad",
    "time": "s",
    "temperature": "degC",
    "mass": "kg",
    "force": "N",
    "torque": "N*m",
    "pressure": "hPa",
    "number": "1",
}
"""Internal unit of each named dimension."""

_ARTICLE = {"angle": "an angle", "number": "a plain number"}
_LONGEST_UNIT = 60
# pint computes powers while it parses: 9**9**9 would never end
_TOWER = re.compile(r"(\*\*|\^)[^A-Za-z]*(\*\*|\^)|\d{3,}")


@functools.cache
def _registry() -> pint.UnitRegistry[Any]:
    return pint.UnitRegistry(cache_folder=None)


@functools.cache
def _unit(text: str) -> pint.Unit | None:
    """The unit a text means, None when it means none."""
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


@overload
def convert(value: float, unit: str, to: str, where: str = "") -> float: ...
@overload
def convert(value: FloatArray, unit: str, to: str, where: str = "") -> FloatArray: ...
def convert(value: float | FloatArray, unit: str, to: str, where: str = "") -> float | FloatArray:
    """A value or an array of any shape, given in `unit`, in the unit `to`.

    Raises InputError, opening with `where`, when the unit is unknown or of another dimension.
    """
    if unit == to:
        return value
    parse_unit(unit, to, where)
    scale = _scale(unit, to)
    if scale is not None:
        return value * scale
    converted: float | FloatArray = _registry().Quantity(value, _unit(unit)).to(_unit(to)).magnitude
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
        """The file's unit for what is in ``unit`` inside: lengths and angles; all else stays as it is."""
        return {"mm": self.length, "rad": self.angle}.get(unit, unit)

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

    @overload
    def to_internal(self, value: float, dimension: str) -> float: ...
    @overload
    def to_internal(self, value: FloatArray, dimension: str) -> FloatArray: ...
    def to_internal(self, value: float | FloatArray, dimension: str) -> float | FloatArray:
        """A value of the file, or an array of any shape, in internal units."""
        return convert(value, self.of(dimension), self.internal(dimension))

    @overload
    def from_internal(self, value: float, dimension: str) -> float: ...
    @overload
    def from_internal(self, value: FloatArray, dimension: str) -> FloatArray: ...
    def from_internal(self, value: float | FloatArray, dimension: str) -> float | FloatArray:
        """A value in internal units, or an array of any shape, in the units of the file."""
        return convert(value, self.internal(dimension), self.of(dimension))


def _units(info: ValidationInfo) -> UnitSystem:
    context = info.context
    if isinstance(context, Mapping) and isinstance(context.get("units"), UnitSystem):
        return cast("UnitSystem", context["units"])
    return UnitSystem()


def bad_value(expected: str, found: object) -> PydanticCustomError:
    """The error an annotated type raises: what was expected and what was found."""
    return PydanticCustomError("bad_value", "expected {expected}", {"expected": expected, "found": found})


@dataclass(frozen=True)
class _Numbers:
    """Which numbers a field takes, and the words for them around "number"."""

    kind: str
    limits: str
    fits: Callable[[float], bool]

    def words(self, unit: str, count: int = 1) -> str:
        number = f"a {self.kind}number" if count == 1 else f"{count} {self.kind}numbers"
        return f"{number}{self.limits} ({unit})"

    def checked(self, value: object, expected: str) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not self.fits(float(value)):
            raise bad_value(expected, value)
        return float(value)


_FINITE = _Numbers("finite ", "", math.isfinite)
_TOLERANCE = _Numbers("", " >= 0 or .inf", lambda value: value >= 0.0)
_SIGMA = _Numbers("finite ", " > 0", lambda value: 0.0 < value < math.inf)


def _scalar(dimension: str, numbers: _Numbers = _FINITE) -> BeforeValidator:
    def validate(value: object, info: ValidationInfo) -> float:
        units = _units(info)
        return units.to_internal(numbers.checked(value, numbers.words(units.of(dimension))), dimension)

    return BeforeValidator(validate)


def _vector(dimension: str, numbers: _Numbers = _FINITE) -> BeforeValidator:
    def validate(value: object, info: ValidationInfo) -> tuple[float, ...]:
        units = _units(info)
        expected = numbers.words(units.of(dimension), 3)
        if numbers is _TOLERANCE and not isinstance(value, (list, tuple)):
            value = [value] * 3  # one tolerance for the three components
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise bad_value(expected, value)
        return tuple(units.to_internal(numbers.checked(item, expected), dimension) for item in value)

    return BeforeValidator(validate)


Triple = tuple[float, float, float]
Number = Annotated[float, _scalar("number")]
Length = Annotated[float, _scalar("length")]
Angle = Annotated[float, _scalar("angle")]
Gain = Annotated[float, _scalar("gain")]
Vector = Annotated[Triple, _vector("number")]
LengthVector = Annotated[Triple, _vector("length")]
AngleVector = Annotated[Triple, _vector("angle")]
LengthSigma = Annotated[float, _scalar("length", _SIGMA)]
AngleSigma = Annotated[float, _scalar("angle", _SIGMA)]
NumberTolerance = Annotated[float, _scalar("number", _TOLERANCE)]
LengthTolerance = Annotated[float, _scalar("length", _TOLERANCE)]
AngleTolerance = Annotated[float, _scalar("angle", _TOLERANCE)]
LengthToleranceVector = Annotated[Triple, _vector("length", _TOLERANCE)]
AngleToleranceVector = Annotated[Triple, _vector("angle", _TOLERANCE)]


def meant(name: str, known: Iterable[str]) -> str:
    """Ending of a message: the known name meant; empty where none is near."""
    near = difflib.get_close_matches(name, sorted(set(known)), n=3, cutoff=0.6)
    return "did you mean " + " or ".join(repr(item) for item in near) + "?" if near else ""


def close_matches(name: str, known: Iterable[str]) -> str:
    """Ending of a message: the known name meant, or the names there are."""
    names = sorted(set(known))
    return meant(name, names) or ("known: " + ", ".join(names) if names else "")


class Section(BaseModel):
    """A part of the machine file: frozen, and every field it does not know is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_fields(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        known = [field.alias or name for name, field in cls.model_fields.items()]
        for key in data:
            if key not in known:
                hint = close_matches(str(key), known)
                context = {"field": str(key), "hint": hint, "found": data[key]}
                raise PydanticCustomError("unknown_field", "unknown field; {hint}", context)
        return data
