"""The section ``masses`` of a machine file: what has weight, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

from pydantic import Field

from truepose.models.file.fields import LengthToleranceVector, LengthVector, Mass, MassTolerance, Section

_ZERO = (0.0, 0.0, 0.0)
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class MassSpec:
    """A mass in kg with its centre `com` (mm) in the frame of the body `in_`, and 1-sigma of both: 0 exactly known."""

    name: str
    kg: float
    com: Triple
    in_: str
    kg_tolerance: float = 0.0
    com_tolerance: Triple = _ZERO

    @property
    def known(self) -> bool:
        """Whether nothing of it is to be estimated."""
        return not any((self.kg_tolerance, *self.com_tolerance))


class MassToleranceSection(Section):
    kg: MassTolerance = 0.0
    """1-sigma of the mass; .inf where it is unknown."""
    com: LengthToleranceVector = _ZERO
    """1-sigma of its centre."""


class MassSection(Section):
    kg: Mass = Field(ge=0.0)
    """Mass. That of the mass called `payload` is replaced by the recording's column `payload`."""
    com: LengthVector = _ZERO
    """Centre of mass in the frame of `in`."""
    in_: str = Field(alias="in")
    """Body that carries it: linkK of a serial arm, `platform`, a body of the graph or URDF, `flange`, `tool` or `base`."""
    tolerance: MassToleranceSection = MassToleranceSection()
    """How well both are known; left out: exactly. Otherwise `NAME.kg`, `NAME.x` ... are estimated where effects read loads."""


__all__ = ["MassSection", "MassSpec"]
