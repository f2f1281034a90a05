"""The parts of the battery: what is drawn, and which real recordings are diagnosed, whole, in halves and cut to a few rows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from challenge.schedule import OUTSIDE, REAL
from truepose.errors import InputError

Index = NDArray[np.intp]
STRATA: Mapping[str, tuple[str, int]] = {"real-like": (REAL, 20), "outside": (OUTSIDE, 20)}
"""Folders of drawn cases: stratum and number."""
MUJOCO, ARMS = "mujoco", 10
RECORDED = "recorded"
SIMULATED = (*STRATA, MUJOCO)
PARTS = (*SIMULATED, RECORDED)
CUTS = (60, 120, 240)
PREDICTED = 500
LEAST_LEFT = 0.1
"""Share of a recording that a cut must leave."""
WHOLE, FIRST, SECOND, SOME, OTHERS = "whole", "first-half", "second-half", "random-half", "other-half"
HALVES: Mapping[str, str] = {FIRST: SECOND, SECOND: FIRST, SOME: OTHERS, OTHERS: SOME}
"""Each half with what it leaves."""


@dataclass(frozen=True)
class Real:
    """A real recording: rows in its file, and how many of them are diagnosed at most, drawn at random."""

    name: str
    rows: int
    most: int = max(CUTS)

    @property
    def diagnosed(self) -> int:
        """Rows of the whole."""
        return min(self.rows, self.most)

    @property
    def parts(self) -> tuple[str, ...]:
        """What is diagnosed of it: all (of a long one the largest cut), halves, and every smaller cut that leaves rows to
        predict."""
        most = min((1.0 - LEAST_LEFT) * self.rows, self.diagnosed)
        cuts = (f"cut-{count}" for count in CUTS if count < most)
        return (WHOLE, *HALVES, *cuts)

    def split(self, part: str) -> tuple[Index, Index]:
        """Rows that a part fits, in the order of the file, and rows that are predicted."""
        order = np.random.default_rng(1).permutation(self.rows)
        if part.startswith("cut-"):
            count = int(part.removeprefix("cut-"))
            return np.sort(order[:count]), np.sort(order[count : count + PREDICTED])
        whole = np.sort(order[: self.diagnosed])
        if part == WHOLE:
            return whole, np.sort(order[self.diagnosed : self.diagnosed + PREDICTED])
        halves = self._halves(whole)
        return halves[part], halves[HALVES[part]]

    def _halves(self, whole: Index) -> Mapping[str, Index]:
        """In time and at random; only rows of the whole, so that it has seen what they saw."""
        middle, mixed = len(whole) // 2, np.random.default_rng(2).permutation(whole)
        return {
            FIRST: whole[:middle],
            SECOND: whole[middle:],
            SOME: np.sort(mixed[:middle]),
            OTHERS: np.sort(mixed[middle:]),
        }


REALS = (
    Real("session_60", 60),
    Real("session_108", 108),
    Real("panda_1_with_sensor", 120),
    Real("panda_1", 182),
    Real("configurations", 1495),
    Real("random", 2773),
    Real("grid", 11911),
)
"""What takes least first."""
CASES: Mapping[str, tuple[Real, str]] = {
    f"{real.name}.{part}": (real, part) for real in REALS for part in real.parts
}
"""Every case of real recordings by name."""


def of_whole(case: str) -> tuple[str, str | None]:
    """Cases to ask whether what a half says is so: the whole, and the other half where there is none (None: no half)."""
    real, part = CASES[case]
    return f"{real.name}.{WHOLE}", f"{real.name}.{HALVES[part]}" if part in HALVES else None


def chosen(names: str) -> tuple[str, ...]:
    """Parts that were asked for by name, all without any. Raises InputError for one that is unknown."""
    given = tuple(name.strip() for name in names.split(",") if name.strip())
    for name in given:
        if name not in PARTS:
            raise InputError(f"challenge.battery: found part {name!r}, expected one of {', '.join(PARTS)}")
    return given or PARTS


__all__ = [
    "ARMS", "CASES", "CUTS", "HALVES", "MUJOCO", "PARTS", "REALS", "RECORDED", "SIMULATED", "STRATA", "WHOLE", "Real",
    "chosen", "of_whole",
]  # fmt: skip
