"""Which hypotheses say the same of a machine, how probable each such class is, and which frames would undo one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.alignment import Frames
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.weighing import Weighed, fits_better, is_right
from truepose.identification.recording.recording import Recording

Array = NDArray[np.float64]
_SAME = 1e-9
"""mm, rad, or a share: readings that differ by less are the same."""
_TURNS = (7, 11, 13, 17, 19, 23, 29, 31)


def shares(rig: Rig, every: Sequence[Weighed]) -> list[tuple[list[Weighed], float]]:
    """Return classes of hypotheses that predict alike, each with its probability, the likeliest first.

    Of a class, those come first that leave no more than drawing and sigma, and frames where the file has them.
    """
    if not every:
        return []
    top = max(w.score for w in every)
    weight = {id(w): float(np.exp(w.score - top)) for w in every}
    classes: list[list[Weighed]] = []
    needed = [w for w in every if not any(_enough_without(rig, w, other) for other in every)]
    for one in sorted(needed, key=lambda w: -w.score):
        mine = next((c for c in classes if weight[id(one)] > 1e-4 and _alike(rig, c[0], one)), None)
        if mine is None:
            classes.append([one])
        else:
            mine.append(one)
    total = sum(weight[id(w)] for w in needed)
    told = [(sorted(members, key=_order), sum(weight[id(w)] for w in members) / total) for members in classes]
    return sorted(told, key=lambda each: -each[1])


def _order(weighed: Weighed) -> tuple[bool, int, float]:
    return not weighed.near, len(weighed.free), -weighed.score


def _told(weighed: Weighed) -> set[str]:
    """Return what a hypothesis says is not as the files have it: its slips, and frames elsewhere."""
    return {slip.fix for slip in weighed.hypothesis.slips} | set(weighed.free)


def _enough_without(rig: Rig, more: Weighed, fewer: Weighed) -> bool:
    """Whether a hypothesis says more than another that is enough or meets the readings as well: the rest is not needed."""
    return _told(fewer) < _told(more) and (is_right(rig, fewer) or not fits_better(rig, more, fewer))


def _alike(rig: Rig, one: Weighed, other: Weighed) -> bool:
    """Whether two hypotheses say the same of poses that were not recorded: joints as read, each column turned by itself."""
    a, b = one.stand.scene.rows.observations, other.stand.scene.rows.observations
    if not all(np.allclose(a[name], b[name], rtol=_SAME, atol=_SAME, equal_nan=True) for name in a):
        return False
    slips = (*one.hypothesis.slips, *other.hypothesis.slips)
    if one.stand.bad or other.stand.bad or any(slip.between for slip in slips):
        return False
    q = rig.recording.q[one.stand.rows]
    turned = np.column_stack([np.roll(q[:, k], _TURNS[k % len(_TURNS)] * (k + 1)) for k in range(q.shape[1])])
    seen = [_predicted(rig, w, turned) for w in (one, other)]
    apart = np.linalg.norm(seen[0][:, :3, 3] - seen[1][:, :3, 3], axis=1)
    limits = [w.stand.length for w in (one, other)]
    near = max(*(v or 0.0 for v in limits), 1e-6 * max(1.0, float(np.ptp(seen[0][:, :3, 3]))))
    return bool(np.median(apart) <= 2.0 * near)


def _predicted(rig: Rig, weighed: Weighed, q: Array) -> Array:
    """(n, 4, 4) poses of the tool at joints (n, nq) as they would have been recorded."""
    rows = rig.recording.subset(weighed.stand.rows)
    scene = replace(rig.scene, rows=replace(rows, q=q))
    for slip in weighed.hypothesis.slips:
        scene = slip.change(scene)
    return _poses(rig, weighed, scene.rows)


def _poses(rig: Rig, weighed: Weighed, rows: Recording) -> Array:
    here, p = rig.predictor.over(rows), weighed.settled.p
    x, _ = rig.assembled(here, p, weighed.stand.scene)
    return here.poses(p, x)[0]


def undone(rig: Rig, weighed: Weighed) -> list[Frames]:
    """Return frames that would undo a hypothesis, if frames can: those that bring the machine as it stands to its poses."""
    if weighed.stand.bad:
        return []
    rows = weighed.stand.rows
    return list(rig.frames_for(rows, _poses(rig, weighed, weighed.hypothesis.scene.rows.subset(rows))))


__all__ = ["shares", "undone"]
