"""A table of the standard convention taken for a modified one, or the reverse."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..pairs import Pair
from .spoilt import Spoilt

WHERE = ("mechanism", "joints", "machine", "mechanism.joints", "convention", "alpha", "d", "r", "a")


def dh_convention(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Rows of the data sheet typed into this file's fields: with names translated, as they stand, or with ``a``."""
    if not pair.sheet:
        return None
    document, table = pair.draft()
    kept = [dict(j) for j in document["mechanism"]["joints"]]
    pick = rng.random()
    if pick < 0.6:
        variant, fill = "names translated", _translated
    elif pick < 0.8:
        variant, fill = "d for d", _as_it_stands
    else:
        variant, fill = "field a", _with_a
    document["mechanism"]["joints"] = [
        {**_without(joint), **fill(dict(row))} for joint, row in zip(kept, pair.sheet, strict=True)
    ]
    where = (*WHERE, *pair.joints)
    return Spoilt(variant, document, table, where, kinds=())


def _without(joint: dict[str, Any]) -> dict[str, Any]:
    return {k: v for k, v in joint.items() if k not in ("beta", "alpha", "d", "theta", "r")}


def _translated(row: dict[str, float]) -> dict[str, float]:
    """The user knows that r is along z and d along x, and not that alpha and d belong to the joint before."""
    return {"alpha": row["alpha"], "d": row["a"], "theta": row["theta"], "r": row["d"]}


def _as_it_stands(row: dict[str, float]) -> dict[str, float]:
    """``a`` was refused, so it went where there was room."""
    return {"alpha": row["alpha"], "d": row["d"], "theta": row["theta"], "r": row["a"]}


def _with_a(row: dict[str, float]) -> dict[str, float]:
    return {"a": row["a"], "alpha": row["alpha"], "d": row["d"], "theta": row["theta"]}
