"""What a sensor is: columns, parameters, noise, and a residual as a function of the tool's pose.

To add one, write a file in ``truepose.models.sensors`` (or a plugin): a frozen dataclass whose class is registered with
``@sensors.add(type)`` and that builds itself from its section of the machine file.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import casadi as ca
import numpy as np
from pydantic import Field

from truepose.arrays import Array, Index
from truepose.errors import InputError
from truepose.models import lie
from truepose.models.file.fields import Section
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import AXES, Parameter
from truepose.models.registry import Registry
from truepose.wording import close_matches

WORLD: Final = "world"
TOOL: Final = "tool"


@dataclass(frozen=True)
class View:
    """The frame that a sensor reads, and the frame that its readings are in: both ``tool`` or a further frame of the file.

    ``frame`` may also be ``world``, the sensor's own.
    """

    tip: str = TOOL
    frame: str = WORLD

    @property
    def relative(self) -> bool:
        """Whether the machine, or another frame, carries the sensor."""
        return self.frame != WORLD


class ViewSection(Section):
    """The fields of a sensor that may read any frame, from any frame."""

    tip: str = TOOL
    """Frame that it reads: `tool`, or another of `frames`."""
    in_: str = Field(default=WORLD, alias="in")
    """Frame that its readings are in: `world`, or one of `frames` that carries it (a camera on a head, the other hand)."""

    def view(self, context: BuildContext) -> View:
        """Checked against the file's frames. Raises InputError naming the field."""
        known = (TOOL, *context.file.frames.further)
        for field, name, others in (("tip", self.tip, known), ("in", self.in_, (WORLD, *known))):
            if name not in others:
                raise InputError(
                    f"{context.where}.{field}: found {name!r}, expected {others[0]} or a frame that `frames` names; "
                    f"{close_matches(name, others)}"
                )
        if self.tip == self.in_:
            raise InputError(
                f"{context.where}.in: found {self.in_!r}, which is the tip that it reads, expected another frame"
            )
        return View(self.tip, self.in_)


TOOL_IN_WORLD: Final = View()
"""What every sensor has that states no other view."""


def prefix(name: str | None) -> str:
    """What opens the names of columns and parameters of a sensor that has a name."""
    return f"{name}." if name else ""


@dataclass(frozen=True)
class Channel:
    """One residual component: its 1-sigma noise (mm, rad), its kind, and the point whose 3-D norm it belongs to.

    Of kind ``position`` are x, y and z of a point, three channels; a single length is of kind ``distance``.
    """

    name: str
    unit: str
    sigma: float
    kind: str
    point: str


@dataclass(frozen=True)
class Rows:
    """What a reading that compares rows may know of them.

    origin (n,): the row that each row's ``from`` names; labels: text columns; weight (n,): how much each row
    counts in the fit, 0 where it is not fitted (a level that several rows share comes from those that are, where
    there are any); files: to name in messages.
    """

    origin: Index | None
    labels: Mapping[str, tuple[str, ...]]
    weight: Array
    files: tuple[str, ...] = ()


class Comparison(ABC):
    """How the predictions of several rows make one reading, with its derivative."""

    @property
    def unknowns(self) -> int:
        """Levels that the rows themselves determine: degrees of freedom that they cost."""
        return 0

    @abstractmethod
    def values(self, raw: Array) -> Array:
        """(n, m) what is compared with the readings, from (n, k) predictions of the single rows."""

    @abstractmethod
    def changes(self, raw: Array, change: Array) -> Array:
        """(n, m, w) derivative of ``values`` along (n, k, w) changes of the predictions."""


@dataclass(frozen=True)
class Difference(Comparison):
    """The prediction here less the one at the row of origin."""

    origin: Index

    def values(self, raw: Array) -> Array:
        """(n, k) change since the row of origin."""
        return raw - raw[self.origin]

    def changes(self, raw: Array, change: Array) -> Array:
        """(n, k, w): the difference is linear, and so its derivative is the same difference."""
        return change - change[self.origin]


