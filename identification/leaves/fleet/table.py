"""The table of a fleet, ``fleet.csv``, and what a run says as data: all that fleet.json and the page are written from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from truepose.identification.leaves.fleet.changes import Changes
from truepose.identification.leaves.fleet.odd import Oddness
from truepose.identification.leaves.fleet.record import Record
from truepose.identification.leaves.fleet.statistics import FleetStatistics

SHOWN = 500
"""Rows that a page shows; the table has all. A browser sorts so many without delay."""
COLUMNS = [
    "name", "status", "why", "machine", "check", "verdict", "concealed", "chi2_before", "chi2_after", "reading",
    "rms_before", "rms_after", "unit", "held_out", "ratio", "noise", "findings", "remainder", "odd", "oddness",
    "odd_because",
]  # fmt: skip
"""machine: the name in its file; reading: the kind that rms is of (the first of its sensor), in ``unit``; held_out: whether on
rows that were not fitted; ratio: of rms after over before on rows held out in turn; noise: in stated sigmas; remainder: the
driver of what is left; oddness: minus log10 of how probable anything as unusual is in this fleet."""


@dataclass(frozen=True)
class Fleet:
    """The whole outcome.

    name: of its folder; table: a row a machine, None where a cell is empty; changes: since the last run that ended, None for
    the first; brief: machines have no reports of their own.
    """

    name: str
    table: pd.DataFrame
    statistics: FleetStatistics
    changes: Changes | None
    brief: bool = False

    @property
    def diagnosed(self) -> int:
        """Machines with a diagnosis."""
        return int(self.table["status"].isin(["done", "refused"]).sum())

    @property
    def odd(self) -> pd.DataFrame:
        """Odd machines, the oddest first."""
        odd = self.table[self.table["odd"].eq(True)]
        return odd.assign(score=-odd["oddness"].astype(float)).sort_values(["score", "name"])

    @property
    def undone(self) -> pd.DataFrame:
        """Machines without a diagnosis."""
        return self.table[~self.table["status"].isin(["done", "refused"])]

    def count(self, column: str) -> dict[str, int]:
        """Return how many machines there are of each status or verdict, by name."""
        counts = self.table[column].value_counts()
        return {str(name): int(count) for name, count in sorted(counts.items())}


def counts(record: Record) -> bool:
    """Whether statistics have a machine: one that is no calibration would say of parts what is not so."""
    return record.status == "done"


def fleet_table(records: Sequence[Record], odd: Sequence[Oddness]) -> pd.DataFrame:
    """Return a row a machine; ``odd``: of those that count, in their order."""
    left = iter(odd)
    rows = [
        {"name": one.name, "status": one.status, "why": one.why, **one.figures}
        | (_oddness(next(left)) if counts(one) else {})
        for one in records
    ]
    table = pd.DataFrame(rows, columns=COLUMNS, dtype=object)
    return table.where(table.notna(), None)


def _oddness(one: Oddness) -> dict[str, Any]:
    because = "; ".join(reason.text for reason in one.reasons)
    return {"odd": one.odd, "oddness": round(one.score, 3), "odd_because": because}
