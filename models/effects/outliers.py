"""Readings that are not readings of this machine: catalogued here, found by the diagnosis itself."""

from __future__ import annotations

from truepose.models.effects.base import Place, Settings, effects
from truepose.models.effects.common import OfRows
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS


@effects.add("outliers")
class Outliers(OfRows):
    """Rows, not a place of the machine: it shifts no port, and the robust fit finds it."""

    slug = "outliers"
    setting_ranges = NO_SETTINGS
    title = "Outlying rows"
    formula = "none: single rows far outside the sensor's noise, left out of the fit and listed"
    size = "many sigma in a few rows"
    look_alikes = ("fringe-miscount", "backlash", "zero-shift")
    experiment = "measure the listed rows again"
    source = "a broken line of sight, a swapped target, a robot still moving; no physics of the machine"

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"Rows {', '.join(place)} lie far outside the noise of the others and were left out."
