"""Find which parameters move between sessions: the posterior over sets of movements, and what would do in one's stead."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import expit

from truepose.arrays import Array, Mask
from truepose.identification.leaves.drift.movement_problem import (
    ENOUGH,
    NEARLY,
    Kinds,
    Stack,
    movement_problem,
)
from truepose.identification.posterior.marginal import log_gains
from truepose.identification.posterior.posterior import Posterior, mode, sample
from truepose.identification.posterior.spike_slab import Member, SpikeSlab
from truepose.identification.posterior.state import (
    LOUDER,
    Moments,
    State,
    best_point,
    moments,
    nearest_top,
    slot_odds,
    tops,
)
from truepose.identification.prior import RICHNESS


@dataclass(frozen=True)
class Likeliest:
    """The likeliest set of movements of a stack, with everything else of the model given it."""

    stack: Stack
    spike_slab: SpikeSlab
    state: State

    @cached_property
    def moved(self) -> tuple[int, ...]:
        """Parameters of the set."""
        return tuple(sorted(term for term, _ in self.state.members))

    @cached_property
    def moments(self) -> Moments:
        """Mean and covariance of all constants, in steps, and of the contrasts of what moves, in usual movements."""
        return moments(self.spike_slab, self.state)

    def contrasts(self, parameter: int) -> tuple[Array, Array]:
        """Mean (K - 1,) and covariance of the contrasts, in steps, of a parameter that moved or is set up anew."""
        renewed = parameter in self.stack.anew
        moved = self.spike_slab.design.n + self.stack.columns(parameter)
        own = self.stack.always(parameter) if renewed else moved
        at = np.flatnonzero(np.isin(self.moments.at, own))
        unit = 1.0 if renewed else float(self.stack.unit[parameter])
        return unit * self.moments.mean[at], unit**2 * self.moments.covariance[np.ix_(at, at)]

    @cached_property
    def noise(self) -> float:
        """In stated sigmas."""
        return float(self.spike_slab.unknowns.scales(self.state.point)[0])

    @cached_property
    def places(self) -> Array:
        """(K, n) mean of the parameters of every session, in steps less the prior's mean."""
        n = len(self.stack.sigma)
        out = np.tile(self.moments.mean[:n], (len(self.stack.jacobian), 1))
        for i in (*self.moved, *self.stack.anew):
            out[:, i] += self.stack.contrasts @ self.contrasts(i)[0]
        return out


@dataclass(frozen=True)
class MovementPosterior:
    """What moves: probability (n,) of each parameter; together (n,) that it or one of a few that stand in for it does; gain
    (n,) log Bayes factor of its movement beside the others of the likeliest set.

    alike: parameters that would do nearly as well in the place of one, with the log odds against them; log_bayes_factor of
    the likeliest set against none; noise: mean of its logarithm, in stated sigmas.
    """

    likeliest: Likeliest
    probability: Array
    together: Array
    gain: Array
    alike: Mapping[int, Mapping[int, float]]
    log_bayes_factor: float
    noise: float
    extrinsic: Mask


def likeliest(stack: Stack, kinds: Kinds, known: State | None = None) -> Likeliest:
    """By ascent, from a known state or from nothing."""
    spike_slab = movement_problem(stack, kinds)
    start = () if known is None else (State(known.members, spike_slab.unknowns.nearest(known.point), 0.0),)
    return Likeliest(stack, spike_slab, tops(spike_slab, RICHNESS, start)[0])


def movement_posterior(top: Likeliest, kinds: Kinds) -> MovementPosterior:
    """From two chains about the likeliest set."""
    spike_slab, stack = top.spike_slab, top.stack
    found = sample(spike_slab, RICHNESS, known=[top.state])
    best = Likeliest(stack, spike_slab, mode(found, spike_slab))
    gain, instead = _gains(best), {i: _gains(best, without=i) for i in best.moved}
    unseen = expit(
        slot_odds(RICHNESS, 0) + spike_slab.terms.log_first
    )  # what no reading speaks of keeps its prior
    return MovementPosterior(
        best,
        probability=np.where(stack.visible, found.causes, unseen),
        together=found.slots,
        gain=np.array([instead[k][k] if k in instead else gain[k] for k in range(len(gain))]),
        alike={i: _alike(i, there, best.moved) for i, there in instead.items()},
        log_bayes_factor=_against_nothing(spike_slab, best.state),
        noise=_noise(spike_slab, found),
        extrinsic=kinds.extrinsic,
    )


def _alike(moved: int, gains: Array, taken: Sequence[int]) -> dict[int, float]:
    """What would do nearly as well in the place of a movement, the likeliest first: log odds against it."""
    away = {k: float(gains[moved] - g) for k, g in enumerate(gains) if k not in taken and g > ENOUGH}
    return dict(sorted(((k, a) for k, a in away.items() if a < NEARLY), key=lambda item: item[1]))


def _noise(spike_slab: SpikeSlab, found: Posterior) -> float:
    """In stated sigmas: the mean of its logarithm."""
    logs = np.log([spike_slab.unknowns.scales(point)[0] for point, _ in found.points])
    share = np.array([share for _, share in found.points])
    return float(np.exp(share @ logs / share.sum()))


def _gains(best: Likeliest, without: int | None = None) -> Array:
    """(n,) log Bayes factor of each parameter's movement, of any size, beside the likeliest set or this ``without`` one."""
    spike_slab = best.spike_slab
    rest: list[Member] = [m for m in best.state.members if m[0] != without]
    points = [p for step in LOUDER if spike_slab.unknowns.holds(p := best.state.point.louder(step))]
    null = np.array([spike_slab.log_evidence(p, rest) for p in points])
    gains = log_gains([spike_slab.beside(p, rest) for p in points], spike_slab.sizes)
    by_point = np.logaddexp.reduce(gains + spike_slab.sizes.log_prior[:, None], axis=1)
    found = np.logaddexp.reduce(null[:, None] + by_point) - np.logaddexp.reduce(null)
    found[[term for term, _ in rest]] = 0.0
    return np.where(best.stack.visible, found, 0.0)


def _against_nothing(spike_slab: SpikeSlab, state: State) -> float:
    """Log Bayes factor of a set at its sizes against none, each at its likeliest noise and tolerances."""
    if not state.members:
        return 0.0
    nothing = nearest_top(spike_slab, best_point(spike_slab), ())
    sizes = sum(float(spike_slab.sizes.log_prior[size]) for _, size in state.members)
    there = spike_slab.log_evidence(state.point, state.members)
    return float(there + sizes - spike_slab.log_evidence(nothing, ()))
