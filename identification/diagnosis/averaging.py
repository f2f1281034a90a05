"""The model that predicts: the likeliest set's fit, moved to the mean over all sets, as uncertain as these are apart.

Each visited state (a set with its sizes, noise and tolerances) gives a mean and a covariance of geometry and
coefficients, linear at the likeliest set's fit. The mixture of them has

    mean  m = sum w_s m_s,    covariance = sum w_s (C_s + (m_s - m) (m_s - m)')

so that a candidate which is there with probability p has p times its amplitude, and the rest of it in its 1-sigma.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from truepose.arrays import Array, Mask
from truepose.identification.diagnosis.holdout import Comparison
from truepose.identification.diagnosis.posterior_summary import LEADING
from truepose.identification.diagnosis.refit import FEW, Choice, Model, chosen_model
from truepose.identification.diagnosis.result import WHOLE, Applied
from truepose.identification.diagnosis.search import Found, chosen, start_from
from truepose.identification.fit.bounds import coefficient_bounds
from truepose.identification.fit.estimate import result
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import Prior, Problem, prior_of
from truepose.identification.posterior.state import State, moments, typical
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.placed import EffectAtPlace

ENOUGH = 0.1
"""Share of the states without anything rare from which on these alone speak."""
STATES, STATES_OF_LONG = 100, 12
"""States that the mixture is made of, and so many where a set has many columns."""
HALVINGS = 3
"""How often the way to the mean is halved before it is not gone at all."""
WORSE = 0.1
"""Share by which chi2 of the fitted rows may rise at the mean over sets; beyond it the linear mean is too far away."""


@dataclass(frozen=True)
class Averaged(Estimate):
    """Parameters and amplitudes as means over sets; the covariance is the mixture's, ``own`` its root in steps."""

    own: Array | None = None

    @cached_property
    def root(self) -> Array:
        """(n_free, k) F: F F' is the covariance of what is determined, with sets that differ."""
        assert self.own is not None
        return self.own


def deploy(
    choice: Choice,
    model: Model,
    names: Model | None,
    sure: Collection[int],
    whole: Comparison,
    firm: Collection[int],
) -> tuple[Estimate, Applied]:
    """Return what is deployed: averaged over sets with the ``firm`` candidates where that is all that was found."""
    label, less, held = chosen_model(choice, model, names, sure, whole)
    if less is None or label != WHOLE:
        return choice.drawing if less is None else less.fit, choice.applied(label, held, whole)
    after = averaged(choice.found, model.fit, firm)
    seen = choice.as_it_is(after)
    if seen is None or seen.worse:
        return after if seen is None else model.fit, choice.applied(label, held, whole)
    return after, choice.applied(label, seen, seen)


def averaged(found: Found, likeliest: Estimate, firm: Collection[int] = ()) -> Estimate:
    """Average over all visited sets that hold the ``firm`` candidates, from the fit of the likeliest one.

    What is more probable than not is in the file with the size that its finding has. Returns the fit itself where no set
    holds all of it.
    """
    number = {placed.label: i for i, placed in enumerate(found.catalogue.candidates)}
    held = [number[effect.label] for effect in likeliest.effects]
    if firm:
        states = [one for one in found.posterior.states if set(firm) <= chosen(found.problem, one[0]).keys()]
        if not states:
            return likeliest
        total = sum(share for _, share in states)
        shared = tuple((state, share / total) for state, share in states)  # they add up to one
        found = replace(found, posterior=replace(found.posterior, states=shared))
    further = _open(found, held, {found.catalogue.cause(i) for i in firm})
    candidates = found.catalogue.candidates
    terms = (*likeliest.effects, *(replace(candidates[i], spread=spread) for i, spread in further.items()))
    return _moved(found, likeliest, terms, _mixture(found, (*held, *further)))


def _open(found: Found, held: Collection[int], firm: Collection[EffectAtPlace]) -> dict[int, float]:
    """Named candidates outside the likeliest set that may well be there, with their largest size; the likeliest ones.

    A form without a name says nothing beyond the rows that were seen: a few chances in ten are no reason to carry it there.
    What the likeliest set holds and its fit does not, because bounds left nothing of it, stays out; so do other settings of
    what is ``firm``.
    """
    gone = set(chosen(found.problem, found.mode)) - set(held)
    share, spread = defaultdict[int, float](float), defaultdict[int, float](float)
    for state, weight in found.posterior.states:
        for i, size in chosen(found.problem, state).items():
            share[i] += weight
            spread[i] = max(spread[i], size)
    cat, out = found.catalogue, {*gone, *held}
    named = [i for i in share if cat.named(i) and i not in out and cat.cause(i) not in firm]
    wanted = sorted((i for i in named if share[i] >= LEADING), key=lambda i: -share[i])
    return {i: spread[i] for i in wanted[:FEW]}


@dataclass(frozen=True)
class _Mixture:
    """Means (s, n) of states less that of the likeliest one, their shares (s,), and a root (n, k) of the covariance within
    them that the likeliest one lacks. n: free geometry in its scale, then coefficients in theirs."""

    means: Array
    shares: Array
    wider: Array

    @property
    def shift(self) -> Array:
        """(n,) from the likeliest state to the mean."""
        return np.asarray(self.shares @ self.means)

    def of(self, kept: Mask) -> _Mixture:
        """Of some of the n alone."""
        return _Mixture(self.means[:, kept], self.shares, self.wider[kept])

    def around(self, at: Array) -> Array:
        """(n, k) root of the covariance, about ``at`` (n,), that the likeliest state lacks."""
        between = np.sqrt(self.shares)[:, None] * (self.means - at)
        return np.hstack([between.T, self.wider])


