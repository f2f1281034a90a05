"""What changed in a fleet since its last run: machines new and gone, verdicts, names, parameters that moved.

A parameter has moved where the difference of its two values is more than chance allows: beyond ``FALSE`` for one such among
all that were compared, whatever their number.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from scipy.stats import norm

from truepose.identification.leaves.fleet.record import Record

FALSE = 0.05
"""Probability that of all parameters compared one that stands still is said to have moved. The usual level."""
LEAST = 3.0
"""Difference in 1-sigma below which nothing is said to have moved, however few were compared: the field's three sigma."""


class Named(Protocol):
    """What has the name of a machine."""

    @property
    def name(self) -> str:
        """Of the machine."""


Item = TypeVar("Item", bound=Named)


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
    """All of it, by machine; moved: largest first. compared: parameters of machines that were worked with again."""

    new: tuple[str, ...] = ()
    gone: tuple[str, ...] = ()
    said: tuple[Change, ...] = ()
    moved: tuple[Moved, ...] = ()
    compared: int = 0
    again: int = 0

    @property
    def any(self) -> bool:
        """Whether there is something to tell."""
        return bool(self.new or self.gone or self.said or self.moved)

    @property
    def limit(self) -> float:
        """Difference in 1-sigma beyond which chance is no explanation."""
        return limit(self.compared)


def limit(compared: int) -> float:
    """Two-sided normal quantile, the level shared out among all comparisons (Bonferroni); never below ``LEAST``."""
    return max(float(norm.isf(FALSE / 2 / max(compared, 1))), LEAST)


@dataclass
class Comparison:
    """Pairs of records, taken one after the other."""

    new: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)
    said: list[Change] = field(default_factory=list)
    far: list[Moved] = field(default_factory=list)
    compared: int = 0
    again: int = 0

    def take(self, before: Record | None, after: Record | None) -> None:
        """A machine's record of the last run and of this one; None where there is none."""
        if after is None:
            self.gone.append(before.name if before else "")
        elif before is None:
            self.new.append(after.name)
        elif before != after:
            self.again += 1
            self.said += _said(before, after)
            shared = before.parameters.keys() & after.parameters.keys()
            self.compared += len(shared)
            self.far += [one for one in (_moved(before, after, name) for name in sorted(shared)) if one]

    def result(self) -> Changes:
        """What changed."""
        least = limit(self.compared)
        moved = sorted(
            (m for m in self.far if m.sigma > least), key=lambda m: (-m.sigma, m.machine, m.parameter)
        )
        return Changes(
            tuple(self.new), tuple(self.gone), tuple(self.said), tuple(moved), self.compared, self.again
        )


def compared(before: Iterable[Record], after: Iterable[Record]) -> Changes:
    """Two runs, both by name."""
    comparison = Comparison()
    for old, new in paired(before, after):
        comparison.take(old, new)
    return comparison.result()


def paired(before: Iterable[Item], after: Iterable[Item]) -> Iterator[tuple[Item | None, Item | None]]:
    """Records of two runs, or lines of them, by machine; each run in the order of names."""
    both = heapq.merge(
        ((r.name, 0, r) for r in before), ((r.name, 1, r) for r in after), key=lambda one: one[:2]
    )
    waiting: Item | None = None
    for _, which, record in both:
        if which == 0:
            if waiting is not None:
                yield waiting, None
            waiting = record
        elif waiting is not None and waiting.name == record.name:
            yield waiting, record
            waiting = None
        else:
            if waiting is not None:
                yield waiting, None
            waiting = None
            yield None, record
    if waiting is not None:
        yield waiting, None


def _said(before: Record, after: Record) -> Iterator[Change]:
    pairs = {
        "status": (before.status, after.status),
        "verdict": (_verdict(before), _verdict(after)),
        "findings": (findings_text(before), findings_text(after)),
    }
    for what, (old, new) in pairs.items():
        if old != new:
            yield Change(after.name, what, old, new)
        if what == "status" and before.diagnosed != after.diagnosed:
            return  # the others are known of one of them only


def _verdict(record: Record) -> str:
    return str(record.figures.get("verdict", ""))


def findings_text(record: Record) -> str:
    """``backlash at q2; link-bending at link2 + link3``: what was found, in the order of names."""
    found: Iterable[Mapping[str, Any]] = record.figures.get("findings", ())
    return "; ".join(sorted(f"{one['effect']} at {' + '.join(one['place'])}" for one in found))


def _moved(before: Record, after: Record, name: str) -> Moved | None:
    (old, old_std), (new, new_std) = before.parameters[name], after.parameters[name]
    std = math.hypot(old_std, new_std)
    sigma = abs(new - old) / std if std > 0 else 0.0
    return Moved(after.name, name, new - old, sigma) if sigma > LEAST else None


__all__ = ["Change", "Changes", "Comparison", "Moved", "compared", "findings_text", "limit", "paired"]
