"""What a run over a fleet says, as data: everything that fleet.json and the page are written from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from truepose.identification.leaves.fleet.changes import Changes
from truepose.identification.leaves.fleet.statistics import FleetStatistics
from truepose.identification.leaves.fleet.table import Row

SHOWN = 500
"""Rows that a page shows; the table has all. A browser sorts so many without delay."""


@dataclass(frozen=True)
class Fleet:
    """The whole outcome.

    name: of its folder; statuses, verdicts: how many machines of each; unusual: odd machines, oddest first; undone: those
    without a diagnosis; rows: the first machines by name, ``SHOWN`` of each kind at most; changes: since the last run that
    ended, None for the first; brief: machines have no reports of their own.
    """

    name: str
    machines: int
    statuses: Mapping[str, int]
    verdicts: Mapping[str, int]
    statistics: FleetStatistics
    odd: int
    unusual: Sequence[Row]
    undone: Sequence[Row]
    rows: Sequence[Row]
    changes: Changes | None
    brief: bool = False

    @property
    def diagnosed(self) -> int:
        """Machines with a diagnosis."""
        return self.statuses.get("done", 0) + self.statuses.get("refused", 0)
