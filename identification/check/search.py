"""The search for slips: each is judged by the same cheap fit, the best by what it costs in tolerances, too.

A file is taken as right unless a slip makes the misfit several times smaller. The misfit counts readings and departures from
the drawing alike (``drawing.priced``), so that constants bent by a thousand tolerances are no fit. One slip may hide another:
what was found is mended, and the search goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.identification.check.drawing import expected, priced
from truepose.identification.check.kinds.axes import mirrored, targets, turned
from truepose.identification.check.kinds.frames import frame_unknown, frames_swapped
from truepose.identification.check.kinds.joints import end_zeros, exchanged, quarter_turns, signs, zeros
from truepose.identification.check.kinds.order import matched, shifted
from truepose.identification.check.kinds.poses import poses
from truepose.identification.check.kinds.table import conventions
from truepose.identification.check.kinds.units import units
from truepose.identification.check.result import Found, Verdict
from truepose.identification.check.rig import ABSURD, Rig, Scene, Stand, motion
from truepose.identification.check.sessions import moved
from truepose.identification.check.slip import Slip
from truepose.models.machine import FRAMES
from truepose.wording import joined

SURE, LIKELY = 3.0, 1.7
"""How many times better than as it stands a slip must fit to be certain, or to be worth a word."""
QUIET = 2.5
"""Misfit, in sigmas, below which nothing is looked for: the file fits."""
ALIKE = 1.15
"""Slips that fit within this factor of the best one fit as well."""
_DEEPEST, _POLISHED, _MOST = 3, 8, 300
QUICK = (units, signs, end_zeros, exchanged, quarter_turns, conventions, mirrored, targets, poses, shifted)
SLOW = (turned, zeros)


@dataclass(frozen=True)
class Tried:
    """A slip with the fit of frames under it."""

    slip: Slip
    scene: Scene
    stand: Stand
    price: float = float("inf")


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
    noise = max(priced(rig, stand, 1.0), 1.0)
    price = priced(rig, stand, noise)
    mixed = list(moved(rig, scene, stand, price))
    if mixed:
        return Search(tuple(mixed), scene, stand, price)
    found: list[Found] = []
    while len(found) < _DEEPEST and price > QUIET:
        chosen = _best(rig, scene, stand, price)
        if not chosen:
            break
        best, others = chosen[0], chosen[1:]
        found.append(_as_found(rig, best, others, stand, price))
        scene, stand, price = best.scene, best.stand, best.price
    if not found and _absurd(rig, stand):
        found.append(_unexplained(rig, stand))
    rig.scene = scene
    frames = _frames(rig, scene, stand)
    return Search((*found, *frames), scene, stand, price)


def _best(rig: Rig, scene: Scene, stand: Stand, price: float) -> list[Tried]:
    """The best slip of a scene and those as good, if it explains enough; quick kinds first."""
    tried: list[Tried] = []
    good: list[Tried] = []
    thorough = price > SURE and _off(rig, stand) and not rig.still
    for makers in ((matched,), QUICK, SLOW) if thorough else (QUICK,):
        tried += _tried(rig, scene, makers)
        good = _polished(rig, tried, stand, price)
        if good and price / good[0].price >= SURE:
            return good
    if good or not thorough:
        return good
    return _two(rig, tried, stand, price)


def _tried(rig: Rig, scene: Scene, makers: Iterable[Callable[[Rig, Scene], Iterable[Slip]]]) -> list[Tried]:
    out = []
    for maker in makers:
        for slip in maker(rig, scene):
            there = slip.change(scene)
            out.append(Tried(slip, there, rig.stand(there, quick=True)))
    return out


def _polished(rig: Rig, tried: Sequence[Tried], stand: Stand, price: float) -> list[Tried]:
    """Those that fit best, priced; the best first, with those as good; none where it explains too little."""
    order = sorted((t for t in tried if t.stand.misfit < stand.misfit), key=lambda t: t.stand.misfit)[
        :_POLISHED
    ]
    order = [replace(t, stand=rig.stand(t.scene)) for t in order]
    if not order:
        return []
    noise = max(min(priced(rig, t.stand, 1.0) for t in order), 1.0)
    dear = [replace(t, price=priced(rig, t.stand, noise)) for t in order]
    best = min(t.price for t in dear)
    here = priced(rig, stand, noise)
    if not here / best >= LIKELY:
        return []
    alike = [t for t in dear if t.price <= ALIKE * best]
    plain = min(t.slip.cost for t in alike)
    return sorted(alike, key=lambda t: (t.slip.cost > plain, _stated(rig, t, noise)))


def _stated(rig: Rig, tried: Tried, noise: float) -> float:
    """Misfit with the frames as the file states them, coarsely: it decides between slips that fit alike."""
    held = rig.stand(tried.scene, ())
    cost = priced(rig, held, noise, ())
    return float("inf") if not np.isfinite(cost) else round(float(np.log(max(cost, 1e-12))) / np.log(1.5))


def _two(rig: Rig, tried: Sequence[Tried], stand: Stand, price: float) -> list[Tried]:
    """Two slips at once, where neither shows alone: the quick kinds on top of those that helped most."""
    if not _absurd(rig, stand):
        return []
    most = max(_MOST // max(len(tried), 1), 1)
    order = sorted((t for t in tried if not t.stand.bad), key=lambda t: t.stand.misfit)[:most]
    best: list[Tried] = []
    for first in order:
        second = _polished(rig, _tried(rig, first.scene, QUICK), stand, price)
        if second and price / second[0].price >= SURE and (not best or second[0].price < best[0].price):
            best = [_joined(first, t) for t in second]
    return best


def _joined(first: Tried, second: Tried) -> Tried:
    a, b = first.slip, second.slip
    both = Slip(
        a.kind,
        tuple(dict.fromkeys((*a.where, *b.where))),
        f"{a.says}, and {b.says}",
        f"{a.fix}; {b.fix}",
        lambda scene: b.change(a.change(scene)),
        lambda pair: b.mend(a.mend(pair)),
    )
    return replace(second, slip=both)


def _as_found(rig: Rig, best: Tried, others: Sequence[Tried], stand: Stand, price: float) -> Found:
    before, after, unit = shown(stand, best.stand)
    better = price / best.price
    verdict: Verdict = "wrong" if better >= SURE and best.slip.cost <= better else "suspect"
    slip = best.slip
    instead = tuple(dict.fromkeys(f"{t.slip.kind}: {t.slip.says}" for t in others))[:5]
    return Found(slip.kind, slip.where, slip.says, slip.fix, verdict, before, after, unit, slip.mend, instead)


def shown(before: Stand, after: Stand) -> tuple[float | None, float | None, str]:
    """Two misfits in a unit that users know: mm of the position where there is one, else sigmas."""
    if before.length is not None and after.length is not None:
        return before.length, after.length, "mm"
    return before.misfit, after.misfit, "sigma"


def _off(rig: Rig, stand: Stand) -> bool:
    """Whether a misfit is more than the tolerances let one expect: then no search is too long."""
    known = any(p.free for p in rig.machine.mechanism.parameters)
    least = 2.0 * expected(rig, stand) if known else ABSURD * motion(rig, stand)
    return stand.bad or stand.misfit > least


def _absurd(rig: Rig, stand: Stand) -> bool:
    """Whether a misfit is beyond what tolerances explain, and beyond what any drawing is wrong by."""
    if stand.bad:
        return True
    return bool(stand.misfit > 10.0 * expected(rig, stand) and stand.misfit > ABSURD * motion(rig, stand))


def _unexplained(rig: Rig, stand: Stand) -> Found:
    """A misfit that no slip explains; where a joint is said never to move, that may be it."""
    size = f"{stand.length:.3g} mm" if stand.length is not None else f"{stand.misfit:.3g} sigma"
    before, _, unit = shown(stand, stand)
    misses = f"with base and tool fitted, the drawn machine misses the readings by {size}"
    if rig.still:
        names = joined(rig.still)
        return Found(
            "joint-never-moves",
            rig.still,
            f"{names} never moves in the recording, and {misses}: it may have moved without being logged",
            f"record {names}",
            "wrong",
            before,
            unit=unit,
        )
    return Found(
        "unexplained",
        (),
        f"{misses}, and no slip that was tried explains it",
        "compare the table of constants, the order of joints and the rows with their source",
        "wrong",
        before,
        unit=unit,
    )


def _frames(rig: Rig, scene: Scene, stand: Stand) -> list[Found]:
    """Base and tool, where readings put them elsewhere than the file does."""
    noise = max(priced(rig, stand, 1.0), 1.0)
    free = priced(rig, stand, noise)
    held = rig.stand(scene, ())
    cost = priced(rig, held, noise, ())
    if not np.isfinite(free) or cost / free < LIKELY or cost < QUIET:
        return []
    tried = [
        Tried(slip, slip.change(scene), rig.stand(slip.change(scene), ()))
        for maker in (frames_swapped, turned, end_zeros)
        for slip in maker(rig, scene)
    ]
    dear = [replace(t, price=priced(rig, t.stand, noise, ())) for t in tried]
    before, after, unit = shown(held, stand)
    sure: Verdict = "wrong" if cost / free >= SURE else "suspect"
    good = [t for t in dear if cost / t.price >= SURE and t.price <= 2.0 * free]
    if good:
        slip = min(good, key=lambda t: (t.slip.cost > 1.0, t.price)).slip
        return [Found(slip.kind, slip.where, slip.says, slip.fix, sure, before, after, unit, slip.mend)]
    for frames in (("base",), ("tool",), FRAMES):
        one = rig.stand(scene, frames)
        if priced(rig, one, noise, frames) <= max(1.5 * free, cost / 10) or frames == FRAMES:
            p = one.p if frames != FRAMES else stand.p
            slips = [frame_unknown(rig, (f,), p) for f in frames]
            return [Found(s.kind, s.where, s.says, s.fix, sure, before, after, unit, s.mend) for s in slips]
    return []


__all__ = ["LIKELY", "SURE", "Search", "search", "shown"]
