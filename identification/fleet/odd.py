"""Which machines are unlike their fleet, and why: each is judged by the fleet without it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from truepose.identification.fleet.summary import Summary


@dataclass(frozen=True)
class Reason:
    """Something odd. kind: ``present``, ``absent``, ``size`` or ``parameter``; name: ``effect@place`` or a constant's name;
    share: probability of anything as far out in another machine of the fleet; text: in words."""

    kind: str
    name: str
    share: float
    text: str


@dataclass(frozen=True)
class Oddness:
    """score: minus log10 of the smallest share, counted for all that was looked at (above 1.3, 5 %, a machine is ``odd``);
    reasons: rarest first."""

    score: float
    odd: bool
    reasons: tuple[Reason, ...]


def oddness(kept: Mapping[str, Any], summary: Summary) -> Oddness:
    """Of a machine that is part of the summary, from what is kept of it."""
    raise NotImplementedError
