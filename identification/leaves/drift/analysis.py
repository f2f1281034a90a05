"""Which parameters move between recordings, how fast, and how long an older calibration lasts.

All sessions are one least-squares problem. Every parameter is common to all sessions unless the posterior asks
for copies of its own (``movement_posterior``); sizes and rates come from the joint covariance, in which what no
recording can tell stays uncertain. See docs/topics/identifiability.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.errors import ConvergenceError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.decomposition import Decomposition
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.fit.set_ups import without_set_ups
from truepose.identification.identifiability.observability import Knowledge, Note
from truepose.identification.identifiability.patterns import Blind
from truepose.identification.leaves.drift.movement_problem import Kinds, Stack
from truepose.identification.leaves.drift.movements import Likeliest, likeliest, movement_posterior
from truepose.identification.leaves.drift.sessions import Session, bounded, linearised, sessions_of
from truepose.identification.leaves.drift.sizes import (
    Durability,
    Movement,
    durability,
    joint_parameters,
    movements,
)
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine
from truepose.shown.result import Written

ROUNDS = 4
ABOUT_STEPS = 3
SETTLED = 0.1
"""Linearised again until the readings of no session change by more than this many sigmas in all."""


@dataclass(frozen=True, repr=False)
class Drift(Written):
    """What moved between sessions.

    labels, times (s, None where not recorded), movements of every free parameter, noise in stated sigmas,
    log_bayes_factor of what moves against nothing, unseen: directions that no recording sees; durability:
    how long calibrations last; settled: whether the joint fit came to rest, otherwise sizes are approximate. fits: of each
    session by itself, over its rows of ``recording``.
    ``to_frame()``: free constants, one a row: ``parameter``, ``status``, ``probability`` (that it moves), ``change`` and
    ``std`` (from the first session to the last), ``unit``, ``rate`` and ``rate_std`` (a second, a session without a clock),
    ``steady``, ``hidden`` (1-sigma of a movement that could have stayed unseen), ``extrinsic`` (of a frame or sensor). mm,
    rad or an effect's own unit. change and rate are NaN where the constant is taken as common to all sessions.
    """

    machine: str
    labels: tuple[str, ...]
    times: tuple[float, ...] | None
    n_observations: tuple[int, ...]
    movements: tuple[Movement, ...]
    noise: float
    log_bayes_factor: float
    unseen: Blind
    durability: Durability
    settled: bool
    notes: tuple[Note | str, ...]
    recording: Recording | None = None
    fits: tuple[Estimate, ...] = ()

    @property
    def moved(self) -> tuple[Movement, ...]:
        """Those that move with a probability above 0.95."""
        return tuple(m for m in self.movements if m.status == "moved")


def drift(
    machine: Machine,
    recording: Recording,
    *,
    accuracy: Mapping[str, float] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Drift:
    """Compare the sessions of ``recording``, with the effects of the machine's file.

    ``accuracy``: rms residual by kind (``position``, ``distance``: mm; ``rotation``: rad) that is good enough for
    an older calibration to be kept; without it, what was carried over must not show in the residuals.
    Raises InputError for fewer than two sessions and without a free parameter, ConvergenceError naming the
    parameters responsible.
    """
    machine = machine.with_effects(without_set_ups(machine.effects))
    prior = prior_of(machine, machine.effects)
    sessions, notes = sessions_of(machine, recording)
    fits = []
    for session in sessions:
        progress(f"fitting {session.label}")
        fits.append(_fit(session, bounded(prior)))
    top, settled = joint_fit(machine, sessions, fits, prior, progress)
    found = movement_posterior(top, Kinds.of(machine, prior))
    progress("checking older calibrations")
    times = _times(sessions)
    return Drift(
        machine=machine.name,
        labels=tuple(s.label for s in sessions),
        times=times,
        n_observations=tuple(fit.n_observations for fit in fits),
        movements=movements(found, prior, machine.parameter_units, times),
        noise=found.noise,
        log_bayes_factor=found.log_bayes_factor,
        unseen=unseen_by_all(machine, top.stack, prior, joint_parameters(found.likeliest, prior)),
        durability=durability(sessions, fits, prior, found.extrinsic, accuracy, top.stack.renewed),
        settled=settled,
        notes=(*recording.notes, *notes, *_lost(sessions, fits)),
        recording=recording,
        fits=tuple(fits),
    )


def _times(sessions: Sequence[Session]) -> tuple[float, ...] | None:
    """When the sessions were, s; None where one does not say."""
    timed = [s.time for s in sessions if s.time is not None]
    return tuple(timed) if len(timed) == len(sessions) else None


def _fit(session: Session, prior: Prior) -> Estimate:
    """The session alone."""
    try:
        return session.fit(prior, aligned_start(session.predictor))
    except ConvergenceError as exc:
        raise ConvergenceError(f"{session.label}: {exc}") from None


def joint_fit(
    machine: Machine,
    sessions: Sequence[Session],
    fits: Sequence[Estimate],
    prior: Prior,
    progress: Callable[[str], None],
) -> tuple[Likeliest, bool]:
    """The likeliest set of movements, linearised about parameters that agree with it, and whether it came to rest.

    The first linearisation of each session is its fit about that of the session with most readings: what a
    session hardly sees is then the same in all.
    """
    reference = max(fits, key=lambda fit: fit.n_observations)
    places = [_about(s, prior, fit.p, reference.p) for s, fit in zip(sessions, fits, strict=True)]
    kinds, known = Kinds.of(machine, prior), None
    for _ in range(ROUNDS):
        progress("weighing what moves")
        stack = Stack.of(
            [linearised(s, prior, p) for s, p in zip(sessions, places, strict=True)], prior, machine.set_up
        )
        top = likeliest(stack, kinds, known)
        known, there = top.state, joint_parameters(top, prior)
        steps = (there - np.array(places))[:, prior.free] / prior.scale[prior.free]
        change = np.linalg.norm(np.einsum("kij,kj->ki", stack.jacobian, steps), axis=1)
        places = list(there)
        if np.max(change) < SETTLED * top.noise:
            return top, True
    return top, False


def _about(session: Session, prior: Prior, start: Array, p: Array) -> Array:
    """The session's parameters (np,) if what its readings leave open is as in ``p``; from ``start``."""
    free, scale = prior.free, prior.scale[prior.free]
    weight = scale / bounded(prior).sigma[free]
    centre = weight * (p - prior.mean)[free] / scale
    for _ in range(ABOUT_STEPS):
        there = linearised(session, prior, start)
        rows = np.vstack([there.jacobian, np.diag(weight)])
        tau = np.linalg.lstsq(rows, np.concatenate([-there.offset, centre]), rcond=1e-14)[0]
        start = p.copy()
        start[free] = prior.mean[free] + scale * tau
    return start


def unseen_by_all(machine: Machine, stack: Stack, prior: Prior, places: Array) -> Blind:
    """What no session sees, not even the one that sees most: whether it moved cannot be told."""
    parts = [Decomposition.of(jacobian, 1.0 / stack.sigma) for jacobian in stack.jacobian]
    k = max(range(len(parts)), key=lambda k: parts[k].rank)
    known = Knowledge.at(prior, machine.parameter_units, places[k], parts[k])
    return Blind.of(known, parts[k].null_space, machine, places[k])


def _lost(sessions: Sequence[Session], fits: Sequence[Estimate]) -> list[Note]:
    return [
        Note("unassembled", session.recording.where(k))
        for session, fit in zip(sessions, fits, strict=True)
        for k in fit.unassembled
    ]
