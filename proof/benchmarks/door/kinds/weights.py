"""Weights in grams, and gravity that pulls upwards."""

from __future__ import annotations

import numpy as np

from ..pairs import Pair
from .spoilt import Spoilt


def grams(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Masses in g under ``kg``."""
    document, table = pair.draft()
    weighed = [m for m in document.get("masses", {}).values() if m.get("kg", 0) > 0.5]
    for mass in weighed:
        mass["kg"] *= 1000.0
    return Spoilt("grams", document, table, ("masses",), judged="certain", mends=False) if weighed else None


def gravity_reversed(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Acceleration of a machine that stands, with the sign of one that hangs."""
    document, table = pair.draft()
    if "gravity" not in document or not document.get("masses"):
        return None
    document["gravity"] = [-float(v) for v in document["gravity"]]
    return Spoilt("upwards", document, table, ("gravity", "masses"), judged="sag", mends=False)
