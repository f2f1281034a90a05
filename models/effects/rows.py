"""Single rows that are no readings of the machine: catalogued here, found by the diagnosis itself."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site, bundle
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


@bundle("outliers")
class Outliers(OfRows):
    """Readings that are not readings of this machine: catalogued here, found by the diagnosis itself.

    Rows, not a place of the machine: it shifts no port, and the robust fit finds it.
    """


@bundle("fringe-miscount")
class FringeMiscount(OfRows):
    """Fringes that an interferometer lost or counted twice: catalogued here, found among the outlying rows.

    Rows, not a place of the machine: it shifts no port. ``identification.diagnosis.outliers`` finds it.
    """
