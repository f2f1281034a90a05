"""Which tolerance of the machine file's ``tolerances:`` section a named parameter takes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from truepose.errors import InputError
from truepose.models.file.fields import quantity
from truepose.models.units import UnitSystem, compatible, convert
from truepose.wording import close_matches

_AXES, _TURNS, _DIRECTION = ("x", "y", "z"), ("rx", "ry", "rz"), "u"


@dataclass(frozen=True)
class Tolerances:
    """Default 1-sigma tolerances and overrides.

    `length` mm, `angle` rad, 0.0 where the file has none. `overrides` are as written, in the file's units, or as texts
    with their own (`20um`): one number for a name, or numbers for a vector, keyed by a parameter (`leg3.a.x`), by what it
    is a component of (`leg3.a`, `tool`, `tool.xyz`, `tool.rpy`), or by the end of its name (`gain`, `a`,
    `u.x`), which then holds for every element. The more specific key wins.
    """

    length: float = 0.0
    angle: float = 0.0
    overrides: Mapping[str, tuple[float | str, ...]] = field(default_factory=dict)
    units: UnitSystem = field(default_factory=UnitSystem)
    file: str = ""

    def override_for(self, parameter: str, unit: str) -> float | None:
        """The tolerance the file states for this very parameter, in the parameter's unit; None if none.

        A component of a direction (`leg1.u.x`) takes an angle: rad, whatever `unit` says.
        """
        for key, place in _keys(parameter):
            values = self.overrides.get(key)
            if values is None:
                continue
            value = _pick(values, place)
            if value is None:
                expected = "1 number" if place is None else "3 numbers"
                raise InputError(f"{self.file}: tolerances.{key}: expected {expected}, found {list(values)}")
            return self._convert(value, parameter, unit, key)
        return None

    def check(self, parameters: Iterable[str]) -> None:
        """Raise InputError when an override fits none of these parameters."""
        names = list(parameters)
        meant = {key for name in names for key, _ in _keys(name)}
        for key in self.overrides:
            if key not in meant:
                hint = close_matches(key, meant)
                raise InputError(f"{self.file}: tolerances.{key}: no such parameter; {hint}")

    def _convert(self, value: float | str, parameter: str, unit: str, key: str) -> float:
        where = f"{self.file}: tolerances.{key}"
        if isinstance(value, str):
            own = "rad" if _is_direction(parameter) else unit
            stated = quantity(value, own)
            if stated is None:
                raise InputError(
                    f"{where}: found {value!r}, expected a number with a unit convertible to {own}"
                )
            return stated
        if _is_direction(parameter):
            return convert(value, self.units.angle, "rad", where)
        dimensions = ("length", "angle", "gain")
        for dimension in dimensions:
            if unit == self.units.internal(dimension):
                return convert(value, self.units.of(dimension), unit, where)
        for dimension in dimensions:
            if compatible(self.units.of(dimension), unit):
                return convert(value, self.units.of(dimension), unit, where)
        return convert(value, self.units.written(unit), unit, where)


def _is_direction(parameter: str) -> bool:
    parts = parameter.split(".")
    return len(parts) > 1 and parts[-2] == _DIRECTION and parts[-1] in _AXES


def _keys(parameter: str) -> list[tuple[str, int | None]]:
    """Keys that cover a parameter, most specific first, with its place in a vector (None: a number)."""
    parts = parameter.split(".")
    stem, last = ".".join(parts[:-1]), parts[-1]
    keys: list[tuple[str, int | None]] = [(parameter, None)]
    if stem and last in _AXES:
        keys += [(f"{stem}.xyz", _AXES.index(last)), (stem, _AXES.index(last))]
    elif stem and last in _TURNS:
        keys += [(f"{stem}.rpy", _TURNS.index(last)), (stem, 3 + _TURNS.index(last))]
    for first in range(1, len(parts)):
        keys.append((".".join(parts[first:]), None))
        if first < len(parts) - 1 and last in _AXES:
            keys.append((".".join(parts[first:-1]), _AXES.index(last)))
    return keys


def _pick(values: tuple[float | str, ...], place: int | None) -> float | str | None:
    if place is None:
        return values[0] if len(values) == 1 else None
    if len(values) == 1 and place < 3:
        return values[0]
    if place < len(values) and len(values) in {3, 6}:
        return values[place]
    return None
