"""The search for slips: hypotheses of the whole pair, one or several at once, weighed against the pair as it stands.

A pair that fits as it stands, within its tolerances, is right: nothing is looked for. Otherwise every slip is ranked by a
quick fit of base and tool, the best are weighed in full (``weighing``), and where none is enough, others are tried on top.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.identification.leaves.check.classes import shares, undone
from truepose.identification.leaves.check.kinds.axes import mirrored, targets, turned
from truepose.identification.leaves.check.kinds.frames import frames_swapped
from truepose.identification.leaves.check.kinds.joints import (
    end_zeros,
    exchanged,
    mirrored_zeros,
    quarter_turns,
    signs,
    zeros,
)
from truepose.identification.leaves.check.kinds.order import matched, shifted
from truepose.identification.leaves.check.kinds.poses import poses
from truepose.identification.leaves.check.kinds.readings import counts, coupled
from truepose.identification.leaves.check.kinds.runs import clocks, stands_still
from truepose.identification.leaves.check.kinds.table import conventions, exchanged_rows
from truepose.identification.leaves.check.kinds.units import units
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.rig import Rig, Scene
from truepose.identification.leaves.check.sessions import moved
from truepose.identification.leaves.check.slip import Slip
from truepose.identification.leaves.check.weighing import (
    CERTAIN,
    NOWHERE_ELSE,
    Hypothesis,
    Weighed,
    best_of,
    bound,
    is_right,
    ways,
    weigh,
)
from truepose.models.machine.machine import FRAMES

_DEEPEST, _WEIGHED, _MOST = 2, 6, 300
"""Most slips at once, hypotheses weighed in full at each depth, and quick fits at each depth beyond the first."""
Makers = tuple[Callable[[Rig, Scene], Iterable[Slip]], ...]
QUICK: Makers = (
    units,
    signs,
    exchanged,
    quarter_turns,
    coupled,
    mirrored,
    turned,
    targets,
    poses,
    shifted,
    frames_swapped,
)
SLOW: Makers = (
    conventions,
    matched,
    clocks,
    stands_still,
    mirrored_zeros,
    counts,
    zeros,
    end_zeros,
    exchanged_rows,
)


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


__all__ = ["Search", "search", "still_columns"]
