"""Which parameters move between sessions: forward selection by evidence, then every one on its own.

Candidates are each parameter alone, each frame or part of a sensor as a whole, and all of those together. One
is taken while the evidence for it outweighs that there are many; members of a group then stay only as far as
each is asked for. Where a frame or a sensor explains as much as a part of the mechanism, it goes first.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logsumexp

from truepose.identification.drift.forward import Accepted, select_forward
from truepose.identification.drift.movement_evidence import Solved, Stack, solve, weigh
from truepose.identification.drift.scales import Scales
from truepose.identification.fit.problem import Prior
from truepose.models.machine import FRAME_OF, Machine
from truepose.models.parameters import vector_of

Array = NDArray[np.float64]
ENOUGH = 3.0
"""Log odds at which a movement is believed (0.95), and within which two explanations are alike."""
NEARLY = 12.0
"""Log odds up to which an alternative to a movement is named."""
NEAR_NOISE = (0.7, 2.7)
"""Noise scales, in the likeliest one, that matter when one more parameter is weighed."""


@dataclass(frozen=True)
class Candidate:
    """Parameters (places among the free ones) that may move together; extrinsic: of frames and sensors."""

    name: str
    members: tuple[int, ...]
    extrinsic: bool


@dataclass(frozen=True)
class Selection:
    """What moves: accepted parameter to size q (steps); gain (n,) log Bayes factor of each parameter's movement,
    given the others; log_odds (n,) the same with prior odds.

    alike: parameters that would do nearly as well in the place of one, with the log odds against them; states
    on the grid; log_bayes_factor of all movements against none; extrinsic (n,): of a frame or a sensor.
    """

    accepted: Mapping[int, float]
    gain: Array
    log_odds: Array
    alike: Mapping[int, Mapping[int, float]]
    states: tuple[Solved, ...]
    log_bayes_factor: float
    extrinsic: NDArray[np.bool_]

    @property
    def best(self) -> Solved:
        """The likeliest grid point."""
        return max(self.states, key=lambda s: s.point.log_prior + s.log_evidence)

    @property
    def noise(self) -> float:
        """Noise scale, mean of its logarithm."""
        logs = np.array([s.point.log_prior + s.log_evidence for s in self.states])
        weight = np.exp(logs - logsumexp(logs))
        return float(np.exp(weight @ np.log([s.point.noise for s in self.states])))

    @property
    def probability(self) -> Array:
        """(n,) that each parameter moves."""
        return np.asarray(expit(self.log_odds))


def candidates_of(machine: Machine, prior: Prior) -> tuple[Candidate, ...]:
    """Groups first (frames, parts of sensors, all of them), then single parameters."""
    outside = {*FRAME_OF, *(p.name for sensor in machine.sensors for p in sensor.parameters)}
    names = [prior.names[k] for k in prior.free]
    groups: dict[str, list[int]] = {}
    for k, name in enumerate(names):
        if name in outside:
            groups.setdefault(vector_of(name), []).append(k)
    extrinsic = tuple(k for members in groups.values() for k in members)
    several = {name: tuple(members) for name, members in groups.items() if len(members) > 1}
    if len(groups) > 1:
        several["frames and sensors"] = extrinsic
    singles = [Candidate(name, (k,), k in extrinsic) for k, name in enumerate(names)]
    return (*(Candidate(name, members, True) for name, members in several.items()), *singles)


def select(
    stack: Stack,
    candidates: Sequence[Candidate],
    points: Sequence[Scales],
    progress: Callable[[str], None] = lambda _: None,
) -> Selection:
    """Forward selection, each step followed by deletion of what is no longer asked for."""
    odds = -np.log(len(candidates))

    def add(accepted: Accepted) -> Accepted:
        progress(f"weighing what moves ({len(accepted)} found)")
        states = [solve(stack, accepted, point) for point in points]
        left = [c for c in candidates if not set(c.members) <= set(accepted)]
        members = [tuple(k for k in c.members if k not in accepted) for c in left]
        weighed = weigh(stack, states, members)
        chosen = _first(left, weighed.gain + odds)
        if chosen is None:
            return accepted
        return accepted | dict.fromkeys(members[chosen], float(weighed.size[chosen]))

    def review(accepted: Accepted, added: bool) -> Accepted:
        return _pruned(stack, accepted, _near(points, stack, accepted)) if added else accepted

    return summed(stack, select_forward({}, add, review), candidates, points)


def _first(left: Sequence[Candidate], score: Array) -> int | None:
    """The best candidate that is good enough; one of frames and sensors when it is as good."""
    if not len(score) or float(np.max(score)) <= ENOUGH:
        return None
    alike = [k for k in range(len(left)) if score[k] > np.max(score) - ENOUGH]
    return max(alike, key=lambda k: (left[k].extrinsic, float(score[k])))


def _near(points: Sequence[Scales], stack: Stack, accepted: Mapping[int, float]) -> list[Scales]:
    """Points of the grid about the likeliest noise once ``accepted`` moves."""
    now = [solve(stack, accepted, point) for point in points]
    likeliest = max(now, key=lambda s: s.point.log_prior + s.log_evidence).point.noise
    low, high = (likeliest * share for share in NEAR_NOISE)
    return [point for point in points if low <= point.noise <= high]


def _pruned(stack: Stack, accepted: Mapping[int, float], points: Sequence[Scales]) -> dict[int, float]:
    """Every size set to its likeliest with the others given; what evidence speaks against is deleted."""
    kept = dict(accepted)
    while True:
        gains = {}
        for i in list(kept):
            others = {k: q for k, q in kept.items() if k != i}
            weighed = weigh(stack, [solve(stack, others, point) for point in points], [(i,)])
            gains[i] = float(weighed.gain[0])
            kept[i] = float(weighed.size[0]) or kept[i]
        worst = min(gains, key=lambda i: gains[i], default=None)
        if worst is None or gains[worst] > 0.0:
            return kept
        del kept[worst]


def summed(
    stack: Stack, accepted: Mapping[int, float], candidates: Sequence[Candidate], points: Sequence[Scales]
) -> Selection:
    """Evidence of each parameter's movement given the others, and what would do as well in its place."""
    n, odds = stack.jacobian.shape[2], -np.log(len(candidates))
    states = tuple(solve(stack, accepted, point) for point in points)
    still = [k for k in range(n) if k not in accepted]
    gain, log_odds = np.zeros(n), np.full(n, odds)
    gain[still] = weigh(stack, states, [(k,) for k in still]).gain
    alike: dict[int, dict[int, float]] = {}
    near = _near(points, stack, accepted)
    for i in accepted:
        others = {k: q for k, q in accepted.items() if k != i}
        found = weigh(
            stack, [solve(stack, others, point) for point in near], [(k,) for k in (i, *still)]
        ).gain
        gain[i] = found[0]
        away = {k: float(found[0] - g) for k, g in zip(still, found[1:], strict=True)}
        alike[i] = {
            k: a
            for k, a in sorted(away.items(), key=lambda item: item[1])
            if a < NEARLY and found[0] - a > ENOUGH
        }
        companions = [c for c in candidates if i in c.members and set(c.members) & set(others)]
        log_odds[i] = 0.0 if companions else odds
    nothing = [solve(stack, {}, point) for point in points]
    extrinsic = np.array([any(c.extrinsic for c in candidates if k in c.members) for k in range(n)])
    total = _total(states) - _total(nothing)
    return Selection(accepted, gain, gain + log_odds, alike, states, total, extrinsic)


def _total(states: Sequence[Solved]) -> float:
    return float(logsumexp([s.point.log_prior + s.log_evidence for s in states]))
