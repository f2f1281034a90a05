"""The search for slips: each is judged by the same cheap fit, the best by what it costs in tolerances, too.

A file is taken as right unless a slip makes the misfit several times smaller. The misfit counts readings and departures from
the drawing alike (``drawing.priced``), so that constants bent by a thousand tolerances are no fit. One slip may hide another:
what was found is mended, and the search goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.identification.check.drawing import priced
from truepose.identification.check.judging import (
    LIKELY,
    QUIET,
    SURE,
    USUAL,
    hopeless,
    off,
    reach,
    shown,
    unexplained,
)
from truepose.identification.check.kinds.axes import mirrored, targets, turned
from truepose.identification.check.kinds.joints import exchanged, quarter_turns, signs, zeros
from truepose.identification.check.kinds.order import matched, shifted
from truepose.identification.check.kinds.poses import poses
from truepose.identification.check.kinds.table import conventions
from truepose.identification.check.kinds.units import units
from truepose.identification.check.result import Found, Verdict
from truepose.identification.check.rig import Rig, Scene, Stand
from truepose.identification.check.sessions import moved
from truepose.identification.check.slip import Slip, Tried
from truepose.identification.check.stated import frames_off

ALIKE = 1.15
"""Slips that fit within this factor of the best one fit as well."""
_DEEPEST, _POLISHED, _MOST = 3, 8, 300
_NEAR = 3.0
"""How many times worse than the best one a slip may fit to be priced at all."""
QUICK = (units, signs, exchanged, quarter_turns, conventions, mirrored, targets, poses, shifted)
SLOW = (turned, zeros)
Makers = Iterable[Callable[[Rig, Scene], Iterable[Slip]]]
Step = Sequence[Tried]
"""The best slip, then those that fit as well."""


@dataclass(frozen=True)
class Search:
    """What a search found, and the fit with it mended."""

    found: tuple[Found, ...]
    scene: Scene
    stand: Stand
    price: float


def search(rig: Rig) -> Search:
    """Slips of one machine and recording, from those that explain most."""
    scene, stand = rig.scene, rig.stand()
    price = priced(rig, stand, max(priced(rig, stand, 1.0), 1.0))
    mixed = list(moved(rig, scene, stand, price))
    if mixed:
        return Search(tuple(mixed), scene, stand, price)
    found: list[Found] = []
    while len(found) < _DEEPEST and price > QUIET:
        steps = _best(rig, scene, stand, price)
        if not steps:
            break
        for step in steps:
            found.append(_as_found(step, stand, price))
            scene, stand, price = step[0].scene, step[0].stand, step[0].price
    if not found and hopeless(rig, stand, price):
        found.append(unexplained(rig, stand))
    return Search((*found, *frames_off(rig, scene, stand)), scene, stand, price)


def _best(rig: Rig, scene: Scene, stand: Stand, price: float) -> list[Step]:
    """The slip that explains most, or two that do so together; none where too little is explained. Quick kinds first."""
    tried: list[Tried] = []
    good: Step = []
    thorough = price > SURE and off(rig, stand) and not rig.still
    for makers in ((matched,), QUICK, SLOW) if thorough else (QUICK,):
        tried += _tried(rig, scene, makers)
        good = _polished(rig, tried, stand)
        if good and price > SURE * good[0].price and not off(rig, good[0].stand):
            return [good]
    if good or not thorough:
        return [good] if good else []
    return _two(rig, tried, stand, price)


def _tried(rig: Rig, scene: Scene, makers: Makers) -> list[Tried]:
    out = []
    for maker in makers:
        for slip in maker(rig, scene):
            there = slip.change(scene)
            out.append(Tried(slip, there, rig.stand(there, quick=True)))
    return out


def _polished(rig: Rig, tried: Sequence[Tried], stand: Stand) -> Step:
    """Those that fit best, priced; the best first, with those as good; none where it explains too little."""
    better = sorted((t for t in tried if t.stand.misfit < stand.misfit), key=lambda t: t.stand.misfit)
    order = [replace(t, stand=rig.stand(t.scene)) for t in better[:_POLISHED]]
    if not order:
        return []
    least = min(t.stand.misfit for t in order)
    order = [t for t in order if t.stand.misfit <= _NEAR * least]
    noise = max(min(priced(rig, t.stand, 1.0) for t in order), 1.0)
    dear = [replace(t, price=priced(rig, t.stand, noise)) for t in order]
    best = min(t.price for t in dear)
    if not priced(rig, stand, noise) > LIKELY * best:
        return []
    alike = [t for t in dear if t.price <= ALIKE * best]
    return sorted(alike, key=lambda t: (t.slip.searched, _far(rig, t) + _odd(rig, t)))


def _far(rig: Rig, tried: Tried) -> float:
    """How far base and tool then stand from where the file has them, coarsely: it decides between slips that fit alike."""
    return round(float(np.log2(1.0 + rig.away(tried.stand.p, tried.scene.p))))


def _odd(rig: Rig, tried: Tried) -> int:
    """By how many octaves the machine is then larger or smaller than robots are: scale alone is not seen by readings."""
    size = reach(rig, tried.stand.p)
    return abs(round(float(np.log2(size / USUAL)))) if size > 0 else 0


def _two(rig: Rig, tried: Sequence[Tried], stand: Stand, price: float) -> list[Step]:
    """Two slips, where neither shows alone: the quick kinds on top of those that helped most."""
    if not hopeless(rig, stand, price):
        return []
    most = max(_MOST // max(len(tried), 1), 1)
    best: list[Step] = []
    for first in sorted((t for t in tried if not t.stand.bad), key=lambda t: t.stand.misfit)[:most]:
        second = _polished(rig, _tried(rig, first.scene, QUICK), stand)
        if second and price > SURE * second[0].price and (not best or second[0].price < best[1][0].price):
            best = [[replace(first, price=price / SURE)], second]
    return best


def _as_found(step: Step, stand: Stand, price: float) -> Found:
    best, others = step[0], step[1:]
    before, after, unit = shown(stand, best.stand)
    slip = best.slip
    verdict: Verdict = "wrong" if price > SURE * best.price else "suspect"
    instead = tuple(dict.fromkeys(f"{t.slip.kind}: {t.slip.says}" for t in others))[:5]
    return Found(slip.kind, slip.where, slip.says, slip.fix, verdict, before, after, unit, slip.mend, instead)


__all__ = ["Search", "search"]
