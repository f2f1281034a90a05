"""A Fabry-Perot cavity read as the photocurrent of its reflected light, from which changes of length follow.

Irradiance reflected by a Fabry-Perot cavity, and back: fringe and phase as functions of each other.

Two plane mirrors of intensity reflectivities R1 (the fibre's end, say) and R2, nothing absorbed, normal
incidence. With g = sqrt(R1 R2) and the round trip's phase delta = 4 pi L / lambda, the sum of all reflected
beams is (Born and Wolf, Principles of Optics, section 7.6; derived for unequal mirrors)

    R(delta) = 1 - (1 - R1)(1 - R2) / (1 + g^2 - 2 g cos delta)

with its lowest value at delta = 0 (resonance) and its highest at pi; the period in L is lambda / 2. A mirror
that shifts the phase, or a detector's gain and offset, changes where fringes lie and how large they are, never
their shape: this depends on g alone. So the inverse works on the normalised fringe v, 0 at resonance and 1
between resonances, and gives cos delta; which of the two phases of a cosine it is, one value cannot tell.
Functions of arrays work elementwise, on any shape (...,) or a number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.file.fields import Length, bad_value
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.sensor import sensors
from truepose.models.sensors.distance import CavitySection, Distance, cavity_parameters

Reflectivities = tuple[float, float]


def coupling(reflectivities: Reflectivities) -> float:
    """g = sqrt(R1 R2), amplitude that a round trip keeps. InputError unless both lie in (0, 1)."""
    first, second = reflectivities
    if not (0.0 < first < 1.0 and 0.0 < second < 1.0):
        raise InputError(
            f"reflectivities: found {first:g} and {second:g}, expected two intensity reflectivities "
            "between 0 and 1"
        )
    return float(np.sqrt(first * second))


def round_trip_phase(length: Array | float, wavelength: Array | float) -> Array:
    """(...,) delta = 4 pi L / lambda, rad, for a cavity length and a wavelength in one unit."""
    return np.asarray(4.0 * np.pi * np.asarray(length) / np.asarray(wavelength))


def reflectance(phase: Array | float, reflectivities: Reflectivities) -> Array:
    """(...,) share of the light that comes back at a round-trip phase (rad), in [0, 1]."""
    g = coupling(reflectivities)
    apart = (np.sqrt(reflectivities[0]) - np.sqrt(reflectivities[1])) ** 2
    swing = 4.0 * g * np.sin(0.5 * np.asarray(phase)) ** 2  # a sum of squares: no cancellation at resonance
    return np.asarray((apart + swing) / ((1.0 - g) ** 2 + swing))


def irradiance(
    length: Array | float,
    wavelength: Array | float,
    reflectivities: Reflectivities,
    gain: Array | float = 1.0,
    offset: Array | float = 0.0,
) -> Array:
    """(...,) signal of the detector, offset + gain * R, in its own unit; length and wavelength in one unit."""
    return offset + gain * reflectance(round_trip_phase(length, wavelength), reflectivities)


def fringe(cosine: Array | float, g: float) -> Array:
    """(...,) v in [0, 1] at cos(delta), for a round trip that keeps the amplitude g."""
    c = np.asarray(cosine)
    return np.asarray((1.0 + g) ** 2 * (1.0 - c) / (2.0 * (1.0 + g * g - 2.0 * g * c)))


def fringe_slope(phase: Array | float, g: float) -> Array:
    """(...,) dv / d delta at a phase (rad)."""
    d = np.asarray(phase)
    airy = 1.0 + g * g - 2.0 * g * np.cos(d)
    return np.asarray((1.0 - g * g) ** 2 * np.sin(d) / (2.0 * airy * airy))


def cosine(v: Array | float, g: float) -> Array:
    """(...,) cos(delta) of a normalised fringe, in [-1, 1]; values outside [0, 1] (noise) count as its ends."""
    inside = np.clip(v, 0.0, 1.0)
    flat = (1.0 + g) ** 2
    return np.asarray(np.clip((flat - 2.0 * (1.0 + g * g) * inside) / (flat - 4.0 * g * inside), -1.0, 1.0))


def folded_phase(v: Array | float, g: float) -> Array:
    """(...,) phase in [0, pi] of a normalised fringe, rad."""
    return np.asarray(np.arccos(cosine(v, g)))


def phase_noise(v: Array | float, v_noise: Array | float, g: float) -> Array:
    """(...,) 1-sigma of ``folded_phase``, rad, for a 1-sigma of v.

    Near the ends of a fringe, where the slope vanishes, an error e of the cosine turns the phase by
    sqrt(2 e): the two cases are joined smoothly.
    """
    c = cosine(v, g)
    inside = np.clip(v, 0.0, 1.0)
    slope = 2.0 * (1.0 - g * g) ** 2 / ((1.0 + g) ** 2 - 4.0 * g * inside) ** 2
    error = slope * np.asarray(v_noise)
    return np.asarray(np.minimum(error / np.sqrt(1.0 - c * c + error + 1e-300), np.pi))


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
    wavelength: Length = Field(gt=0.0)
    """Wavelength of the light."""
    reflectivities: Annotated[Reflectivities, BeforeValidator(_reflectivities), _SHARES]
    """Reflectivities of the fibre's end and of the mirror, as shares of the intensity."""


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
