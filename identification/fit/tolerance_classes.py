"""Classes of parts whose tolerances were stated together, and may be wrong together.

All lower joint centres of legs are a class, and all angles of a chain's joints. What is wrong for one part of a
class is wrong for all of it. All classes of a kind may be wrong alike (one drawing, one optimist), or one of them alone.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.identification.prior import INFLATIONS, NARROWER, TOLERANCE_DOUBT
from truepose.models.machine.mechanism import like_parts

INFLATED = ("length", "angle")
"""Kinds whose classes are told apart; all others (frames, sensors, targets) are one class each."""
ALONE = (*INFLATED, "frame")
"""Kinds that may be misstated alone; gains, sensors and targets come with instruments, each with a paper of its own."""
WEIGHED = ("mass", "centre", "spring")
"""Kinds of what a user says of weights and springs. Hardly a reading tells of them: that other tolerances are too wide says
nothing of theirs."""
FEW = 4
"""Parameters that a class needs to stand on its own; smaller ones share the rest of their kind."""


@dataclass(frozen=True)
class PartClass:
    """Parameters of one kind at alike parts (``leg.a`` of every leg); without ``parts``, all others of the kind."""

    kind: str
    parts: str = ""


def part_classes(names: Sequence[str], kinds: Sequence[str]) -> tuple[PartClass, ...]:
    """Class of every parameter."""
    raw = [
        PartClass(kind, like_parts(name) if kind in INFLATED else "")
        for name, kind in zip(names, kinds, strict=True)
    ]
    count = Counter(raw)
    return tuple(PartClass(one.kind) if count[one] < FEW else one for one in raw)


def inflations(classes: Sequence[PartClass]) -> tuple[tuple[float, ...], ...]:
    """Inflations of the classes to weigh: lengths and angles, everything at once, and each class of ``ALONE`` alone."""
    kinds = [kind for kind in INFLATED if any(c.kind == kind for c in classes)]
    out = []
    for factors in itertools.product(INFLATIONS, repeat=len(kinds)):
        of = dict(zip(kinds, factors, strict=True))
        out.append(tuple(of.get(c.kind, 1.0) for c in classes))
    for factor in INFLATIONS[1:]:
        out.append((factor,) * len(classes))
        alone = [k for k, c in enumerate(classes) if c.kind in ALONE]
        out += [tuple(factor if j == k else 1.0 for j in range(len(classes))) for k in alone]
    return tuple(dict.fromkeys(out))


def widenings(classes: Sequence[PartClass]) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
    """Factors of all classes to weigh, the stated ones (1) first and all too wide together among them; log prior of each."""
    stated = (1.0,) * len(classes)
    rows = (
        tuple(dict.fromkeys([stated, *inflations(classes), (NARROWER,) * len(classes)])) if classes else ((),)
    )
    return rows, tuple(-tolerance_cost(row, classes) for row in rows)


def tolerance_cost(inflation: Sequence[float], classes: Sequence[PartClass]) -> float:
    """Minus the log prior (up to a constant) of one factor of widening for each class of parts.

    All are off together by one factor, at its cost, or each kind by its own; classes by what they differ from it.
    """
    doubt = np.log(np.array(inflation, dtype=float)) / TOLERANCE_DOUBT
    kinds = [doubt[[c.kind == kind for c in classes]] for kind in dict.fromkeys(c.kind for c in classes)]
    return min(
        float(0.5 * common**2) + sum(_cheapest(own, common) for own in kinds)
        for common in {0.0, *doubt.tolist()}
    )


def _cheapest(own: Array, common: float) -> float:
    """Cost of a kind's classes (in steps of doubt) when the kind is off by one factor of its own beside the common one."""
    return min(
        0.5 * float((base - common) ** 2 + np.sum((own - base) ** 2)) for base in {common, *own.tolist()}
    )
