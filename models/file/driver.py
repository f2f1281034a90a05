"""Drivers: what a recording may log beside the joints, and what effects and plans may read of it.

A name is ``kind.place``, with numbers where it remembers: ``payload``, ``temperature.leg1``, ``temperature.leg1~300``
(the same through a first-order lag of 300 s), ``stop.q2~0.01``, ``session.after.2``. Here alone names are taken apart.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from typing import Final, Literal

from truepose.models.units import compatible

SESSION, TIME, TEMPERATURE, VELOCITY, APPROACH = "session", "time", "temperature", "velocity", "approach"
PAYLOAD = "payload"
RECORDING = "recording"
"""``recording.NAME``: 1 in the rows of recordings that the machine file calls so, 0 in others."""
ROW = "row"
"""Place in the order of acquisition, where no clock was recorded: 0 at the end of the longest session, rows before it below."""
TORQUE, CURRENT, FORCE, MOMENT, PRESSURE = "torque", "current", "force", "moment", "pressure"
MEASURED_LOADS = (TORQUE, CURRENT)
"""Kinds of what a joint's drive says of the load that it holds."""
HELD = (PAYLOAD, TEMPERATURE, VELOCITY, PRESSURE, "humidity")
"""Kinds that can be held at a value while one measures."""
STEP = "step"
"""A joint's last motion, which no column holds: the order of the rows tells it."""
AIR = f"{TEMPERATURE}.air"
DriverKind = Literal[
    "load",
    "position-periodic",
    "position",
    "arrival",
    "temperature",
    "time",
    "session",
    "coupling",
    "sensor",
    "constant",
]
"""What makes an error vary: the weight carried, the part's own position (periodic or smooth), the side that it arrived from,
heat, time, the session, another joint, what the sensor reads; ``constant``: nothing."""
OF_THE_ORDER = (APPROACH, STEP)
"""Kinds that the order of the rows tells where no column does."""
TREMBLING: Final = 1e-3
"""Share of a joint's travel (in the recording, or in the controller's program) within which it trembles or is held: not a
motion.

Play is smaller (0.5 to 2 arcmin are 1e-4 to 4e-4 of a travel of 90 deg), so that all longer motions take it up, and encoders
of joints that are held scatter less.
"""
HEAT = "heat"
"""``heat.J~s``: what is left of the way of joint J where what it warms cools with a time constant of s seconds."""
OF_THE_WAY = ("stop", "loop")
"""Kinds of what a joint's way leaves behind (``truepose.identification.recording.recording``)."""
OF_THE_CLOCK = ("creep", HEAT)
"""Kinds of what a joint's way leaves behind for some time."""
_NUMBER = r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?"
_NAME: Final = re.compile(
    rf"(?P<kind>[^.]+?)(?:\.(?P<place>.+?))?(?P<numbers>(?:~{_NUMBER})*)", flags=re.DOTALL
)
_AFTER: Final = re.compile(r"after\.(\d+)")
_KINDS: Final[Mapping[str, tuple[str, float]]] = {
    SESSION: ("1", 1.0),
    RECORDING: ("1", 0.0),
    TIME: ("s", 0.0),
    ROW: ("1", 0.0),
    PRESSURE: ("hPa", 1013.25),
    "humidity": ("%", 50.0),
    TEMPERATURE: ("degC", 20.0),
    PAYLOAD: ("kg", 0.0),
    VELOCITY: ("{reading}/s", 0.0),
    TORQUE: ("N*m", 0.0),
    CURRENT: ("A", 0.0),
    FORCE: ("N", 0.0),
    MOMENT: ("N*m", 0.0),
    APPROACH: ("1", 0.0),
    STEP: ("{reading}", 0.0),
    "stop": ("{reading}", 0.0),
    "loop": ("{reading}", 0.0),
    "creep": ("{reading}", 0.0),
    HEAT: ("{reading}", 0.0),
}
"""Unit, in terms of the joint's reading where there is one, and value where nothing is recorded."""
_AIRS: Final = (PRESSURE, "humidity")
_BY_DIMENSION: Final[Mapping[str, DriverKind]] = {
    **dict.fromkeys(("N", "N*m", "kg", "A", "hPa"), "load"),
    **dict.fromkeys(("degC", "W"), "temperature"),
    "s": "time",
}
"""What a column makes vary, by what its unit is of; a motor's current and a cylinder's pressure hold loads, power heats."""
_DRIVES: Final[Mapping[str, DriverKind]] = {
    **dict.fromkeys((SESSION, RECORDING), "session"),
    **dict.fromkeys((TIME, ROW, "creep"), "time"),
    **dict.fromkeys((TEMPERATURE, HEAT), "temperature"),
    **dict.fromkeys((PAYLOAD, TORQUE, CURRENT, FORCE, MOMENT), "load"),
    **dict.fromkeys((VELOCITY, APPROACH, STEP, "stop", "loop"), "arrival"),
}


