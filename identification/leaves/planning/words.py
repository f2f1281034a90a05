"""What planned poses are worth for a calibration: lines for a terminal, notes, and JSON."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from truepose.identification.leaves.planning.plan import CRITERION, TITLE, Plan
from truepose.models.file.driver import Driver

CROWDED = 0.02
"""Poses closer than this, in shares of the ranges, are as good as repeats."""


def plan_lines(found: Plan) -> list[str]:
    """What was reached, against random poses."""
    by_exchange = "" if found.by_exchange is None else f"; by exchange {found.by_exchange:.4f}"
    lines = [
        f"criterion {CRITERION}: {TITLE} = {found.value:.4f}; random poses {np.mean(found.random):.4f} +- "
        f"{np.std(found.random):.4f} ({len(found.random)} sets){by_exchange}"
    ]
    if found.shrinkage is not None:
        lines.append(
            f"1-sigma of the {found.determined} determined directions: {found.shrinkage:.3f} of what random poses "
            "leave (geometric mean)"
        )
    return lines


def plan_notes(found: Plan) -> list[str]:
    """What the plan leaves out, and poses that crowd."""
    notes = []
    unplanned = dict.fromkeys(
        Driver.of(name).now.name for effect in found.machine.effects for name in effect.drivers
    )
    notes += [
        f"{name!r} is not planned: effects that depend on it count at its default" for name in unplanned
    ]
    if found.left_out:
        notes.append(f"{found.left_out} candidates were left out: not assembled, or next to a singularity")
    alike = found.repeats(CROWDED)
    if 2 * alike >= len(found.q):
        notes.append(
            f"{alike} of {len(found.q)} poses repeat others within {CROWDED:.0%} of the ranges: best for the constants "
            "of this file, but blind to physics that it lacks; --method exchange spreads them"
        )
    return notes


def plan_json(found: Plan, columns: Sequence[str]) -> dict[str, object]:
    """The same as data; ``columns`` are those of the poses' table."""
    random = {
        "mean": float(np.mean(found.random)),
        "std": float(np.std(found.random)),
        "sets": len(found.random),
    }
    indices = {f"O{k}": float(getattr(found.indices, f"o{k}")) for k in range(1, 6)}
    return {
        "machine": found.machine.name,
        "method": found.method,
        "criterion": CRITERION,
        "seed": found.seed,
        "poses": len(found.q),
        "columns": list(columns),
        "value": found.value,
        "random": random,
        "exchange": found.by_exchange,
        "repeats": found.repeats(CROWDED),
        "determined": found.determined,
        "shrinkage": found.shrinkage,
        "observability": indices,
    }
