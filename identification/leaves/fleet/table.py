"""The table of a fleet, ``fleet.csv``: a row a machine.

Which machines are unlike their fleet, and why: each is judged by the others.

Three things are looked at: effects that are there where others have none, or missing where others have them; sizes of effects;
deviations of constants. Each has a tail probability in another machine of the fleet (a prediction, so that few machines make
nothing odd); a machine is odd when the smallest is so small that no more than one machine in twenty has such a one anywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import expit, stdtr

from truepose.arrays import Array, Index
from truepose.files import atomic_write_text
from truepose.identification.leaves.fleet.record import Changes, Record, findings_text
from truepose.identification.leaves.fleet.statistics import FleetStatistics
from truepose.identification.leaves.fleet.summary import (
    UNIT,
    Columns,
    Said,
    Summary,
    Whole,
    constant_moments,
    effect_moments,
    size_moments,
)
from truepose.identification.prior import URN

# -- Which machines are unlike their fleet, and why: each is judged by the others

ODD = 0.05
"""Probability that nothing odd is called odd, and below which something is a reason at all. Chosen."""
SURE = 0.9
"""Probability from which on an effect is there, and below one less of which it is not."""
OTHERS = 4.0
"""Others that sizes and constants are compared with, at least."""


@dataclass(frozen=True)
class Reason:
    """Something odd. kind: ``present``, ``absent``, ``size`` or ``parameter``; name: ``effect@place`` or a constant's name;
    share: probability of anything as far out in another machine of the fleet; text: in words."""

    kind: str
    name: str
    share: float
    text: str


@dataclass(frozen=True)
class Oddness:
    """score: minus log10 of the smallest share, counted for all that was looked at (above 1.3, 5 %, a machine is ``odd``);
    reasons: rarest first."""

    score: float
    odd: bool
    reasons: tuple[Reason, ...]


@dataclass(frozen=True)
class _Looked:
    """Things that were looked at (n,): in which machine, their share, and what makes the reason of the k-th."""

    machine: Index
    share: Array
    reason: Callable[[int], Reason]


def oddness(columns: Columns, summary: Summary) -> list[Oddness]:
    """Of machines that were gathered and are part of the summary, in their order."""
    number = np.zeros(columns.machines, dtype=np.intp)
    reasons: list[list[Reason]] = [[] for _ in range(columns.machines)]
    for looked in (_effects(columns, summary), _sizes(columns, summary), _constants(columns, summary)):
        number += np.bincount(looked.machine, minlength=columns.machines)
        for k in np.flatnonzero(looked.share < ODD).tolist():
            reasons[looked.machine[k]].append(looked.reason(k))
    return [_oddness(*one) for one in zip(number.tolist(), reasons, strict=True)]


def _oddness(looked: int, reasons: Sequence[Reason]) -> Oddness:
    found = tuple(sorted(reasons, key=lambda one: (one.share, one.name)))
    least = min(1.0, looked * found[0].share) if found else 1.0
    return Oddness(float(-np.log10(max(least, 1e-300))) + 0.0, least < ODD, found)


def _others(kind: str, said: Said, own: Whole, summary: Summary) -> Array:
    """(r, c) sums of the others about what each row is about: exact, for sums are whole numbers."""
    there, columns = summary.sums, own.shape[1]
    nothing = np.zeros(columns, dtype=np.int64)
    sums = np.array([there.get(f"{kind}|{key}", nothing)[:columns] for key in said.keys], dtype=np.int64)
    return np.asarray((sums.reshape(-1, columns)[said.thing] - own) * UNIT)


def _effects(columns: Columns, summary: Summary) -> _Looked:
    """What is surely there, or surely not although it would have been seen; the frequency of others beside today's prior."""
    said = columns.places
    p, unseen = said.numbers[:, 0], said.numbers[:, 3]
    others = _others("place", said, effect_moments(said), summary)
    present, absent = p >= SURE, (p <= 1.0 - SURE) & (unseen < 1.0 - SURE)
    at = np.flatnonzero((others[:, 0] > 0.5) & (present | absent))
    (n, odds, found), there = others[at].T, present[at]
    share = (found + URN * expit(odds / n)) / (n + URN)
    share = np.where(there, share, 1.0 - share)

    def reason(k: int) -> Reason:
        _, effect, place = said.keys[said.thing[at[k]]].split("|")
        what, kind = ("no ", "absent") if not there[k] else ("", "present")
        text = f"{what}{effect} at {place}, which {found[k]:.0f} of {n[k]:.0f} others have"
        return Reason(kind, f"{effect}@{place}", float(share[k]), text)

    return _Looked(said.machine[at], share, reason)


def _sizes(columns: Columns, summary: Summary) -> _Looked:
    """Sizes of effects that are surely there, by those of others that have them."""
    said = columns.sizes
    moments = size_moments(said)
    own, others = moments * UNIT, _others("size", said, moments, summary)
    at = np.flatnonzero((own[:, 0] >= SURE) & (others[:, 0] >= OTHERS))
    n, mean, variance = _normal(*others[at, :3].T)
    away = own[at, 1] / own[at, 0] - mean
    share, _ = _tail(away, variance, n)

    def reason(k: int) -> Reason:
        _, effect, place, _ = said.keys[said.thing[at[k]]].split("|")
        text = f"{effect} at {place} is {np.exp(away[k]):.2g} times the median of {n[k]:.0f} others"
        return Reason("size", f"{effect}@{place}", float(share[k]), text)

    return _Looked(said.machine[at], share, reason)


def _constants(columns: Columns, summary: Summary) -> _Looked:
    """Deviations from the drawing, by those of others."""
    said = columns.constants
    others = _others("constant", said, constant_moments(said), summary)
    at = np.flatnonzero(others[:, 0] >= OTHERS)
    n, mean, variance = _normal(*others[at, :3].T)
    x = said.numbers[at, 0]
    share, far = _tail(x - mean, variance, n)

    def reason(k: int) -> Reason:
        _, name = said.keys[said.thing[at[k]]].split("|")
        text = (
            f"{name} is {x[k]:+.1f} tolerances off its drawing, {far[k]:.1f} times the spread of {n[k]:.0f} others"
            " from their mean"
        )
        return Reason("parameter", name, float(share[k]), text)

    return _Looked(said.machine[at], share, reason)


def _normal(n: Array, value: Array, square: Array) -> tuple[Array, Array, Array]:
    """Number, mean and variance about the mean, from sums."""
    mean = value / n
    return n, mean, square / n - mean**2


def _tail(away: Array, variance: Array, n: Array) -> tuple[Array, Array]:
    """Two-sided probability of a next value as far from the mean of n as this (normal, both moments estimated), and how many
    1-sigmas of theirs it is away. variance: of theirs about their mean, over n."""
    far = np.abs(away) / np.sqrt(np.maximum(variance, 1e-12) * n / (n - 1.0))
    return np.asarray(2.0 * stdtr(n - 1.0, -far / np.sqrt(1.0 + 1.0 / n))), far


# -- What a run over a fleet says, as data: everything that fleet.json and the page are written from

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


# -- The table of a fleet, ``fleet.csv``: a row a machine


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


def write_rows(path: Path, rows: Iterable[Row]) -> None:
    """The table as CSV, whole or not at all."""
    atomic_write_text(path, table(rows).to_csv(index=False, lineterminator="\n"))
