"""Single rows that are no readings of the machine: catalogued here, found by the diagnosis itself."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import (
    NO_SETTINGS,
    Coefficient,
    Effect,
    Place,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.machine.machine import Machine


class OfRows(Effect):
    """Shifts no port; its place in a finding is the numbers of the rows."""

    driven_by = "sensor"

    def places(self, machine: Machine) -> Sequence[Place]:
        return ()

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return ()

    def shifts(self, site: Site) -> Shifts:
        return {}


@effects.add("outliers")
class Outliers(OfRows):
    """Readings that are not readings of this machine: catalogued here, found by the diagnosis itself.

    Rows, not a place of the machine: it shifts no port, and the robust fit finds it.
    """

    slug = "outliers"
    setting_ranges = NO_SETTINGS
    title = "Outlying rows"
    sentence = "Rows {all} lie far outside the noise of the others and were left out."
    formula = "none: single rows far outside the sensor's noise, left out of the fit and listed"
    size = "many sigma in a few rows"
    look_alikes = ("fringe-miscount", "backlash", "zero-shift")
    experiment = "measure the listed rows again"
    source = "a broken line of sight, a swapped target, a robot still moving; no physics of the machine"


@effects.add("fringe-miscount")
class FringeMiscount(OfRows):
    """Fringes that an interferometer lost or counted twice: catalogued here, found among the outlying rows.

    Rows, not a place of the machine: it shifts no port. ``identification.diagnosis.outliers`` finds it.
    """

    slug = "fringe-miscount"
    setting_ranges = NO_SETTINGS
    title = "Miscounted fringes"
    sentence = "Rows {all} are off by whole half wavelengths and were left out."
    formula = "reading + k lambda / 2 in single rows, k a whole number"
    size = "half a wavelength, or a few"
    look_alikes = ("outliers", "sensor-periodic", "zero-shift")
    experiment = "go back to the row's start without a break: a lost fringe is missing on the closed way"
    source = "a fringe of a two-way interferometer is half a wavelength; a beam broken or moved too fast loses some"
