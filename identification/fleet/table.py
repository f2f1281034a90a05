"""The table of a fleet, ``fleet.csv``: a row a machine."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from typing import Any

import pandas as pd

from truepose.identification.fleet.changes import findings_text
from truepose.identification.fleet.odd import Oddness
from truepose.identification.fleet.record import Record


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


def row(record: Record, odd: Oddness | None) -> Row:
    """The row of a record, with its oddness where its fleet says something of it."""
    if not record.diagnosed:
        return Row(record.name, record.status, record.why)
    told = record.figures
    every: Mapping[str, Mapping[str, Any]] = told["rms"]
    kind = next(iter(every), "")
    rms = every.get(kind, {})
    unusual: dict[str, Any] = {}
    if odd is not None:
        because = "; ".join(reason.text for reason in odd.reasons)
        unusual = {"odd": odd.odd, "oddness": round(odd.score, 3), "odd_because": because}
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
        **unusual,
    )


def table(rows: Iterable[Row]) -> pd.DataFrame:
    """One row a machine; cells of a machine without a diagnosis are empty."""
    return pd.DataFrame([asdict(one) for one in rows], columns=[field.name for field in fields(Row)])


__all__ = ["Row", "row", "table"]
