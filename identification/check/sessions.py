"""Rows of two set-ups in one recording: the base (or the tool) stood elsewhere from some row on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.check.drawing import expected
from truepose.identification.check.pair import Pair, Sheet
from truepose.identification.check.result import Found, Verdict
from truepose.identification.check.rig import ABSURD, Rig, Scene, Stand, motion

Array = NDArray[np.float64]
_PARTS = 8
_TELL = "give each set-up its own number in a column 'session', or calibrate them one by one"
_STATE = "if base or tool were set up anew, say so in the machine file: 'per: session' in frames.base, or in frames.tool"
_FEWEST = 8
_TIMES = 3.0


def moved(rig: Rig, scene: Scene, stand: Stand, price: float) -> Iterator[Found]:
    """A change of set-up, where two parts of the rows fit several times better each by itself."""
    if (
        price <= 2.0
        or stand.bad
        or scene.rows.from_row is not None
        or stand.misfit < 3.0 * expected(rig, stand)
    ):
        return
    cuts = _cuts(scene)
    sizes = {cut: _apart(rig, scene, cut) for cut in cuts}
    if not sizes:
        return
    best = min(sizes, key=lambda cut: sizes[cut][0])
    for _ in range(3):  # towards the very row
        step = max((max(cuts) - min(cuts)) // (2 * _PARTS), 1)
        near = [c for c in (best - step, best + step) if _FEWEST <= c <= len(scene.rows) - _FEWEST]
        sizes |= {cut: _apart(rig, scene, cut) for cut in near if cut not in sizes}
        best = min(sizes, key=lambda cut: sizes[cut][0])
        cuts = [best - step, best + step]
    size, length = sizes[best]
    if stand.misfit < _TIMES * size:
        return
    known = best in _edges(scene)
    if known and stand.misfit < ABSURD * motion(rig, stand):
        return  # a mount that moved a little between sessions is physics, with a name of its own
    yield _two_setups(scene, best, "suspect" if known else "wrong", stand.length, length)


def _two_setups(scene: Scene, cut: int, verdict: Verdict, before: float | None, after: float | None) -> Found:
    """What is said of a recording whose rows from ``cut`` on are another set-up; misfits before and after, mm."""
    row = scene.rows.where(min(cut, len(scene.rows) - 1))

    def mended(pair: Pair) -> Pair:
        if len(pair.sheets) != 1:
            return pair
        return replace(pair, sheets=tuple(_with_session(s, cut) for s in pair.sheets))

    return Found(
        "sessions-mixed",
        ("session",),
        f"two set-ups in one recording, the second from about {row} on",
        _STATE if verdict == "suspect" else _TELL,
        verdict,
        before,
        after,
        "mm",
        mended,
    )


def _cuts(scene: Scene) -> list[int]:
    n = len(scene.rows)
    edges = _edges(scene)
    even = np.linspace(0, n, _PARTS + 1).round().astype(int)[1:-1]
    return sorted({int(c) for c in (*edges, *even) if _FEWEST <= c <= n - _FEWEST})


def _edges(scene: Scene) -> list[int]:
    """Rows at which another file or another recorded session begins."""
    return (np.flatnonzero(np.diff(scene.rows.source_file) | np.diff(scene.rows.session)) + 1).tolist()


def _apart(rig: Rig, scene: Scene, cut: int) -> tuple[float, float | None]:
    """Misfit (and rms length) of the rows before and after a cut, each fitted by itself."""
    parts = []
    for mine in (slice(0, cut), slice(cut, None)):
        lost = np.ones(len(scene.rows), dtype=bool)
        lost[mine] = False
        parts.append(rig.stand(replace(scene, lost=lost)))
    lengths = [p.length for p in parts if p.length is not None]
    return max(p.misfit for p in parts), max(lengths) if lengths else None


def _with_session(sheet: Sheet, cut: int) -> Sheet:
    cells = sheet.cells.copy()
    cells["session"] = ["1"] * cut + ["2"] * (len(cells) - cut)
    return replace(sheet, cells=cells, units={**sheet.units, "session": None})


__all__ = ["moved"]
