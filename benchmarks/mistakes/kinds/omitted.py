"""Sections of the machine file that were left out, and a sigma that replicates deny."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..pairs import TURNS, Pair
from .spoilt import Spoilt

FAR = (30.0, 150.0)
AGREES, DENIES = 4.0, 10.0
"""Scatter of replicates over sigma: within a factor of the first in a right pair, beyond the second in a wrong one."""


def no_tolerances(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Nothing says how well the parts were made."""
    return _without(pair, "tolerances")


def no_sensor(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Nothing says what was read."""
    return _without(pair, "sensor")


def no_gravity(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """Weights, and nothing that pulls them."""
    if not any(m.get("kg", 0) > 0 for m in pair.document.get("masses", {}).values()):
        return None
    return _without(pair, "gravity")


def _without(pair: Pair, name: str) -> Spoilt | None:
    document, table = pair.draft()
    if name not in document:
        return None
    del document[name]
    where = (name, "machine", "machine.yaml", f"{name}.length", f"{name}.angle")
    return Spoilt("left out", document, table, where, judged="certain", mends=False)


def sigma(pair: Pair, rng: np.random.Generator) -> Spoilt | None:
    """The sensor's sigma times or over 30 to 150, where replicates tell."""
    scatter = replicates(pair)
    if scatter is None or not 1 / AGREES < scatter < AGREES:
        return None
    factor = float(np.exp(rng.uniform(*np.log(FAR))))
    factor = factor if rng.random() < 0.5 else 1.0 / factor
    if 1 / DENIES < scatter / factor < DENIES:
        return None
    document, table = pair.draft()
    stated = document["sensor"]["sigma"]
    document["sensor"]["sigma"] = {k: float(f"{factor * v:.4g}") for k, v in stated.items()}
    where = ("sigma", "sensor", "sensor.sigma", *pair.readings, *(f"sensor.sigma.{k}" for k in stated))
    return Spoilt("too large" if factor > 1 else "too small", document, table, where, judged="certain")


def replicates(pair: Pair) -> float | None:
    """Scatter of readings at one pose number and the same joints over the stated sigma; None without replicates."""
    if "pose" not in pair.table or pair.sensor == "distance":
        return None
    stated = pair.document["sensor"]["sigma"]
    parts = []
    groups = pair.table.groupby(["pose", *pair.joints])
    for name in pair.readings:
        kind = "rot" if name in TURNS else "distance" if name == "length" else "xyz"
        spread = (pair.table[name] - groups[name].transform("mean"))[_repeated(groups[name])]
        degrees = len(spread) - pair.table[_repeated(groups[name])].groupby(["pose", *pair.joints]).ngroups
        if degrees < 8:
            return None
        parts.append(np.sqrt(float(np.sum(spread**2)) / degrees) / stated[kind])
    return float(np.median(parts))


def _repeated(values: Any) -> Any:
    return values.transform("size") > 1
