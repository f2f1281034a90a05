"""A Fabry-Perot cavity read as the photocurrent of its reflected light, from which changes of length follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, WithJsonSchema, model_validator

from truepose.models.file.fields import Length, bad_value
from truepose.models.machine.context import BuildContext
from truepose.models.machine.fabry_perot import Reflectivities
from truepose.models.sensors.base import sensors
from truepose.models.sensors.distance import CavitySection, Distance, cavity_parameters


def _reflectivities(value: object) -> Reflectivities:
    expected = "two intensity reflectivities [r1, r2] between 0 and 1"
    if not isinstance(value, (list, tuple)) or len(value) != 2:
        raise bad_value(expected, value)
    first, second = value
    for one in (first, second):
        if isinstance(one, bool) or not isinstance(one, (int, float)) or not 0.0 < one < 1.0:
            raise bad_value(expected, value)
    return float(first), float(second)


_SHARES = WithJsonSchema(
    {
        "type": "array",
        "items": {"type": "number", "exclusiveMinimum": 0, "exclusiveMaximum": 1},
        "minItems": 2,
        "maxItems": 2,
    }
)


class _IrradianceSection(CavitySection):
    type: Literal["irradiance"]
    """A cavity's photocurrent (`--irradiance FILE`: columns `pose t I`), turned into `dL` by counting fringes."""
    wavelength: Length
    """Wavelength of the light."""
    reflectivities: Annotated[Reflectivities, BeforeValidator(_reflectivities), _SHARES]
    """Reflectivities of the fibre's end and of the mirror, as shares of the intensity."""

    @model_validator(mode="after")
    def _check(self) -> _IrradianceSection:
        if self.wavelength <= 0.0:
            raise bad_value("wavelength > 0", self.wavelength)
        return self


@sensors.add("irradiance")
@dataclass(frozen=True)
class Irradiance(Distance):
    """dL as ``distance`` has it, counted in fringes of a photocurrent (nanopositioner paper, section II).

    ``wavelength`` in mm; ``reflectivities`` of the fibre's end and of the mirror, as shares of the intensity.
    """

    wavelength: float
    reflectivities: Reflectivities
    type = "irradiance"

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Irradiance:
        """From the fields of ``distance``, ``wavelength`` and ``reflectivities``."""
        parsed = context.parse(_IrradianceSection, section)
        return cls(
            cavity_parameters(parsed, context),
            parsed.sigma.distance,
            parsed.mirror.in_ == "flange",
            parsed.wavelength,
            parsed.reflectivities,
        )
