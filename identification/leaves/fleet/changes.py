"""What changed in a fleet since its last run: machines new and gone, verdicts, names, parameters that moved.

A parameter has moved where the difference of its two values is more than chance allows: beyond ``FALSE`` for one such among
all that were compared, whatever their number.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from scipy.stats import norm

from truepose.identification.leaves.fleet.record import Record

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
