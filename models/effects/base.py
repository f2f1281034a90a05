"""What an effect's file imports: the contract is in ``truepose.models.effect`` and ``truepose.models.placed``."""

from truepose.models.driver import DriverKind
from truepose.models.effect import Effect, Site, effects
from truepose.models.placed import SERIES, Coefficient, Observed, Place, PlacedEffect, Settings, Shifts

__all__ = [
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