@dataclass(frozen=True)
class Driver:
    """One driver. place: the part, joint or mount that it is of; numbers: what a driver that remembers is told."""

    kind: str
    place: str = ""
    numbers: tuple[float, ...] = ()

    @classmethod
    def of(cls, name: str) -> Driver:
        """The driver of this name, given by a column, an effect or a user; any text names a driver of some kind."""
        found = _NAME.fullmatch(name)
        if found is None:
            return cls(name)
        numbers = tuple(float(text) for text in found["numbers"].split("~")[1:])
        return cls(found["kind"], found["place"] or "", numbers)

    @property
    def name(self) -> str:
        """What it is called in files."""
        own = f"{self.kind}.{self.place}" if self.place else self.kind
        return own + "".join("~" + repr(number).removesuffix(".0") for number in self.numbers)

    @property
    def now(self) -> Driver:
        """The same without memory: what it would be if it followed at once."""
        return replace(self, numbers=())

    @property
    def column(self) -> str:
        """The column to record for it: ``time`` for creep and heat, the joint for what its way tells, else its own name."""
        if self.kind == STEP:
            return self.place
        if self.numbers and self.kind in (*OF_THE_WAY, *OF_THE_CLOCK):
            return TIME if self.kind in OF_THE_CLOCK else self.place
        return self.now.name

    @property
    def drives(self) -> DriverKind | None:
        """In which way it makes an error vary; None where nobody knows."""
        return _DRIVES.get(self.kind)

    @property
    def after(self) -> int | None:
        """K of ``session.after.K``, which is 1 from the K-th change of session on; None for all others."""
        found = _AFTER.fullmatch(self.place) if self.kind == SESSION else None
        return int(found[1]) if found else None

    @property
    def default(self) -> float:
        """Its value where nothing is recorded: 20 degC, 1013.25 hPa, 50 %, the latest session, no motion, no load."""
        return 0.0 if self.kind in _AIRS and self.place else _KINDS.get(self.kind, ("", 0.0))[1]

    def unit(self, joints: Mapping[str, str]) -> str:
        """Its unit, where readings of joints are in those of ``joints``; empty where nobody knows."""
        unit = _KINDS.get(self.kind, ("", 0.0))[0]
        if self.kind == TORQUE and compatible(joints.get(self.place, ""), "mm"):
            return "N"  # what a slide's drive holds is a force
        if "{" not in unit:
            return unit
        return unit.format(reading=joints[self.place]) if self.place in joints else ""

    def served_by(self, known: Container[str]) -> str:
        """The column that stands for it: its own where it is ``known``, else that of the air for any temperature."""
        return AIR if self.thermal and self.name not in known else self.name

    @property
    def thermal(self) -> bool:
        """Whether it is the temperature of a place."""
        return self.kind == TEMPERATURE and bool(self.place)

    @property
    def smooth(self) -> bool:
        """Whether any part may err as a smooth function of it: of weight, time (or the order of rows), heat, and what else was
        declared.

        Not of the way that a joint came, which jumps, nor of air's pressure, which acts on sensors alone, nor of what a joint's
        drive holds, which bends that joint.
        """
        if self.kind in (PAYLOAD, TIME, ROW):
            return not self.place
        if self.kind in (TEMPERATURE, *_AIRS):
            return bool(self.place)
        return self.kind in (FORCE, MOMENT) or self.kind not in _KINDS


@dataclass(frozen=True)
class DeclaredDriver:
    """A column that the machine file declares, or that a user tries.

    unit: inside the program, empty where nobody knows; written: of columns without a unit in their header; drives: in which way
    it makes an error vary; tried: whether it stands for this run only; absent: what holds in a file that has no such column,
    where anybody knows; column: its header, where that is another; everywhere: whether it drives more than its own joint.
    """

    name: str
    unit: str
    written: str
    drives: DriverKind
    tried: bool = False
    absent: float | None = None
    column: str = ""
    everywhere: bool = False


def is_known_driver(name: str) -> bool:
    """Return True if a column of this name logs a known driver: one of the whole row, or one of a part, `KIND.PART`."""
    driver = Driver.of(name)
    return driver.kind in (_KINDS if driver.place else (SESSION, TIME, ROW, PAYLOAD, *_AIRS))


def driven_by_unit(unit: str) -> DriverKind:
    """What a column of this unit makes vary: ``load``, ``temperature`` or ``time``, else ``coupling`` with another thing."""
    found = (kind for like, kind in _BY_DIMENSION.items() if compatible(unit, like))
    return next(found, "coupling")
