"""Pose movements between sessions as terms of the posterior that ``diagnose`` draws from, geometry marginalised.

With r_k + A_k tau_k the whitened residual of session k, tau_k in steps less the prior's mean,
    tau_k = tau + sum_i (C z_i)_k,   tau ~ N(0, tolerance^2),   z_i = 0 or z_i ~ N(0, q_i^2),
where the columns of C (K, K - 1) are orthonormal contrasts between sessions: a common departure from the drawing is
no movement, and no session is the reference. Each free parameter is a term of K - 1 columns. What the machine file says is
set up anew for each session has its z_i in every model, of the size of its tolerance, and is no term. Noise and tolerances may
be other than stated, as in every posterior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import helmert

from truepose.arrays import Array, Index, Mask
from truepose.identification import prior
from truepose.identification.fit.decomposition import ROUNDING
from truepose.identification.fit.problem import Prior
from truepose.identification.fit.tolerance_classes import PartClass, part_classes, widenings
from truepose.identification.leaves.drift.sessions import Linear
from truepose.identification.posterior.design import Always, Design, Term, Terms, Unknowns, Urn
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.models.machine.machine import FRAME_OF, Machine
from truepose.models.machine.mechanism import like_parts, vector_of


@dataclass(frozen=True)
class Stack:
    """All sessions in one least-squares problem: jacobian (K, n + 1, n), offset (K, n + 1), n_observations; sigma (n,):
    tolerances in steps (inf: none), and the class of parts (n,) of each; anew: which are set up anew for each session."""

    jacobian: Array
    offset: Array
    n_observations: int
    sigma: Array
    classes: tuple[PartClass, ...]
    anew: tuple[int, ...] = ()

    @classmethod
    def of(cls, sessions: Sequence[Linear], prior: Prior, set_up: Sequence[str] = ()) -> Stack:
        """From the linearised sessions; ``set_up``: the frames that are set up anew."""
        free = prior.free
        classes = part_classes([prior.names[k] for k in free], [prior.parts[k] for k in free])
        return cls(
            np.stack([s.jacobian for s in sessions]),
            np.stack([s.offset for s in sessions]),
            sum(s.n_observations for s in sessions),
            prior.sigma[free] / prior.scale[free],
            classes,
            tuple(i for i, k in enumerate(free) if FRAME_OF.get(prior.names[k]) in set_up),
        )

    @cached_property
    def contrasts(self) -> Array:
        """(K, K - 1) orthonormal, each summing to 0."""
        return np.asarray(helmert(len(self.jacobian)).T)

    @cached_property
    def unit(self) -> Array:
        """(n,) the usual largest movement of each parameter, in steps."""
        return prior.MOVED * np.where(np.isfinite(self.sigma), self.sigma, 1.0)

    @cached_property
    def visible(self) -> Mask:
        """(n,) parameters that some session sees."""
        sharpest = np.max(np.linalg.norm(self.jacobian, axis=1), axis=0)
        return np.asarray(sharpest > ROUNDING * np.max(sharpest, initial=0.0))

    @property
    def renewed(self) -> Mask:
        """(n,) what is set up anew for each session."""
        return np.isin(np.arange(len(self.sigma)), self.anew)

    def always(self, parameter: int) -> Index:
        """(K - 1,) contrasts of what is set up anew, among the columns of every model."""
        k = self.contrasts.shape[1]
        first = len(self.sigma) + self.anew.index(parameter) * k
        return np.arange(first, first + k)

    def columns(self, parameter: int) -> Index:
        """(K - 1,) its contrasts among those of all parameters."""
        k = self.contrasts.shape[1]
        return np.arange(parameter * k, (parameter + 1) * k)


@dataclass(frozen=True)
class Kinds:
    """What moves alike: the kind of each free parameter (n,), and whether it is of a frame or a sensor (n,)."""

    names: tuple[str, ...]
    extrinsic: Mask

    @classmethod
    def of(cls, machine: Machine, prior: Prior) -> Kinds:
        """A frame is set up as a whole, and like parts of a mechanism wear alike."""
        standing = {parameter.name for parameter in machine.frames}
        outside = standing | {p.name for sensor in machine.sensors for p in sensor.parameters}
        names = [prior.names[k] for k in prior.free]
        kinds = tuple(vector_of(name) if name in outside else like_parts(name) for name in names)
        return cls(kinds, np.array([name in outside for name in names], dtype=bool))


def movement_problem(stack: Stack, kinds: Kinds) -> SpikeSlab:
    """The posterior's problem: term i is the movement of free parameter i, a size of 1 the usual largest one."""
    sessions, rows, n = stack.jacobian.shape
    apart = stack.jacobian[:, :, :, None] * stack.contrasts[:, None, None, :]
    shown = apart * np.where(stack.renewed, 0.0, stack.unit)[:, None]
    whole = np.column_stack(
        [
            stack.jacobian.reshape(sessions * rows, n),
            apart[:, :, list(stack.anew)].reshape(sessions * rows, -1),
            shown.reshape(sessions * rows, -1),
            -stack.offset.ravel(),
        ]
    )
    classes = tuple(dict.fromkeys(stack.classes))
    part = np.array([classes.index(c) for c in stack.classes], dtype=np.intp)
    own = np.concatenate([np.arange(n), np.repeat(stack.anew, sessions - 1)]).astype(np.intp)
    always = Always(stack.sigma[own], part[own])
    design = Design((whole.T @ whole,), (stack.n_observations,), always)
    unknowns = Unknowns.over(1, _still_rms(whole, always.sigma, stack.n_observations), widenings(classes))
    return SpikeSlab(design, unknowns, _terms(stack, kinds), prior.MOVEMENT_SIZES)


def _still_rms(whole: Array, sigma: Array, count: int) -> float:
    """Rms residual of ``count`` readings, in stated sigmas, when nothing moves."""
    jacobian = np.vstack([whole[:, : len(sigma)], np.diag(1.0 / sigma)])
    right = np.append(whole[:, -1], np.zeros(len(sigma)))
    left = right - jacobian @ np.linalg.lstsq(jacobian, right, rcond=None)[0]
    return float(np.linalg.norm(left) / np.sqrt(count))


def _terms(stack: Stack, kinds: Kinds) -> Terms:
    """One term a parameter. Its share of the prior is even among frames and sensors, and even in the mechanism."""
    names = list(dict.fromkeys(kinds.names))
    kind = np.array([names.index(name) for name in kinds.names], dtype=np.intp)
    outside = kinds.extrinsic
    among = np.where(
        outside, prior.SET_UP / max(outside.sum(), 1), (1 - prior.SET_UP) / max((~outside).sum(), 1)
    )
    number = np.bincount(kind)
    share = np.bincount(kind, weights=among) / among.sum()
    log_place = -np.log(number)[kind]
    free = (-np.inf,) * stack.contrasts.shape[1], (np.inf,) * stack.contrasts.shape[1]
    terms = [
        Term(tuple(stack.columns(i).tolist()), i, int(k), float(log_place[i]), *free)
        for i, k in enumerate(kind)
    ]
    urn = Urn(
        kind=kind,
        share=share,
        number=number,
        feature_kind=np.arange(len(names)),
        feature_share=np.ones(len(names)),
        log_size=np.tile(prior.MOVEMENT_SIZES.log_prior, (len(names), 1)),
        weight=prior.URN,
        alike=prior.ALIKE,
        further=prior.FURTHER,
        log_place=log_place,
    )
    return Terms(terms, urn)


ENOUGH, NEARLY = 3.0, 12.0
"""Log Bayes factor from which on an alternative to a movement is believed (0.95), and log odds against it up to which it is
named."""
