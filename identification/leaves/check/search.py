"""The search for slips: hypotheses of the whole pair, one or several at once, weighed against the pair as it stands.

A pair that fits as it stands, within its tolerances, is right: nothing is looked for. Otherwise every slip is ranked by a
quick fit of base and tool, the best are weighed in full (``weighing``), and where none is enough, others are tried on top.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.check.alignment import Frames
from truepose.identification.leaves.check.kinds import frames, joints, order, poses, units
from truepose.identification.leaves.check.pair import SELDOM, Pair, Scene, Sheet, Slip, Stand
from truepose.identification.leaves.check.result import Found, Verdict
from truepose.identification.leaves.check.rig import ABSURD, Rig, motion
from truepose.identification.leaves.check.weighing import (
    CERTAIN,
    NOWHERE_ELSE,
    Hypothesis,
    Weighed,
    best_of,
    bound,
    evidence,
    fits_better,
    is_right,
    settle,
    ways,
    weigh,
)
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import FRAMES
from truepose.models.machine.mechanism import AXES
from truepose.models.units import convert

# -- Which hypotheses say the same of a machine, how probable each such class is, and which frames would undo one

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
    order = {id(w): (not w.near, len(w.free), -w.score) for w in every}
    told = [
        (sorted(members, key=lambda w: order[id(w)]), sum(weight[id(w)] for w in members) / total)
        for members in classes
    ]
    return sorted(told, key=lambda each: -each[1])


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


# -- Rows of two set-ups in one recording: base or tool stood elsewhere from some row on

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
    residual, good = rig.residual(here, p, scene)
    return np.asarray(np.nan_to_num(np.sum(residual**2, axis=1)) * good)


def _two_setups(rig: Rig, scene: Scene, cut: _Cut, verdict: Verdict, before: float | None) -> Found:
    """What is said of a recording whose rows from a cut on are another set-up; misfits before and after, mm."""
    row = scene.rows.where(min(cut.row, len(scene.rows) - 1))
    lengths = [part.length for part in (cut.before, cut.after) if part.length is not None]

    def mended(pair: Pair) -> Pair:
        return pair if len(pair.sheets) != 1 else pair.each(lambda sheet: _with_session(sheet, cut.row))

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


_DEEPEST, _WEIGHED, _MOST = 2, 6, 300
"""Most slips at once, hypotheses weighed in full at each depth, and quick fits at each depth beyond the first."""
# -- The search for slips: hypotheses of the whole pair, one or several at once, weighed against the pair as it stands

Makers = tuple[Callable[[Rig, Scene], Iterable[Slip]], ...]
QUICK: Makers = (
    units.units, joints.signs, joints.exchanged, joints.quarter_turns, joints.coupled, poses.mirrored, poses.turned,
    poses.targets, poses.poses, order.shifted, frames.frames_swapped,
)  # fmt: skip
SLOW: Makers = (
    frames.conventions, order.matched, order.clocks, order.stands_still, joints.mirrored_zeros, joints.counts,
    joints.zeros, joints.end_zeros, frames.exchanged_rows,
)  # fmt: skip


@dataclass(frozen=True)
class Search:
    """The pair as it stands, and the classes of hypotheses that lead, each with its probability; none where all is well."""

    as_it_stands: Weighed
    leads: tuple[tuple[tuple[Weighed, ...], float], ...] = ()
    mixed: tuple[Found, ...] = ()
    """Two set-ups in one recording, where no slip is certain."""

    @property
    def best(self) -> Weighed:
        """What is most likely: the pair as it stands, or the first of those that lead if it is certain."""
        advised = self.advised
        return self.as_it_stands if advised is None else advised[0]

    @property
    def advised(self) -> tuple[Weighed, ...] | None:
        """The hypotheses that a mend is advised from: of one class, certain, with nothing left to explain."""
        if not self.leads:
            return None
        members, share = self.leads[0]
        return members if share >= CERTAIN and members[0].near else None


def search(rig: Rig, as_it_stands: Weighed) -> Search:
    """Return what may be wrong between one machine and its recording, which was weighed as it stands."""
    if is_right(rig, as_it_stands) or still_columns(rig):
        return Search(as_it_stands)
    every = [as_it_stands, weigh(rig, as_it_stands.hypothesis)]
    beam = [as_it_stands.hypothesis]
    for depth in range(_deepest(rig, as_it_stands)):
        for makers in (QUICK, SLOW) if depth == 0 else (QUICK,):
            ranked = _ranked(rig, list(_extended(rig, beam, makers, depth)))
            every += [weigh(rig, hypothesis) for hypothesis in ranked[:_WEIGHED]]
        again = weigh(rig, as_it_stands.hypothesis, NOWHERE_ELSE, undone(rig, best_of(every)))
        if is_right(rig, again):
            return Search(again)
        mixed = tuple(moved(rig, as_it_stands)) if depth == 0 and not _enough(rig, every) else ()
        if mixed:
            return Search(as_it_stands, mixed=mixed)
        if any(w.near and w.plain for w in every):
            break
        order = sorted(every, key=lambda w: -w.score)
        beam = [w.hypothesis for w in order if len(w.hypothesis.slips) == depth + 1]
    as_it_stands = best_of([as_it_stands, again])
    every += [again, weigh(rig, as_it_stands.hypothesis, None, undone(rig, best_of(every)))]
    classes = shares(rig, every)
    return Search(as_it_stands, tuple((tuple(members), share) for members, share in classes))


def still_columns(rig: Rig) -> tuple[str, ...]:
    """Return the columns that read the same in every row: any slip that takes their motion away would fit them."""
    read = rig.recording.observations
    columns = [name for sensor in rig.machine.sensors for name in sensor.columns if name in read]
    return tuple(name for name in columns if len(read[name]) > 1 and np.ptp(read[name]) == 0.0)


def _deepest(rig: Rig, as_it_stands: Weighed) -> int:
    """Return how many slips are tried at once: one where constants outnumber what was read, as any two would fit."""
    known = np.count_nonzero(np.isfinite(rig.tolerance) & (rig.tolerance > 0))
    return _DEEPEST if as_it_stands.stand.bad or as_it_stands.stand.residual.size >= known else 1


def _extended(rig: Rig, beam: Sequence[Hypothesis], makers: Makers, depth: int) -> Iterator[Hypothesis]:
    """Yield every hypothesis of a beam with one slip more; beyond the first depth, as many as there is time for."""
    seen: set[frozenset[tuple[str, str]]] = set()
    count = 0
    for hypothesis in beam:
        made = {(s.kind, s.where) for s in hypothesis.slips}
        for maker in makers:
            for slip in maker(rig, hypothesis.scene):
                key = frozenset((s.says, s.fix) for s in (*hypothesis.slips, slip))
                if (slip.kind, slip.where) in made or key in seen:
                    continue
                seen.add(key)
                count += 1
                if depth and count > _MOST:
                    return
                yield hypothesis.with_slip(slip)


def _ranked(rig: Rig, tried: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Return hypotheses by the evidence of a quick fit: of frames where the file has them, and wherever they fit best."""

    odds = ways(rig)
    anywhere = max((o for way, o in odds.items() if way), default=1.0)

    def score(hypothesis: Hypothesis) -> float:
        scene = hypothesis.scene
        scores = [bound(rig, rig.stand(scene, FRAMES, quick=True), FRAMES, hypothesis.odds * anywhere)]
        if len(odds) > 1:
            scores.append(bound(rig, rig.stand(scene, (), quick=True), (), hypothesis.odds))
        return max(scores)

    return sorted(tried, key=score, reverse=True)


def _enough(rig: Rig, every: Sequence[Weighed]) -> bool:
    """Whether one class of hypotheses is certain, and leaves nothing to explain."""
    top = best_of(every)
    if not (top.near and top.plain):
        return False
    members, share = shares(rig, every)[0]
    return share >= CERTAIN and members[0].near
