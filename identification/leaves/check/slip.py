"""A slip that may have been made between a machine and its files: what would be right, how likely it is, and how to mend it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.scene import Scene

Change = Callable[[Scene], Scene]
Mend = Callable[[Pair], Pair]
USUAL, SELDOM, RARE = 1e-2, 1e-3, 1e-5
"""Odds of one slip against none, before readings are looked at: what every workshop has seen, what happens, what hardly does.

A slip whose size is searched for is rare: a size that happens to fit is one of many hundred.
"""


@dataclass(frozen=True)
class Slip:
    """One hypothesis: its kind, the columns or fields it is about, what it says, and what it does to scene and files.

    says: what would be true ("readings are in m"); fix: what to change, in words; change: the scene as it would then be;
    mend: the files as they then should be; odds: how likely it is before readings are looked at; between: whether it is about
    which rows belong together, so that it says nothing of a row by itself.
    """

    kind: str
    where: tuple[str, ...]
    says: str
    fix: str
    change: Change
    mend: Mend
    odds: float = USUAL
    between: bool = False


__all__ = ["RARE", "SELDOM", "USUAL", "Change", "Mend", "Slip"]
