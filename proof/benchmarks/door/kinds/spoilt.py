"""What a mistake leaves behind."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import pandas as pd

from ..pairs import Document, Pair

Judged = Literal["fit", "certain", "sag"]


@dataclass(frozen=True)
class Spoilt:
    """A pair with one mistake.

    where: words of which one is expected in ``where`` (joints, columns, frames, sections). kinds: other kinds that say as much.
    judged: whether its misfit says that it is there (``fit``), it is there to be counted (``certain``), or it is there where
    readings show what gives way under weights (``sag``). mends: whether a corrected pair must fit as the right one does.
    """

    variant: str
    document: Document
    table: pd.DataFrame
    where: tuple[str, ...]
    kinds: tuple[str, ...] = ()
    judged: Judged = "fit"
    mends: bool = True
    files: Mapping[str, str] = field(default_factory=dict)


Maker = Callable[[Pair, np.random.Generator], Spoilt | None]
"""Spoils a pair; None where the mistake makes no sense at this machine."""
