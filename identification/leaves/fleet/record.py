"""What is kept of a machine: one record of a few kB, from which the table, the page and the prior are made.

``status`` says how far it came, ``why`` what stood in its way:

* ``done``: calibrated and diagnosed;
* ``refused``: the same, but its fit may not be called a calibration;
* ``wrong``: its files do not belong together, as ``truepose check`` says;
* ``failed``: bad input, or a fit without a minimum;
* ``broken``: its process died or met a fault of the program. It is tried again with the next run.

What changed in a fleet since its last run: machines new and gone, verdicts, names, parameters that moved.

A parameter has moved where the difference of its two values is more than chance allows: beyond ``FALSE`` for one such among
all that were compared, whatever their number.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field
from scipy.stats import norm

from truepose.files import atomic_write_text

Json = dict[str, Any]
Status = Literal["done", "refused", "wrong", "failed", "broken"]
SCHEMA: Final = "truepose/fleet-record/2"
RECORDS = "records.jsonl"
"""File with a record a line."""
DIGITS = 6
"""Significant digits of figures: more than a table shows."""
FINE = 1e-3
"""Parameters are kept to this part of their 1-sigma."""


class Record(BaseModel):
    """One machine.

    key: of its inputs (``Member.key``); figures: cells of its row in the table, empty unless it was diagnosed; parameters:
    value and 1-sigma (mm, rad) of each that its readings show; evidence: what the fleet's statistics are made of.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_: Literal["truepose/fleet-record/2"] = SCHEMA
    name: str
    key: str
    status: Status
    why: str = ""
    figures: Json = Field(default_factory=dict)
    parameters: dict[str, tuple[float, float]] = Field(default_factory=dict)
    evidence: Json = Field(default_factory=dict)

    @property
    def is_diagnosed(self) -> bool:
        """Whether there is a diagnosis."""
        return self.status in ("done", "refused")


def read_records(file: Path) -> dict[str, Record]:
    """Return the records of a file by name; none where it is missing, is not whole or is of another version."""
    try:
        lines = file.read_text(encoding="utf-8").split("\n")
        records = [Record.model_validate_json(line) for line in lines if line]
    except (OSError, ValueError):
        return {}
    return {record.name: record for record in records}


def write_records(file: Path, records: Iterable[Record]) -> None:
    """Write records, a line each; the same records, the same bytes."""
    atomic_write_text(file, "".join(f"{record.model_dump_json()}\n" for record in records))


def figures_of(diagnosis: Mapping[str, Any], check: str) -> Json:
    """Return a machine's cells of the table, from the content of a ``diagnosis.json`` and the verdict of the ``check``.

    Of the kinds of reading the first has its rms told: of held-out rows where there are some, else of the fitted ones.
    """
    before, after, proof = diagnosis["fit"]["before"], diagnosis["fit"]["after"], diagnosis["proof"]
    is_held_out = bool(before["validation_rms"] and after["validation_rms"])
    which = "validation_rms" if is_held_out else "rms"
    reading = next((kind for kind in after[which] if kind in before[which]), "")
    rms = {}
    if reading:
        rms = {
            "rms_before": rounded(before[which][reading]["value"]),
            "rms_after": rounded(after[which][reading]["value"]),
            "unit": after[which][reading]["unit"],
            "held_out": is_held_out,
        }
    findings = [f"{one['effect']} at {' + '.join(one['place'])}" for one in diagnosis["findings"]]
    return {
        "machine": diagnosis["machine"],
        "check": check,
        "verdict": diagnosis["verdict"],
        "concealed": diagnosis["concealed"],
        "chi2_before": rounded(before["chi2_per_dof"]),
        "chi2_after": rounded(after["chi2_per_dof"]),
        "reading": reading,
        **rms,
        "ratio": proof and rounded(proof["ratio"]),
        "noise": rounded(diagnosis["noise"]),
        "findings": "; ".join(sorted(findings)),
        "remainder": (diagnosis["remainder"] and diagnosis["remainder"]["driver"]) or "",
    }


