"""A named constant of a machine: its unit, its drawing value and how far the hardware may be from it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from truepose.models.units import UnitSystem

_COMPONENTS = ("a", "b", "u", "length", "offset", "gain")
_NUMBERED = re.compile(r"^(?P<element>.*?)\d*\.(?P<rest>.+)$")


@dataclass(frozen=True)
class Parameter:
    """One geometric constant, in internal units (mm, rad).

    ``tolerance`` is the 1-sigma statement of the drawing: 0 means exactly known, inf means unknown.
    ``part`` names the class of part whose tolerances were stated together; a wrong statement is
    wrong for the whole class (diagnosis: inflation of tolerances).
    """

    name: str
    unit: str
    nominal: float
    tolerance: float = 0.0
    part: str = "length"
    field: tuple[str | int, ...] = ()
    """Where the value stands in the machine file's document; empty when it stands nowhere."""

    @property
    def free(self) -> bool:
        """Whether the drawing leaves anything to be estimated."""
        return self.tolerance > 0.0

    def written_in(self, units: UnitSystem) -> str:
        """Its unit in a file of such units."""
        return units.of("gain") if self.part == "gain" else units.written(self.unit)

    @property
    def scale(self) -> float:
        """What one step of this parameter is measured in: its tolerance, or a natural size when unknown."""
        if self.free and math.isfinite(self.tolerance):
            return self.tolerance
        return {"mm": 100.0, "rad": 1.0}.get(self.unit, 1.0)


def element_of(name: str) -> str:
    """The part that a parameter, or the end of a rod, is of: ``leg3`` of ``leg3.a.x``."""
    return name.partition(".")[0]


def vector_of(name: str) -> str:
    """What a parameter is a component of: ``leg3.a`` of ``leg3.a.x``; a plain name is its own."""
    return name.rpartition(".")[0] or name


def like_parts(name: str) -> str:
    """What numbered parts have alike: ``leg.a`` of ``leg3.a.x``, ``q`` of ``q4.beta``."""
    match = _NUMBERED.match(name)
    if match is None:
        return name
    head = element_of(match["rest"])
    return f"{match['element']}.{head}" if head in _COMPONENTS else match["element"]
