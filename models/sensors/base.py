"""What a sensor is: columns, parameters, noise, and a residual as a function of the tool's pose.

To add one, write a file in this folder (or a plugin): a frozen dataclass whose class is registered with
``@sensors.add(type)`` and that builds itself from its section of the machine file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.models.context import BuildContext
from truepose.models.parameters import Parameter
from truepose.models.registry import Registry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Channel:
    """One residual component: 1-sigma noise (mm, rad), kind (position, rotation, distance) and the point
    whose 3-D norm it belongs to."""

    name: str
    unit: str
    sigma: float
    kind: str
    point: str


class Sensor(ABC):
    """An instrument. ``world`` is the 4x4 sensor-frame pose of the tool, ``s`` its parameters in order."""

    type: ClassVar[str]
    differs_from_row: ClassVar[bool] = False
    """Whether a reading is the change since the row that ``from`` names."""
    on_flange: bool = False
    """Whether the instrument is fixed to the flange, so that the tool frame must coincide with it."""

    @classmethod
    @abstractmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Sensor:
        """Read the section ``sensor`` of the machine file."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[Parameter, ...]:
        """Constants of the instrument."""

    @property
    @abstractmethod
    def columns(self) -> Mapping[str, str]:
        """Recording columns and their internal unit."""

    @property
    @abstractmethod
    def channels(self) -> tuple[Channel, ...]:
        """Residual components, in order."""

    @abstractmethod
    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """What the columns should read, (n_columns,)."""

    def residual(self, world: ca.SX, s: Mapping[str, ca.SX], reading: ca.SX) -> ca.SX:
        """Prediction less reading, one entry a channel; smooth where they agree."""
        return self.predict(world, s) - reading

    def values(self, world: Array, predicted: Array) -> Array:
        """(n, n_columns) column values from (n, 4, 4) poses; ``predicted`` comes from ``predict``."""
        return predicted

    def noisy(self, values: Array, rng: np.random.Generator) -> Array:
        """(n, n_columns) readings with the instrument's noise."""
        sigma = np.array([channel.sigma for channel in self.channels])
        return values + sigma * rng.standard_normal(values.shape)


sensors: Registry[type[Sensor]] = Registry("sensor type", "truepose.models.sensors")
