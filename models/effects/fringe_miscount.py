"""Fringes that an interferometer lost or counted twice: catalogued here, found among the outlying rows."""

from __future__ import annotations

from truepose.models.effects.base import Place, Settings, effects
from truepose.models.effects.common import OfRows
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import NO_SETTINGS


@effects.add("fringe-miscount")
class FringeMiscount(OfRows):
    """Rows, not a place of the machine: it shifts no port. ``identification.diagnosis.outliers`` finds it."""

    slug = "fringe-miscount"
    setting_ranges = NO_SETTINGS
    title = "Miscounted fringes"
    formula = "reading + k lambda / 2 in single rows, k a whole number"
    size = "half a wavelength, or a few"
    look_alikes = ("outliers", "sensor-periodic", "zero-shift")
    experiment = "go back to the row's start without a break: a lost fringe is missing on the closed way"
    source = "a fringe of a two-way interferometer is half a wavelength; a beam broken or moved too fast loses some"

    def explain(self, machine: Machine, place: Place, settings: Settings) -> str:
        return f"Rows {', '.join(place)} are off by whole half wavelengths and were left out."
