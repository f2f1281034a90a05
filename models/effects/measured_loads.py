"""What a joint's drive says of the load that it holds: its measured torque (a slide's force) or its motor's current.

A column may be the load that pulls at the joint or what the drive holds against it: settings say which, ``torque`` or
``current`` being 1 or -1, and the evidence decides.
"""

from __future__ import annotations

from truepose.models.effects.base import Coefficient, Observed, Settings
from truepose.models.file.driver import CURRENT, MEASURED_LOADS, Driver
from truepose.models.machine.machine import Machine

PER_AMPERE = 10.0
"""N m (N) that an ampere of a geared motor holds, to a power of ten. Chosen."""


def is_measured(machine: Machine, reading: str) -> bool:
    """Whether the machine has a column of the load at a joint."""
    return any(Driver(kind, reading).name in machine.drivers for kind in MEASURED_LOADS)


def measured_settings(machine: Machine, reading: str, recording: Observed) -> list[Settings]:
    """Either sign of each column that was recorded."""
    kinds = [
        kind
        for kind in MEASURED_LOADS
        for name in (Driver(kind, reading).name,)
        if name in machine.drivers and recording.driver(name) is not None
    ]
    return [{kind: sign} for kind in kinds for sign in (1.0, -1.0)]


def measured_kind(settings: Settings) -> str | None:
    """``torque`` or ``current`` where settings read one of them."""
    return next((kind for kind in MEASURED_LOADS if kind in settings), None)


def measured_driver(settings: Settings, reading: str) -> str | None:
    """The column that they read."""
    kind = measured_kind(settings)
    return None if kind is None else Driver(kind, reading).name


def measured_coefficient(
    machine: Machine, settings: Settings, reading: str, unit: str, scale: float
) -> Coefficient:
    """The compliance in ``unit`` (mm or rad) by the column's; ``scale``: for a newton (metre)."""
    driver = measured_driver(settings, reading) or ""
    per = machine.driver_unit(driver)
    size = scale * (PER_AMPERE if measured_kind(settings) == CURRENT else 1.0)
    return Coefficient("c", f"{unit}/({per})" if "*" in per else f"{unit}/{per}", scale=size, lower=0.0)


def measured_words(settings: Settings, reading: str) -> str:
    """Which column, and what its sign means."""
    sign = settings[measured_kind(settings) or ""]
    meant = "the load that pulls at it" if sign > 0 else "what the drive holds against the load"
    return f"{measured_driver(settings, reading)}, which by its sign is {meant}"


__all__ = [
    "is_measured",
    "measured_coefficient",
    "measured_driver",
    "measured_kind",
    "measured_settings",
    "measured_words",
]
