"""What an effect's file imports; contracts: ``truepose.models.machine.effect`` and ``truepose.models.machine.placed``."""

from truepose.models.file.driver import DriverKind
from truepose.models.machine.effect import Site, effects
from truepose.models.machine.placed import (
    NO_SETTINGS,
    SERIES,
    Coefficient,
    Effect,
    Observed,
    Place,
    PlacedEffect,
    Settings,
    Shifts,
)

__all__ = [
    "NO_SETTINGS",
    "SERIES",
    "Coefficient",
    "DriverKind",
    "Effect",
    "Observed",
    "Place",
    "PlacedEffect",
    "Settings",
    "Shifts",
    "Site",
    "effects",
]
