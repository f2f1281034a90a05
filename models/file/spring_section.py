"""The section ``loads`` of a machine file: springs, hoses and balancers between two bodies."""

from __future__ import annotations

from pydantic import Field, model_validator

from truepose.models.file.fields import (
    Force,
    ForceTolerance,
    Length,
    LengthTolerance,
    LengthVector,
    Section,
    Stiffness,
    StiffnessTolerance,
    bad_value,
)


class SpringEnd(Section):
    """Where a spring is hooked in."""

    in_: str = Field(alias="in")
    """Body that it is hooked to: as for masses, `base` for what stands still."""
    at: LengthVector = (0.0, 0.0, 0.0)
    """The point in the body's frame."""


class SpringTolerance(Section):
    """How well a spring is known."""

    stiffness: StiffnessTolerance = 0.0
    """1-sigma of the stiffness."""
    free_length: LengthTolerance = 0.0
    """1-sigma of the free length."""
    force: ForceTolerance = 0.0
    """1-sigma of the force."""


class SpringSection(Section):
    """A spring, or a balancer of constant force: it pulls its ends together."""

    from_: SpringEnd = Field(alias="from")
    """One end."""
    to: SpringEnd
    """The other end."""
    stiffness: Stiffness = Field(default=0.0, ge=0.0)
    """Force for each millimetre that it is longer than `free_length`; 0: a balancer."""
    free_length: Length = Field(default=0.0, ge=0.0)
    """Distance of its ends at which a spring pulls at nothing but `force`."""
    force: Force = 0.0
    """Constant force that pulls the ends together; below 0 it pushes them apart (a gas spring)."""
    tolerance: SpringTolerance = SpringTolerance()
    """How well they are known; left out: exactly. Otherwise `NAME.stiffness` ... are estimated where effects read loads."""

    @model_validator(mode="after")
    def _pulls(self) -> SpringSection:
        tolerance = self.tolerance
        if not any((self.stiffness, self.force, tolerance.stiffness, tolerance.force)):
            raise bad_value("stiffness or force", 0.0)
        return self