def _mixture(found: Found, kept: Sequence[int]) -> _Mixture:
    spike_slab = found.problem.spike_slab
    turn = _turn(found, kept)
    long = spike_slab.is_long(found.mode.members)
    states = _without_rare(found, kept)
    means, shares = [], []
    within = np.zeros((turn.shape[0], turn.shape[0]))
    for state, share in typical(states, STATES_OF_LONG if long else STATES):
        known = moments(spike_slab, state)
        own = turn[:, known.at]
        means.append(own @ known.mean)
        shares.append(share)
        within += share * (own @ (own @ known.covariance).T)
    mode = moments(spike_slab, _kept(found, found.mode, kept))
    own = turn[:, mode.at]
    # a root of the part of the difference of covariances that adds, entries made comparable
    scale = np.where(np.diag(within) > 0.0, np.sqrt(np.diag(within)), 1.0)
    difference = within - own @ (own @ mode.covariance).T
    values, vectors = np.linalg.eigh(difference / scale[:, None] / scale)
    more = values > 0.0
    wider = scale[:, None] * vectors[:, more] * np.sqrt(values[more])
    # from the columns of candidates to their coefficients
    turns = [sp.csr_array(found.linearisation.turn(i)) for i in kept]
    lift = sp.csr_array(sp.block_diag([sp.eye_array(found.linearisation.free), *turns], format="csr"))
    means = (lift @ (np.array(means) - own @ mode.mean).T).T
    return _Mixture(means, np.array(shares), lift @ wider)


def _without_rare(found: Found, kept: Collection[int]) -> list[tuple[State, float]]:
    """Return visited states that hold nothing but ``kept`` candidates; where these are few, all states without what is rare.

    What is rare may stand in for what is not: a state is better left out than robbed of it.
    """
    every = [(_kept(found, state, kept), share) for state, share in found.posterior.states]
    pairs = zip(every, found.posterior.states, strict=True)
    whole = [one for one, (state, _) in pairs if len(one[0].members) == len(state.members)]
    return whole if sum(share for _, share in whole) >= ENOUGH else every


def _kept(found: Found, state: State, kept: Collection[int]) -> State:
    """A state without rare terms."""
    candidates = found.problem.candidates
    members = tuple(m for m in state.members if candidates[m[0]] in kept)
    return State(members, state.point, state.log_posterior)


def _turn(found: Found, kept: Sequence[int]) -> sp.csr_array:
    """(k, a + g) from the columns [A G] of the design to free geometry and the columns of candidates ``kept``; sparse."""
    problem, lin = found.problem, found.linearisation
    design, columns = problem.spike_slab.design, lin.indices(kept)
    out = sp.lil_array((lin.free + len(columns), design.n + design.width))
    out.setdiag(np.concatenate([np.ones(lin.free), np.zeros(min(out.shape) - lin.free)]))
    stated = {column: lin.free + k for k, column in enumerate(lin.indices(found.catalogue.stated))}
    for row, column in enumerate(columns, start=lin.free):
        out[row, stated.get(column, design.n + column)] = 1.0
    return out.tocsr()


def _moved(found: Found, likeliest: Estimate, terms: tuple[PlacedEffect, ...], mixture: _Mixture) -> Estimate:
    """The fit at the mean, or as far towards it as readings agree, with the covariance of all about it."""
    machine, recording = likeliest.nominal, found.signatures.recording
    predictor = Predictor(machine, recording, terms, visits=FIT)
    prior, unit = _prior(likeliest, terms), prior_of(machine, terms).scale
    at, start = prior.free, start_from(likeliest, terms)
    moves, count = prior.sigma > 0.0, len(machine.parameters)
    # what a fit moves
    mixture = mixture.of(np.concatenate([moves[:count][moves[:count]], moves[count:]]))
    for part in (*0.5 ** np.arange(HALVINGS + 1), 0.0):
        p = start.copy()
        p[at] += unit[at] * part * mixture.shift
        p = np.clip(p, *coefficient_bounds(machine, terms))
        problem = Problem(predictor, prior, p, likeliest.used, slim=True)
        plain = result(problem, replace(likeliest.solution, t=problem.nothing), terms)
        if plain.chi2 <= (1.0 + WORSE) * likeliest.chi2:
            break
    own = np.zeros((len(at), likeliest.root.shape[1]))
    own[: len(likeliest.root)] = likeliest.root
    further = (unit / prior.scale)[at][:, None] * mixture.around(part * mixture.shift)
    known = {name: getattr(plain, name) for name in plain.__dataclass_fields__}
    return Averaged(**known | {"noise": likeliest.noise}, own=np.hstack([own, further]))


def _prior(likeliest: Estimate, terms: Sequence[PlacedEffect]) -> Prior:
    """The tolerances and steps of the likeliest set's fit; those of what is beside it are its spread."""
    wide, first = prior_of(likeliest.nominal, terms), likeliest.prior
    further = wide.sigma[len(first.sigma) :] / likeliest.noise
    sigma, scale = np.append(first.sigma, further), np.append(first.scale, further)
    return replace(wide, sigma=sigma, scale=scale)