class Sensor(ABC):
    """An instrument. ``world`` is the 4x4 sensor-frame pose of the tip that it reads, ``s`` its parameters in order.

    ``view`` says which tip that is, and what the sensor stands on; a sensor that states none reads the tool from the world.
    """

    type: ClassVar[str]
    view: View = TOOL_IN_WORLD
    parameters: tuple[Parameter, ...] = ()
    """Constants of the instrument; none where the tool frame says where its target is."""
    opens_columns: ClassVar[bool] = False
    """Whether the sensor's `name` opens those of its columns: `NAME.x`."""
    touches: ClassVar[bool] = False
    """Whether it touches what it measures, or sits on it: no light goes through the air."""
    takes_pictures: ClassVar[bool] = False
    """Whether a camera sees it, whose lens may distort."""
    differs_from_row: ClassVar[bool] = False
    """Whether a reading is the change since the row that ``from`` names."""
    label_columns: ClassVar[tuple[str, ...]] = ()
    """Text columns that the recording must have for this sensor."""
    optional_labels: ClassVar[tuple[str, ...]] = ()
    """Text columns that it reads where they are."""

    @property
    def joints(self) -> Mapping[str, str]:
        """Columns that read a joint itself: to what ``predict`` says of each, the joint's way from its zero is added, after all
        that effects do to it. By column, the joint's reading."""
        return {}

    @property
    def compares(self) -> bool:
        """Whether readings follow from several rows (see ``comparison``)."""
        return self.differs_from_row

    @property
    def compares_itself(self) -> bool:
        """True if rows are compared with each other and with no measured value, so that no length is measured."""
        return self.compares and not self.columns

    @property
    def measures_length(self) -> bool:
        """True if a reading, or a distance that is stated, tells how large the machine is."""
        return "mm" in self.columns.values()

    def cautions(self, labels: Mapping[str, tuple[str, ...]]) -> tuple[str, ...]:
        """What a user should know of how this sensor takes a recording with such text columns."""
        return ()

    @property
    def pointed(self) -> str:
        """Axis of the tool, x, y or z, whose direction is read; empty where none is."""
        return ""

    @property
    def reads(self) -> tuple[str, ...]:
        """Further parameters of the machine that ``predict`` reads: ``tool.x`` where it is fixed to the flange."""
        return ()

    def comparison(self, rows: Rows) -> Comparison | None:
        """How rows are compared; None where each reading depends on its own row alone."""
        return Difference(rows.origin) if self.differs_from_row and rows.origin is not None else None

    @classmethod
    @abstractmethod
    def build(cls, section: Mapping[str, Any], context: BuildContext) -> Sensor:
        """Read the section ``sensor`` of the machine file."""

    @property
    @abstractmethod
    def columns(self) -> Mapping[str, str]:
        """Recording columns and their internal unit."""

    @property
    def shiftable(self) -> tuple[str, ...]:
        """Columns that effects may add to (ports ``<column>.reading``): those that are lengths."""
        return tuple(name for name, unit in self.columns.items() if unit == "mm")

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
        """(n, n_columns) column values from (n, 4, 4) poses; ``predicted`` (n, n_columns) comes from ``predict``."""
        return predicted

    def noisy(self, values: Array, rng: np.random.Generator) -> Array:
        """(n, n_columns) readings: exact ``values`` (n, n_columns) with the instrument's noise."""
        sigma = np.array([channel.sigma for channel in self.channels])
        return values + sigma * rng.standard_normal(values.shape)


TOOL_POSE = tuple(f"tool.{axis}" for axis in AXES)


def flange_of(world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
    """Pose of the flange from that of the tool, for sensors that read the parameters of ``TOOL_POSE``."""
    return world @ lie.inverse(
        lie.rpy_transform([s[n] for n in TOOL_POSE[:3]], [s[n] for n in TOOL_POSE[3:]])
    )


sensors: Registry[type[Sensor]] = Registry("sensor type", "truepose.models.sensors", Sensor)
