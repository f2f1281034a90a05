"""Effects on single rows of a recording: no place of the machine, no formula; the diagnosis finds them itself."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import Coefficient, Effect, Place, Settings, Shifts, Site
from truepose.models.machine.machine import Machine

OF_ROWS = ("outliers", "fringe-miscount")
"""Their slugs: findings of these alone say nothing against the model."""


class OfRows(Effect):
    """Shifts no port; its place in a finding is the numbers of the rows."""

    driven_by = "sensor"

    def places(self, machine: Machine) -> Sequence[Place]:
        return ()

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        return ()

    def shifts(self, site: Site) -> Shifts:
        return {}
