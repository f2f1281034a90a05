"""Rows of two set-ups in one recording: base or tool stood elsewhere from some row on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.drawing import settle
from truepose.identification.leaves.check.pair import Pair, Sheet
from truepose.identification.leaves.check.result import Found, Verdict
from truepose.identification.leaves.check.rig import ABSURD, Rig, Scene, Stand, motion
from truepose.identification.leaves.check.slip import SELDOM
from truepose.identification.leaves.check.weighing import CERTAIN, Weighed, evidence
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.machine.machine import FRAMES
from truepose.models.machine.mechanism import AXES
from truepose.models.units import convert

Array = NDArray[np.float64]
_PARTS = 8
_TELL = "give each set-up its own number in a column 'session', or calibrate them one by one"
_STATE = "if base or tool were set up anew, say so in the machine file: 'per: session' in frames.base, or in frames.tool"
_FEWEST, _ROUNDS = 8, 4
_NEAR = 2
"""Rows by which the best cut may miss the row at which a session begins."""
_APART = 0.5
"""How much better one frame alone must explain the second set-up than the other one to be named."""


@dataclass(frozen=True)
class _Cut:
    """The rows before and after a cut, each fitted by itself."""

    row: int
    before: Stand
    after: Stand

    @property
    def misfit(self) -> float:
        """That of the worse part, in sigmas."""
        return max(self.before.misfit, self.after.misfit)


def moved(rig: Rig, weighed: Weighed) -> Iterator[Found]:
    """Yield a change of set-up, where two parts of the rows fit several times better each by itself."""
    scene, stand = rig.scene, weighed.stand
    if stand.bad or scene.rows.from_row is not None or weighed.near:
        return
    cut = _best_cut(rig, scene)
    if cut is None:
        return
    sides = [settle(rig, part, FRAMES) for part in (cut.before, cut.after)]
    whole = evidence(rig, scene, settle(rig, rig.stand(scene), FRAMES).price, 1.0)
    apart = evidence(rig, scene, max(side.price for side in sides), SELDOM)
    if not apart - whole > np.log(CERTAIN / (1.0 - CERTAIN)):
        return
    known = any(abs(cut.row - edge) <= _NEAR for edge in _edges(scene))
    small = stand.misfit < ABSURD * motion(rig, stand)
    if known and small:
        return  # a mount that moved a little between sessions is physics, with a name of its own
    found = _two_setups(rig, scene, cut, "suspect" if known or small else "wrong", stand.length)
    yield replace(found, fix=_STATE if known else _TELL)


def _best_cut(rig: Rig, scene: Scene) -> _Cut | None:
    """Return where two parts fit best: coarsely, then at the very row."""
    cuts = _cuts(scene)
    if not cuts:
        return None
    tried = {row: _apart(rig, scene, row) for row in cuts}
    cut = min(tried.values(), key=lambda cut: cut.misfit)
    for _ in range(_ROUNDS):
        row = _between(rig, scene, cut)
        if row == cut.row:
            break
        cut = _apart(rig, scene, row)
    return cut


def _between(rig: Rig, scene: Scene, cut: _Cut) -> int:
    """Return the row at which the rows before fit the one part, and the rows from there on the other, best of all."""
    here = rig.predictor.over(scene.rows)
    before, after = (_sizes(rig, here, part.p, scene) for part in (cut.before, cut.after))
    gained = np.concatenate([[0.0], np.cumsum(np.where(scene.rows.validation, 0.0, before - after))])
    allowed = slice(_FEWEST, len(scene.rows) - _FEWEST + 1)
    return _FEWEST + int(np.argmin(gained[allowed]))


def _sizes(rig: Rig, here: Predictor, p: Array, scene: Scene) -> Array:
    """(n,) squared misfits of rows with constants p (np,); 0 where nothing is read."""
    x, good = rig.assembled(here, p, scene)
    residual = np.concatenate([block.residual for block in here.blocks(p, x)])
    return np.asarray(np.nan_to_num(np.sum(residual**2, axis=1)) * good)


def _two_setups(rig: Rig, scene: Scene, cut: _Cut, verdict: Verdict, before: float | None) -> Found:
    """What is said of a recording whose rows from a cut on are another set-up; misfits before and after, mm."""
    row = scene.rows.where(min(cut.row, len(scene.rows) - 1))
    lengths = [part.length for part in (cut.before, cut.after) if part.length is not None]

    def mended(pair: Pair) -> Pair:
        if len(pair.sheets) != 1:
            return pair
        return replace(pair, sheets=tuple(_with_session(s, cut.row) for s in pair.sheets))

    return Found(
        "sessions-mixed",
        ("session",),
        f"two set-ups in one recording, the second from {row} on: {_what_moved(rig, scene, cut)}",
        _TELL,
        verdict,
        before,
        max(lengths) if lengths else None,
        "mm",
        mended,
    )


def _what_moved(rig: Rig, scene: Scene, cut: _Cut) -> str:
    """Which frame explains the rows behind the cut, the other one held where it stood before, and by how much it moved."""
    there = replace(cut.after.scene, p=settle(rig, cut.before, FRAMES).p)
    alone = {
        frame: rig.stand(there, (frame,), held=tuple(f for f in FRAMES if f != frame)) for frame in FRAMES
    }
    order = sorted(FRAMES, key=lambda frame: alone[frame].misfit)
    if not alone[order[0]].misfit < _APART * alone[order[1]].misfit:
        return "base or tool stands elsewhere"
    frame = order[0]
    return f"the {frame} stands elsewhere, by {_shift(rig, frame, there.p, alone[frame].p)}"


def _shift(rig: Rig, frame: str, old: Array, new: Array) -> str:
    """How a frame moved, along the axes that the file states it in: ``z +12 mm``, and by which angle it turned."""
    k, units = FRAMES.index(frame), rig.machine.units
    here, there = rig.frames_of(old)[k], rig.frames_of(new)[k]
    away = there[:3, 3] - here[:3, 3]
    largest = float(np.max(np.abs(away)))
    told = [
        f"{frame} {axis} {convert(float(v), 'mm', units.length):+.3g} {units.length}"
        for axis, v in zip(AXES, away, strict=False)
        if abs(v) > 0.2 * largest
    ]
    angle = float(np.degrees(np.linalg.norm(lie.log_so3(here[:3, :3].T @ there[:3, :3]))))
    return ", ".join([*told, *([f"turned by {angle:.2g} deg"] if angle > 0.05 else [])])


def _cuts(scene: Scene) -> list[int]:
    n = len(scene.rows)
    even = np.linspace(0, n, _PARTS + 1).round().astype(int)[1:-1]
    return sorted({int(c) for c in (*_edges(scene), *even) if _FEWEST <= c <= n - _FEWEST})


def _edges(scene: Scene) -> list[int]:
    """Rows at which another file or another recorded session begins."""
    return (np.flatnonzero(np.diff(scene.rows.source_file) | np.diff(scene.rows.session)) + 1).tolist()


def _apart(rig: Rig, scene: Scene, row: int) -> _Cut:
    """Return the rows before and after a cut, each fitted by itself."""
    parts = []
    for mine in (slice(0, row), slice(row, None)):
        lost = np.ones(len(scene.rows), dtype=bool)
        lost[mine] = False
        parts.append(rig.stand(replace(scene, lost=lost)))
    return _Cut(row, *parts)


def _with_session(sheet: Sheet, cut: int) -> Sheet:
    cells = sheet.cells.copy()
    cells["session"] = ["1"] * cut + ["2"] * (len(cells) - cut)
    return replace(sheet, cells=cells, units={**sheet.units, "session": None})


__all__ = ["moved"]
