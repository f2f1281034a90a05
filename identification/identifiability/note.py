"""Remarks beside results, as data: the report words them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "unassembled",
    "crossing",
    "validation",
    "own class",
    "nameless",
    "payload",
    "strokes",
    "creep",
    "motions",
    "unread",
]


@dataclass(frozen=True)
class Note:
    """A remark of some kind about a row, a name or a driver."""

    kind: Kind
    about: str = ""
