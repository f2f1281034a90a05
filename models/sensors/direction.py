"""A direction without a length: a star, an autocollimator, a theodolite; two angles or a unit vector."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np
from pydantic import model_validator

from truepose.arrays import Array
from truepose.models import lie
from truepose.models.file.fields import (
    AngleSigma,
    AngleToleranceVector,
    AngleVector,
    LengthToleranceVector,
    LengthVector,
    Section,
    bad_value,
)
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Parameter
from truepose.models.machine.sensor import Channel, Sensor, sensors

ORIGIN = "origin"
_NOWHERE = (0.0, 0.0, 0.0)
_AT_POLE = 1e-30
"""Square of a distance from the pole below which the first angle is whatever it is."""


class _Sigma(Section):
    angle: AngleSigma
    """1-sigma across the line of sight, each of the two ways."""


class _StationTolerance(Section):
    xyz: LengthToleranceVector = _NOWHERE
    """1-sigma of its place."""
    rpy: AngleToleranceVector = _NOWHERE
    """1-sigma of roll, pitch and yaw: of an instrument that was levelled the yaw alone is unknown."""


class _Station(Section):
    xyz: LengthVector = _NOWHERE
    """Where the instrument stands in the sensor's frame."""
    rpy: AngleVector = _NOWHERE
    """How it is turned: Rz(yaw) Ry(pitch) Rx(roll)."""
    tolerance: _StationTolerance = _StationTolerance()
    """How well that is known; left out: exactly."""


class _DirectionSection(Section):
    type: Literal["direction"]
    """A direction, without a length: columns `azimuth elevation`, or `ux uy uz`."""
    of: Literal["x", "y", "z", "origin"] = "x"
    """What is seen: an axis of the tool frame (star, autocollimator), or the tool frame's `origin` (theodolite)."""
    columns: Literal["angles", "vector"] = "angles"
    """Two `angles`, the first in the xy plane from x, the second from there towards z; or a unit `vector`, `ux uy uz`."""
    angles: tuple[str, str] = ("azimuth", "elevation")
    """Names of the two angles' columns."""
    turn: Literal["clockwise", "counterclockwise"] = "clockwise"
    """Which way the first angle grows, seen from +z: circles of theodolites, azimuths and hour angles grow `clockwise`."""
    name: str | None = None
    """Tells several apart: its columns are then `NAME.azimuth` ..., its parameters `NAME.station.x` ..."""
    station: _Station | None = None
    """The instrument's own frame, where it is not the sensor's."""
    sigma: _Sigma
    """How noisy a reading is; replicates tell whether it is right."""

    @model_validator(mode="after")
    def _two_names(self) -> _DirectionSection:
        if self.angles[0] == self.angles[1] or not all(self.angles):
            raise bad_value("angles: two names that differ", list(self.angles))
        return self


