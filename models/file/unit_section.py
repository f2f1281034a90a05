"""The section ``units`` of a machine file."""

from __future__ import annotations

from pathlib import Path

from pydantic import ValidationError

from truepose.models.file.field_errors import input_error
from truepose.models.file.fields import Section
from truepose.models.units import UnitSystem, parse_unit


class UnitsSection(Section):
    length: str = "mm"
    """Unit of every length of the file and, unless a column says its own, of its recordings."""
    angle: str = "deg"
    """Unit of every angle of the file and, unless a column says its own, of its recordings."""
    joint: str | None = None
    """Unit of a hexapod's leg readings, where it is another than `length`: `turn` of a motor, say."""


def read_units(section: object, path: Path) -> UnitSystem:
    try:
        units = UnitsSection.model_validate(section)
    except ValidationError as exc:
        raise input_error(exc, path, "units") from None
    where = f"{path}: units"
    length = parse_unit(units.length, "length", f"{where}.length")
    angle = parse_unit(units.angle, "angle", f"{where}.angle")
    if units.joint is None:
        return UnitSystem(length, angle)
    return UnitSystem(length, angle, parse_unit(units.joint, "reading", f"{where}.joint"))
