"""What one solver did with one set of problems."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray


class Kind(Enum):
    """Whose a row is: the generated C a pose a call, many poses a call, or a peer's."""

    OURS = "ours"
    BATCH = "ours, many poses a call"
    PEER = "peer"


@dataclass(frozen=True)
class Timing:
    """Seconds of processor time a pose: the median over the repeats of one run, and the output of the last repeat."""

    seconds: float
    output: NDArray[np.float64]


@dataclass(frozen=True)
class Row:
    """One line of a table: solver, compiler flags, seconds a pose, share solved by the independent model, remark."""

    solver: str
    seconds: float
    solved: float | None = None
    kind: Kind = Kind.PEER
    flags: str = ""
    note: str = ""


def median_of(text: str) -> float:
    """The median of the lines that a driver prints, one a repeat."""
    return statistics.median(float(word) for word in text.split())


def quietest(measure: Callable[[], Sequence[Row]], rounds: int) -> list[Row]:
    """The rows of several rounds, each with its smallest median: other work on the machine only adds time."""
    taken = [measure() for _ in range(max(1, rounds))]
    return [min(same, key=lambda row: row.seconds) for same in zip(*taken, strict=True)]