@sensors.add("direction")
@dataclass(frozen=True)
class Direction(Sensor):
    """A direction as two angles or as a unit vector; the residual is the two small angles across the line of sight, rad.

    ``of``: the axis of the tool frame that points there, or its origin, seen from the station. ``sense`` is -1 where
    the first angle grows clockwise. ``parameters``: the six parameters of the station, none where it is the sensor's frame.
    """

    of: str
    as_vector: bool
    names: tuple[str, ...]
    sense: float
    sigma: float
    parameters: tuple[Parameter, ...] = ()
    type = "direction"
    opens_columns = True

    @classmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Direction:
        """From ``of``, ``columns``, ``angles``, ``turn``, ``station``, ``sigma: {angle}`` and an optional ``name``."""
        parsed = context.parse(_DirectionSection, section)
        prefix = f"{parsed.name}." if parsed.name else ""
        as_vector = parsed.columns == "vector"
        names = ("ux", "uy", "uz") if as_vector else parsed.angles
        sense = -1.0 if parsed.turn == "clockwise" else 1.0
        own = _station(parsed.station, prefix, context) if parsed.station else ()
        return cls(parsed.of, as_vector, tuple(f"{prefix}{n}" for n in names), sense, parsed.sigma.angle, own)

    @property
    def pointed(self) -> str:
        """The axis that points, if it is one."""
        return "" if self.of == ORIGIN else self.of

    @property
    def columns(self) -> Mapping[str, str]:
        """Two angles, rad, or three components of a unit vector."""
        return dict.fromkeys(self.names, "1" if self.as_vector else "rad")

    @property
    def shiftable(self) -> tuple[str, ...]:
        """All of them: a small shift of a direction is one of its columns."""
        return self.names

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Two small angles: across, towards a larger first angle, and up, towards a larger second one."""
        names = [f"{self.names[0]}.{way}" for way in ("across", "up")] if self.as_vector else self.names
        return tuple(Channel(name, "rad", self.sigma, "direction", self.names[0]) for name in names)

    def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """The columns as they should read; the first angle from -180 to 180 deg."""
        return self.told(self.seen(world, s))

    def seen(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
        """(3,) unit vector of what is seen, in the station's frame."""
        at = [s[parameter.name] for parameter in self.parameters]
        if self.of == ORIGIN:
            along = world[:3, 3] - (ca.vertcat(*at[:3]) if at else 0)
            along = along / ca.norm_2(along)
        else:
            along = world[:3, "xyz".index(self.of)]
        return lie.rpy_transform(at[:3], at[3:])[:3, :3].T @ along if at else along

    def told(self, along: ca.SX) -> ca.SX:
        """The columns of a unit vector (3,)."""
        if self.as_vector:
            return along
        x, y, z = ca.vertsplit(along)
        return ca.vertcat(ca.atan2(self.sense * y, x), ca.atan2(z, ca.sqrt(x**2 + y**2 + _AT_POLE)))

    def meant(self, columns: ca.SX) -> ca.SX:
        """(3,) unit vector that columns say."""
        if self.as_vector:
            return columns / ca.sqrt(ca.sumsqr(columns) + _AT_POLE)
        turn, lift = self.sense * columns[0], columns[1]
        return ca.vertcat(ca.cos(lift) * ca.cos(turn), ca.cos(lift) * ca.sin(turn), ca.sin(lift))

    def residual(self, world: ca.SX, s: Mapping[str, ca.SX], reading: ca.SX) -> ca.SX:
        """The predicted direction from the one read: its angle, and which way, along across and up."""
        measured, seen = self.meant(reading), self.seen(world, s)
        x, y, z = ca.vertsplit(measured)
        turn = ca.atan2(y, x) if self.as_vector else self.sense * reading[0]
        aside = ca.sqrt(x**2 + y**2 + _AT_POLE) if self.as_vector else ca.cos(reading[1])
        across = self.sense * ca.vertcat(-ca.sin(turn), ca.cos(turn), 0)
        up = ca.vertcat(-z * ca.cos(turn), -z * ca.sin(turn), aside)
        off = ca.vertcat(ca.dot(across, seen), ca.dot(up, seen))
        size = ca.sqrt(ca.sumsqr(off) + _AT_POLE)
        return off * ca.atan2(size, ca.dot(measured, seen)) / size

    def noisy(self, values: Array, rng: np.random.Generator) -> Array:
        """(n, k) readings whose direction is turned by the noise."""
        turned = self.vectors(values) + self.sigma * rng.standard_normal((len(values), 3))
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        if self.as_vector:
            return np.asarray(turned)
        x, y, z = turned.T
        return np.column_stack([np.arctan2(self.sense * y, x), np.arctan2(z, np.hypot(x, y))])

    def vectors(self, values: Array) -> Array:
        """(n, 3) unit vectors that rows of columns (n, k) say."""
        if self.as_vector:
            return np.asarray(values / np.linalg.norm(values, axis=1, keepdims=True))
        turn, lift = self.sense * values[:, 0], values[:, 1]
        return np.column_stack([np.cos(lift) * np.cos(turn), np.cos(lift) * np.sin(turn), np.sin(lift)])


def _station(station: _Station, prefix: str, context: BuildContext) -> tuple[Parameter, ...]:
    values = (*station.xyz, *station.rpy)
    known = (*station.tolerance.xyz, *station.tolerance.rpy)
    return context.vector(f"{prefix}station", values, ("station",), "sensor", known)
