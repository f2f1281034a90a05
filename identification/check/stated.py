"""Base and tool against what the file says of them, once the rest of it fits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truepose.identification.check.drawing import expected, priced
from truepose.identification.check.judging import LIKELY, QUIET, SURE, shown
from truepose.identification.check.kinds.axes import targets, turned
from truepose.identification.check.kinds.frames import frame_unknown, frames_swapped
from truepose.identification.check.kinds.joints import end_zeros
from truepose.identification.check.kinds.units import file_lengths
from truepose.identification.check.result import Found, Verdict
from truepose.identification.check.rig import Rig, Scene, Stand
from truepose.identification.check.slip import Slip, Tried
from truepose.models.machine import FRAMES

_NEAREST = 3


def frames_off(rig: Rig, scene: Scene, stand: Stand) -> list[Found]:
    """Base and tool, where readings put them elsewhere than the file does; ``stand``: with both wherever they fit best."""
    noise = max(priced(rig, stand, 1.0), 1.0)
    free = priced(rig, stand, noise)
    held = rig.stand(scene, ())
    if _exact(rig) and held.misfit <= SURE * max(expected(rig, stand), stand.misfit):
        return []  # the drawing's own errors may look like a frame that is said to be exact
    cost = min(priced(rig, start, noise, ()) for start in (held, replace(held, p=scene.p)))
    if not np.isfinite(free) or cost < LIKELY * free or cost < QUIET:
        return []
    before, after, unit = shown(held, stand)
    sure: Verdict = "wrong" if cost >= SURE * free else "suspect"
    good = [t for t in _explained(rig, scene, noise) if cost >= SURE * t.price and t.price <= 2.0 * free]
    slips = [min(good, key=lambda t: (t.slip.searched, t.price)).slip] if good else []
    slips = slips or _unknown(rig, scene, stand, noise, max(1.5 * free, cost / 10))
    return [Found(s.kind, s.where, s.says, s.fix, sure, before, after, unit, s.mend) for s in slips]


def _exact(rig: Rig) -> bool:
    """Whether every frame is either exactly known or anywhere."""
    tolerance = rig.tolerance[np.concatenate([rig.at[frame] for frame in FRAMES])]
    return bool(np.all((tolerance == 0.0) | np.isinf(tolerance)))


def _explained(rig: Rig, scene: Scene, noise: float) -> list[Tried]:
    """Slips that put base and tool where the file says: frames or targets exchanged, axes turned, a zero of an end joint, the
    file's lengths in another unit; priced."""
    tried = [
        Tried(slip, slip.change(scene), rig.stand(slip.change(scene), quick=True))
        for maker in (turned, end_zeros, targets, file_lengths)
        for slip in maker(rig, scene)
    ]
    near = sorted(tried, key=lambda t: rig.away(t.stand.p, t.scene.p))[:_NEAREST]
    near += [Tried(slip, slip.change(scene), rig.stand(scene)) for slip in frames_swapped(rig, scene)]
    held = [replace(t, stand=rig.stand(t.scene, ())) for t in near]
    return [replace(t, price=priced(rig, t.stand, noise, ())) for t in held]


def _unknown(rig: Rig, scene: Scene, stand: Stand, noise: float, enough: float) -> list[Slip]:
    """The fewest frames that must be free to fit."""
    for frames in (("base",), ("tool",)):
        one = rig.stand(scene, frames)
        if priced(rig, one, noise, frames) <= enough:
            return [frame_unknown(rig, frames[0], one.p)]
    return [frame_unknown(rig, frame, stand.p) for frame in FRAMES]


__all__ = ["frames_off"]
