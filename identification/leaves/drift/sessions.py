"""Recordings as sessions in the order of their clock, each with the readings' linearisation at any parameters.

Movements between sessions as terms of the posterior that ``diagnose`` draws from: spike and slab, geometry marginalised.

With r_k + A_k tau_k the whitened residual of session k, tau_k in steps less the prior's mean,
    tau_k = tau + sum_i (C z_i)_k,   tau ~ N(0, tolerance^2),   z_i = 0 or z_i ~ N(0, q_i^2),
where the columns of C (K, K - 1) are orthonormal contrasts between sessions: a common departure from the drawing is
no movement, and no session is the reference. Each free parameter is a term of K - 1 columns. What the machine file says is
set up anew for each session has its z_i in every model, of the size of its tolerance, and is no term. Noise and tolerances may
be other than stated, as in every posterior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.linalg import helmert
from scipy.special import expit

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification import prior
from truepose.identification.fit.decomposition import ROUNDING
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import triangular
from truepose.identification.fit.problem import Prior, Problem
from truepose.identification.fit.tolerance_classes import PartClass, part_classes, widenings
from truepose.identification.identifiability.observability import Note
from truepose.identification.posterior.design import Always, Design, Term, Terms, Unknowns, Urn
from truepose.identification.posterior.marginal import log_gains
from truepose.identification.posterior.posterior import Posterior, class_probability, mode, sample
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
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.prior import RICHNESS
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import FRAME_OF, Machine
from truepose.models.machine.mechanism import like_parts, vector_of

# -- Recordings as sessions in the order of their clock, each with the readings' linearisation at any parameters

UNBOUNDED = 10.0
"""What an infinite tolerance counts as where a fit needs an end: so many steps (1 m, 10 rad)."""


@dataclass(frozen=True)
class Session:
    """Rows that belong together: label, time (median, s; None where nobody recorded it) and what predicts them."""

    label: str
    time: float | None
    recording: Recording
    predictor: Predictor

    def fit(self, prior: Prior, start: Array) -> Estimate:
        """Fit the session alone, from constants ``start`` (np,)."""
        machine = self.predictor.machine
        return estimate(
            machine, self.recording, machine.effects, prior=prior, start=start, predictor=self.predictor
        )


@dataclass(frozen=True)
class Linear:
    """Whitened residual of a session as jacobian (n + 1, n) tau + offset (n + 1,), in length the same as that
    of all its readings: tau are free parameters less the prior's mean, in steps."""

    jacobian: Array
    offset: Array
    n_observations: int


def sessions_of(machine: Machine, recording: Recording) -> tuple[tuple[Session, ...], tuple[Note, ...]]:
    """Sessions by time where it is recorded, else by number (files without one: as they were given); notes.

    A reading that counts from a row of another session is left out: between them things may have moved. Raises
    InputError for fewer than two sessions with rows to fit.
    """
    whole, crossing = _without_crossings(recording)
    notes = [Note("crossing", recording.where(int(k))) for k in crossing]
    found = []
    for number in dict.fromkeys(whole.session.tolist()):
        rows = whole.subset(whole.session == number)
        label = _label(whole, rows, number)
        if rows.validation.all():
            notes.append(Note("validation", label))
            continue
        time = None if rows.time is None else float(np.median(rows.time))
        found.append((time if time is not None else float(number), label, time, rows))
    if len(found) < 2:
        raise InputError(
            f"{', '.join(recording.files)}: found {len(found)} session to fit, expected at least two: "
            "give several recordings, or one with a column 'session'"
        )
    found.sort(key=lambda item: item[:2])
    return tuple(
        Session(label, time, rows, Predictor(machine, rows, machine.effects, visits=FIT))
        for _, label, time, rows in found
    ), tuple(notes)


def _without_crossings(recording: Recording) -> tuple[Recording, Index]:
    """The recording with changes since another session's row set aside, and places of these rows.

    They stay as rows that others may count from, but are not fitted.
    """
    if recording.from_row is None:
        return recording, np.zeros(0, dtype=np.intp)
    crossing = recording.whole.session[recording.from_row] != recording.session
    if not crossing.any():
        return recording, np.zeros(0, dtype=np.intp)
    kept = replace(
        recording,
        from_row=np.where(crossing, recording.rows, recording.from_row),
        validation=recording.validation | crossing,
    )
    return kept, np.flatnonzero(crossing)


def _label(recording: Recording, rows: Recording, number: int) -> str:
    """The file's name (its path, where two have one name) when file and session are the same thing."""
    files = np.unique(rows.source_file)
    if len(files) == 1 and np.all(recording.session[recording.source_file == files[0]] == number):
        names = [Path(file).name for file in recording.files]
        own = names[int(files[0])]
        return own if names.count(own) == 1 else recording.files[int(files[0])]
    return f"session {number}"


def linearised(session: Session, prior: Prior, p: Array) -> Linear:
    """The session's readings about ``p`` (np,). Rows that cannot be assembled there do not count."""
    problem = Problem(session.predictor, bounded(prior), p, ~session.recording.validation)
    free, count, blocks = prior.free, 0, []
    for block in problem.data(p, problem.x):
        count += int(np.sum(np.any(block != 0.0, axis=1)))
        blocks.append(block)
    factor = triangular(blocks, len(free) + 1)
    jacobian = factor[:, :-1]
    at = (p - prior.mean)[free] / prior.scale[free]
    return Linear(jacobian, factor[:, -1] - jacobian @ at, count)


def bounded(prior: Prior) -> Prior:
    """The prior with infinite tolerances made very wide: a session of few rows may say nothing of them."""
    return replace(prior, sigma=np.where(np.isinf(prior.sigma), UNBOUNDED * prior.scale, prior.sigma))


# -- Movements between sessions as terms of the posterior that ``diagnose`` draws from: spike and slab, geometry marginalised


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
    always = Always(stack.sigma[own], part[own], np.zeros(len(own), dtype=bool))
    design = Design((whole.T @ whole,), (stack.n_observations,), always)
    unknowns = Unknowns.over(
        1, _still_rms(whole, always.sigma, stack.n_observations), widenings(classes), remainder_rms=0.0
    )
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


# -- Which parameters move between sessions: the posterior over sets of movements, and what would do in the place of each


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
    classes = np.array([class_probability(found, k) for k in range(len(gain))])
    return MovementPosterior(
        best,
        probability=np.where(stack.visible, found.causes, unseen),
        together=np.maximum(classes, found.causes),
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
