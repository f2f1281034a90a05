"""Entries of the machine file's ``drivers:`` list: columns of recordings beyond the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import BeforeValidator, Field

from truepose.models.file.driver import DriverKind
from truepose.models.file.fields import Section


@dataclass(frozen=True)
class DriverSpec:
    """A driver as the file declares it; unit, what it drives and whose it is are None where the file leaves them out."""

    name: str
    unit: str | None = None
    drives: DriverKind | None = None
    of: str | None = None


class DriverEntry(Section):
    """A driver with its unit: ``{name: tilt.column, unit: deg}``."""

    name: str = Field(min_length=1)
    """Name of the recording's column."""
    unit: str | None = None
    """Unit of the column where its header names none: N*m, A, deg, bar ..."""
    drives: DriverKind | None = None
    """In which way it makes an error vary; left out: as its unit says (N, N*m, A, kg, bar: `load`; degC, W: `temperature`)."""
    of: str | None = None
    """Joint whose drive it tells of (N*m, A; N of a slide): the column then stands for `torque.JOINT` or `current.JOINT`."""

    def spec(self) -> DriverSpec:
        return DriverSpec(self.name, self.unit, self.drives, self.of)


def _named_driver(value: object) -> object:
    return {"name": value} if isinstance(value, str) else value


DriverField = Annotated[DriverEntry, BeforeValidator(_named_driver, json_schema_input_type=str | DriverEntry)]
