"""Part recordings into sessions in the order of their clock, each with its linearisation at any parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from truepose.arrays import Array, Index
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import triangular
from truepose.identification.fit.problem import Prior, Problem
from truepose.identification.identifiability.observability import Note
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

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
