"""Movements between sessions as terms of the posterior that ``diagnose`` draws from: spike and slab, geometry marginalised.

With r_k + A_k tau_k the whitened residual of session k, tau_k in steps less the prior's mean,
    tau_k = tau + sum_i (C z_i)_k,   tau ~ N(0, tolerance^2),   z_i = 0 or z_i ~ N(0, q_i^2),
where the columns of C (K, K - 1) are orthonormal contrasts between sessions: a common departure from the drawing is
no movement, and no session is the reference. Each free parameter is a term of K - 1 columns. Noise and tolerances may be
other than stated, as in every posterior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import helmert

from truepose.identification import prior
from truepose.identification.drift.sessions import Linear
from truepose.identification.fit.decomposition import ROUNDING
from truepose.identification.fit.problem import Prior
from truepose.identification.fit.tolerance_classes import PartClass, part_classes, widenings
from truepose.identification.posterior.design import Always, Design, Unknowns
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.terms import Term, Terms
from truepose.identification.posterior.urn import Urn
from truepose.models.machine import Machine
from truepose.models.parameters import like_parts, vector_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stack:
    """All sessions in one least-squares problem: jacobian (K, n + 1, n), offset (K, n + 1), n_observations; sigma (n,):
    tolerances in steps (inf: none), and the class of parts (n,) of each."""

    jacobian: Array
    offset: Array
    n_observations: int
    sigma: Array
    classes: tuple[PartClass, ...]

    @classmethod
    def of(cls, sessions: Sequence[Linear], prior: Prior) -> Stack:
        """From the linearised sessions."""
        free = prior.free
        classes = part_classes([prior.names[k] for k in free], [prior.parts[k] for k in free])
        return cls(
            np.stack([s.jacobian for s in sessions]),
            np.stack([s.offset for s in sessions]),
            sum(s.n_observations for s in sessions),
            prior.sigma[free] / prior.scale[free],
            classes,
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
    def visible(self) -> NDArray[np.bool_]:
        """(n,) parameters that some session sees."""
        sharpest = np.max(np.linalg.norm(self.jacobian, axis=1), axis=0)
        return np.asarray(sharpest > ROUNDING * np.max(sharpest, initial=0.0))

    def columns(self, parameter: int) -> NDArray[np.intp]:
        """(K - 1,) its contrasts among those of all parameters."""
        k = self.contrasts.shape[1]
        return np.arange(parameter * k, (parameter + 1) * k)


@dataclass(frozen=True)
class Kinds:
    """What moves alike: the kind of each free parameter (n,), and whether it is of a frame or a sensor (n,)."""

    names: tuple[str, ...]
    extrinsic: NDArray[np.bool_]

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
    shown = stack.jacobian[:, :, :, None] * (stack.unit[:, None] * stack.contrasts[:, None, None, :])
    whole = np.column_stack(
        [
            stack.jacobian.reshape(sessions * rows, n),
            shown.reshape(sessions * rows, -1),
            -stack.offset.ravel(),
        ]
    )
    classes = tuple(dict.fromkeys(stack.classes))
    part = np.array([classes.index(c) for c in stack.classes], dtype=np.intp)
    always = Always(stack.sigma, part, np.zeros(n, dtype=bool))
    design = Design((whole.T @ whole,), (stack.n_observations,), always)
    unknowns = Unknowns.over(1, _still_rms(whole, stack), widenings(classes), remainder_rms=0.0)
    return SpikeSlab(design, unknowns, _terms(stack, kinds), prior.MOVEMENT_SIZES)


def _still_rms(whole: Array, stack: Stack) -> float:
    """Rms residual, in stated sigmas, when nothing moves."""
    jacobian = np.vstack([whole[:, : len(stack.sigma)], np.diag(1.0 / stack.sigma)])
    right = np.append(whole[:, -1], np.zeros(len(stack.sigma)))
    left = right - jacobian @ np.linalg.lstsq(jacobian, right, rcond=None)[0]
    return float(np.linalg.norm(left) / np.sqrt(stack.n_observations))


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
        log_size=prior.MOVEMENT_SIZES.log_prior,
        weight=prior.URN,
        alike=prior.ALIKE,
        further=prior.FURTHER,
        log_place=log_place,
    )
    return Terms(terms, urn)
