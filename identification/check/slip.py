"""A slip that may have been made between a machine and its files: what would be right, and how to mend it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from truepose.identification.check.pair import Pair
from truepose.identification.check.rig import Scene, Stand

Change = Callable[[Scene], Scene]
Mend = Callable[[Pair], Pair]


@dataclass(frozen=True)
class Slip:
    """One hypothesis: its kind, the columns or fields it is about, what it says, and what it does to scene and files.

    says: what would be true ("readings are in m"); fix: what to change, in words; change: the scene as it would then be;
    mend: the files as they then should be.
    """

    kind: str
    where: tuple[str, ...]
    says: str
    fix: str
    change: Change
    mend: Mend
    searched: bool = False
    """Whether a size was searched for: it fits more easily than a slip of none, which comes first where both fit alike."""


@dataclass(frozen=True)
class Tried:
    """A slip with the scene under it, and how well base and tool fit there."""

    slip: Slip
    scene: Scene
    stand: Stand
    price: float = float("inf")
    """With what it costs in tolerances (``drawing.priced``)."""


__all__ = ["Change", "Mend", "Slip", "Tried"]
