"""How much better is certain, how much misfit is absurd, and how to show both."""

from __future__ import annotations

import numpy as np

from truepose.identification.check.drawing import Array, expected
from truepose.identification.check.result import Found, Verdict
from truepose.identification.check.rig import ABSURD, Rig, Stand, motion
from truepose.identification.fit.absurd import GROSS
from truepose.wording import joined

SURE, LIKELY = 3.0, 1.7
"""How many times better than as it stands a slip must fit to be certain, or to be worth a word."""
QUIET = 2.5
"""Misfit, in sigmas, below which nothing is looked for: no slip could then fit ``SURE`` times better."""

PHYSICS = 0.2
"""Share of what the tool moves that nothing left out of a model makes: an open-loop piezo is off by 0.23 of its stroke."""

USUAL = 500.0
"""mm: the longest dimension of a robot, roughly."""


def reach(rig: Rig, p: Array) -> float:
    """Longest dimension of the mechanism at constants p (np,), mm; 0 where none is a length."""
    long = [rig.names.index(q.name) for q in rig.machine.mechanism.parameters if q.unit == "mm"]
    return float(np.abs(p[long]).max(initial=0.0))


def shown(before: Stand, after: Stand) -> tuple[float | None, float | None, str]:
    """Two misfits in a unit that users know: mm of the position where there is one, else sigmas; None where nothing fits."""
    if before.bad:
        return (None, after.misfit, "sigma") if after.length is None else (None, after.length, "mm")
    if before.length is not None and after.length is not None:
        return before.length, after.length, "mm"
    return before.misfit, after.misfit, "sigma"


def off(rig: Rig, stand: Stand) -> bool:
    """Whether a misfit is more than the tolerances let one expect: then no search is too long."""
    known = any(p.free for p in rig.machine.mechanism.parameters)
    least = 2.0 * expected(rig, stand) if known else ABSURD * motion(rig, stand)
    return stand.bad or stand.misfit > least


def hopeless(rig: Rig, stand: Stand, price: float) -> bool:
    """Whether no fit could be called a calibration: its price is beyond ``GROSS``, and no drawing is wrong by so much."""
    return stand.bad or (price > GROSS and stand.misfit > ABSURD * motion(rig, stand))


def unexplained(rig: Rig, stand: Stand) -> Found:
    """A misfit that no slip explains; where a joint is said never to move, that may be it. Certain beyond all physics only."""
    certain = stand.bad or stand.misfit > PHYSICS * motion(rig, stand)
    verdict: Verdict = "wrong" if certain else "suspect"
    size = f"{stand.length:.3g} mm" if stand.length is not None else f"{stand.misfit:.3g} sigma"
    before, _, unit = shown(stand, stand)
    misses = (
        "the drawn machine cannot stand as its joints were read"
        if stand.bad
        else f"with base and tool fitted, the drawn machine misses the readings by {size}"
    )
    if rig.still:
        names = joined(rig.still)
        return Found(
            "joint-never-moves",
            rig.still,
            f"{names} never {'moves' if len(rig.still) == 1 else 'move'} in the recording, and {misses}:"
            f" {'it' if len(rig.still) == 1 else 'they'} may have moved without being logged",
            f"record {names}",
            verdict,
            before,
            unit=unit,
        )
    return Found(
        "unexplained",
        (),
        f"{misses}, and no slip that was tried explains it",
        "compare the table of constants, the order of joints and the rows with their source",
        verdict,
        before,
        unit=unit,
    )


__all__ = ["LIKELY", "QUIET", "SURE", "USUAL", "hopeless", "off", "reach", "shown", "unexplained"]
