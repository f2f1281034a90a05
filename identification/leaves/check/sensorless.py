"""A machine file without a sensor: the one that the columns of its recording speak of."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check, Found

_XYZ, _ROT = ("x", "y", "z"), ("rx", "ry", "rz")


def without_sensor(pair: Pair) -> Check:
    """What to say of a file without ``sensor``: the block to add."""
    names = [str(n) for n in pair.sheets[0].cells.columns] if pair.sheets else []
    block, words = _meant(pair, names)
    found = Found(
        "no-sensor",
        ("sensor",),
        "no sensor is stated: nothing says what the readings are",
        f"add '{words}' to the machine file (sigma as the instrument's maker states it)"
        if block
        else "add a block 'sensor' to the machine file: type, sigma and what its type needs",
        "wrong",
        mend=(lambda pair: pair.with_field(("sensor",), block)) if block else None,
    )
    rows = len(pair.sheets[0].cells) if pair.sheets else 0
    return Check((found,), rows, None)


def _meant(pair: Pair, names: list[str]) -> tuple[Mapping[str, Any] | None, str]:
    """The block, and how to write it; sigma is 1e-5 of what was seen, or 1e-3 deg."""
    if set(_XYZ) <= set(names):
        sigma: dict[str, float] = {"xyz": _sigma(pair, _XYZ)}
        kind = "position"
        if set(_ROT) <= set(names):
            sigma["rot"], kind = 0.005, "pose"
        text = ", ".join(f"{k}: {v:g}" for k, v in sigma.items())
        return {"type": kind, "sigma": sigma}, f"sensor: {{type: {kind}, sigma: {{{text}}}}}"
    targets = [n[:-2] for n in names if n.endswith(".x") and {f"{n[:-2]}.y", f"{n[:-2]}.z"} <= set(names)]
    if targets:
        points = ", ".join(f"{t}: [x, y, z]" for t in targets)
        return None, f"sensor: {{type: targets, points: {{{points}}}, sigma: {{xyz: ...}}}}"
    return None, ""


def _sigma(pair: Pair, names: tuple[str, ...]) -> float:
    spread = max(float(np.nanmax(s.numbers(n)) - np.nanmin(s.numbers(n))) for s in pair.sheets for n in names)
    return float(f"{max(spread, 1e-6) * 2e-5:.1g}")


__all__ = ["without_sensor"]
