"""Drifts made up, for what is said and shown of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.identifiability.observability import Direction, Knowledge
from truepose.identification.identifiability.patterns import Blind
from truepose.identification.leaves.drift.analysis import Drift
from truepose.identification.leaves.drift.showing import drift_document
from truepose.identification.leaves.drift.sizes import Check, Durability, Movement
from truepose.shown.html import page

DAY = 86400.0
GOOD = Check({"position": 0.011}, {"position": 0.010}, {"position": "mm"}, 0.4, True)
NAMES = tuple("abcdefghijklmno")


def blind(*directions: Direction) -> Blind:
    """Unseen directions of parameters in mm."""
    n, nothing = len(NAMES), np.zeros((0, len(NAMES)))
    known = Decomposition.of(nothing, np.ones(n))
    return Blind(
        Knowledge(NAMES, ("mm",) * n, np.zeros(n), np.ones(n), np.ones(n), known), tuple(directions), ()
    )


def movement(name: str, status: str, **more: Any) -> Movement:
    given: dict[str, Any] = {"unit": "mm", "extrinsic": False, "probability": 0.99, "log_bayes_factor": 9.0}
    return Movement(**{**given, **more}, name=name, status=status)


def told_drift(
    *movements: Movement,
    times: Sequence[float] | None = (0.0, DAY, 3 * DAY),
    carried: Sequence[Check | None] = (GOOD, GOOD),
    frames: Sequence[Check | None] = (GOOD, GOOD),
    **more: Any,
) -> Drift:
    """Of sessions s0, s1 and so on, one more than there are checks."""
    count = len(carried) + 1
    full = (GOOD,) * len(carried)
    return Drift(
        **{
            "machine": "arm",
            "labels": tuple(f"s{k}" for k in range(count)),
            "times": None if times is None else tuple(times),
            "n_observations": tuple(range(30, 30 + count)),
            "movements": movements,
            "noise": 1.04,
            "log_bayes_factor": 12.0,
            "unseen": blind(),
            "durability": Durability(tuple(carried), tuple(frames), full, 1.04),
            "settled": True,
            "notes": (),
            **more,
        }
    )


CHANGED: dict[str, Any] = {
    "change": (0.0, 0.02, 0.06),
    "std": (0.0, 0.001, 0.001),
    "rate": 0.02 / DAY,
    "rate_std": 0.001 / DAY,
}
"""Of a parameter that moved over three sessions."""


def drift_html(found: Drift, cautions: Sequence[str] = ()) -> str:
    """The page of a result."""
    return page(replace(drift_document(found), cautions=cautions))
