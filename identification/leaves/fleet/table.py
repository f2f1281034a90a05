"""The table of a fleet, ``fleet.csv``: a row a machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import pandas as pd

from truepose.files import atomic_file
from truepose.identification.leaves.fleet.changes import findings_text
from truepose.identification.leaves.fleet.odd import Oddness
from truepose.identification.leaves.fleet.record import Record


@dataclass(frozen=True)
class Row:
    """A machine in the table.

    machine: the name in its file; reading: the kind that rms is of (the first of its sensor), in ``unit``; held_out: whether on
    rows that were not fitted; ratio: of rms after over before on rows held out in turn; noise: in stated sigmas; remainder:
    the driver of what is left; oddness: minus log10 of how probable anything as unusual is in this fleet.
    """

    name: str
    status: str
    why: str = ""
    machine: str = ""
    check: str = ""
    verdict: str = ""
    concealed: bool | None = None
    chi2_before: float | None = None
    chi2_after: float | None = None
    reading: str = ""
    rms_before: float | None = None
    rms_after: float | None = None
    unit: str = ""
    held_out: bool | None = None
    ratio: float | None = None
    noise: float | None = None
    findings: str = ""
    remainder: str = ""
    odd: bool | None = None
    oddness: float | None = None
    odd_because: str = ""

    def with_oddness(self, odd: Oddness) -> Row:
        """With how unlike its fleet the machine is."""
        because = "; ".join(reason.text for reason in odd.reasons)
        return replace(self, odd=odd.odd, oddness=round(odd.score, 3), odd_because=because)


def row(record: Record) -> Row:
    """The row of a record, of whose oddness nothing is known yet."""
    if not record.diagnosed:
        return Row(record.name, record.status, record.why)
    told = record.figures
    every: Mapping[str, Mapping[str, Any]] = told["rms"]
    kind = next(iter(every), "")
    rms = every.get(kind, {})
    return Row(
        record.name,
        record.status,
        record.why,
        machine=told["machine"],
        check=told["check"],
        verdict=told["verdict"],
        concealed=told["concealed"],
        chi2_before=told["chi2"][0],
        chi2_after=told["chi2"][1],
        reading=kind,
        rms_before=rms.get("before"),
        rms_after=rms.get("after"),
        unit=rms.get("unit", ""),
        held_out=rms.get("held_out"),
        ratio=told["ratio"],
        noise=told["noise"],
        findings=findings_text(record),
        remainder=told["remainder"] or "",
    )


def table(rows: Iterable[Row]) -> pd.DataFrame:
    """One row a machine; cells of a machine without a diagnosis are empty."""
    return pd.DataFrame([vars(one) for one in rows], columns=[field.name for field in fields(Row)])


def write_rows(path: Path, groups: Iterable[Sequence[Row]]) -> None:
    """The table as CSV, whole or not at all; only a group of rows is held in memory."""
    with atomic_file(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as stream:
        table(()).to_csv(stream, index=False, lineterminator="\n")
        for rows in groups:
            table(rows).to_csv(stream, index=False, lineterminator="\n", header=False)
