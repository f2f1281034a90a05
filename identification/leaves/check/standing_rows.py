"""Say which rows stand out of the rest, and what is left of all rows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truepose.identification.fit.standing_out import Left, row_words
from truepose.identification.leaves.check.pair import usable
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import (
    Weighed,
    allowed,
)


def left_of(rig: Rig, weighed: Weighed) -> Left:
    """Return what a hypothesis leaves of every row."""
    scene = weighed.hypothesis.scene
    places = usable(rig.machine, scene)
    here = rig.predictor.over(scene.rows.subset(places))
    residual, good = rig.residual(here, weighed.settled.p, scene)
    residual = residual * rig.scale(scene)
    fine = good & np.isfinite(residual).all(axis=1)
    return Left.of(residual[fine], places[fine], allowed(rig, weighed.stand))


def length_of(rig: Rig, left: Left) -> float | None:
    """Return the rms of the 3-D error over all rows, mm; None where no length is read."""
    if not rig.long.any() or not len(left.residual):
        return None
    sigma = np.array([c.sigma for c in rig.machine.channels])
    points = {c.point for c in rig.machine.channels if c.unit == "mm"}
    mm = (left.residual * sigma)[:, rig.long]
    return float(np.sqrt(np.mean(np.sum(mm**2, axis=1)) / max(len(points), 1)))


def standing_out(rig: Rig, left: Left) -> Iterator[Found]:
    """Yield the rows that stand out of the rest."""
    says = row_words(rig.machine, rig.recording, left)
    if says:
        fix = "compare these rows with their source; mend them, or take them out"
        yield Found("rows-stand-out", ("rows",), says, fix, "suspect")
