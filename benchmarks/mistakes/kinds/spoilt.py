"""What a mistake leaves behind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

from ..pairs import Document, Pair

Judged = Literal["free", "held", "certain", "sag"]


@dataclass(frozen=True)
class Spoilt:
    """A pair with one mistake.

    where: words of which one is expected in ``where`` (joints, columns, frames, sections); exact: whether all the joints
    or columns named must be these. kinds: other kinds that say as much. judged: against which rigid fit it must show:
    base and tool anywhere (``free``), near the drawing (``held``), or it is there to be counted (``certain``), where readings
    show what gives way under weights (``sag``).
    mends: whether a corrected pair must fit as the right one does.
    """

    variant: str
    document: Document
    table: pd.DataFrame
    where: tuple[str, ...]
    exact: bool = False
    kinds: tuple[str, ...] = ()
    judged: Judged = "free"
    mends: bool = True
    files: Mapping[str, str] = field(default_factory=dict)


Maker = Callable[[Pair, np.random.Generator], Spoilt | None]
"""Spoils a pair; None where the mistake makes no sense at this machine."""