def parameters_of(diagnosis: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Return value and 1-sigma of every parameter that the readings show."""
    return {
        name: (_resolved(one["value"], one["std"]), rounded(one["std"]))
        for name, one in diagnosis["parameters"].items()
        if one["identifiable"] and one["std"] is not None
    }


def _resolved(value: float, std: float) -> float:
    """Round a value to a small part of its 1-sigma."""
    return round(value, -math.floor(math.log10(FINE * std))) if std > 0 else value


def rounded(value: float | None) -> Any:
    """Round to ``DIGITS`` significant digits; None for what is no number."""
    return None if value is None else float(f"{value:.{DIGITS}g}")


# -- What changed in a fleet since its last run: machines new and gone, verdicts, names, parameters that moved

FALSE = 0.05
"""Probability that of all parameters compared one that stands still is said to have moved. The usual level."""
LEAST = 3.0
"""Difference in 1-sigma below which nothing is said to have moved, however few were compared: the field's three sigma."""


@dataclass(frozen=True)
class Moved:
    """A parameter that moved by ``change`` (mm or rad), ``sigma`` times its 1-sigma."""

    machine: str
    parameter: str
    change: float
    sigma: float


@dataclass(frozen=True)
class Change:
    """Something that is said of a machine otherwise than before. what: ``status``, ``verdict`` or ``findings``."""

    machine: str
    what: str
    before: str
    after: str


@dataclass(frozen=True)
class Changes:
    """All of it, by machine; moved: largest first, each beyond ``limit`` sigma.

    compared: parameters of the ``again`` machines that were worked with again.
    """

    new: tuple[str, ...]
    gone: tuple[str, ...]
    said: tuple[Change, ...]
    moved: tuple[Moved, ...]
    compared: int
    again: int
    limit: float

    @property
    def any(self) -> bool:
        """Whether there is something to tell."""
        return bool(self.new or self.gone or self.said or self.moved)


def compare(before: Mapping[str, Record], after: Mapping[str, Record]) -> Changes:
    """Compare the records of two runs, by name."""
    shared = sorted(before.keys() & after.keys())
    again = [(before[name], after[name]) for name in shared if before[name] != after[name]]
    steps = [step for old, new in again for step in _steps(old, new)]
    limit = sigma_limit(len(steps))
    moved = [step for step in steps if step.sigma > limit]
    return Changes(
        new=tuple(sorted(after.keys() - before.keys())),
        gone=tuple(sorted(before.keys() - after.keys())),
        said=tuple(change for old, new in again for change in _said(old, new)),
        moved=tuple(sorted(moved, key=lambda one: (-one.sigma, one.machine, one.parameter))),
        compared=len(steps),
        again=len(again),
        limit=limit,
    )


def sigma_limit(compared: int) -> float:
    """Return the normal quantile, the level shared among all comparisons (Bonferroni); never below ``LEAST``."""
    return max(float(norm.isf(FALSE / 2 / max(compared, 1))), LEAST)


def _steps(before: Record, after: Record) -> Iterator[Moved]:
    """Yield how far each parameter of both is from where it was."""
    for name in sorted(before.parameters.keys() & after.parameters.keys()):
        (old, old_std), (new, new_std) = before.parameters[name], after.parameters[name]
        std = math.hypot(old_std, new_std)
        yield Moved(after.name, name, new - old, abs(new - old) / std if std > 0 else 0.0)


def _said(before: Record, after: Record) -> Iterator[Change]:
    """Yield what is said otherwise; verdict and findings only where both have a diagnosis, or neither."""
    if before.status != after.status:
        yield Change(after.name, "status", before.status, after.status)
    for what in ("verdict", "findings") if before.is_diagnosed == after.is_diagnosed else ():
        old, new = before.figures.get(what, ""), after.figures.get(what, "")
        if old != new:
            yield Change(after.name, what, old, new)
