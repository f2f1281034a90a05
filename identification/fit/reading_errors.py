"""Errors of the joints' readings, where the machine is compared with itself and nothing is measured.

A ball that is seated in sockets of unknown distance gives no reading: the machine is moved until the ball sits, and the
noise is in the joints' readings. A model that makes the machine smaller makes such residuals smaller too, noise included,
so ordinary least squares prefers the smaller machine. In errors-in-variables form the noise belongs to the readings: the
model is evaluated at the corrected readings ``q - e``, where all rows of a socket agree, and the noise ``f(q) - f(q - e)``
is a constant that no model can shrink (Fuller 1987, Measurement Error Models, section 3.2). The errors are estimated at a
fit, to which a new fit follows, until they stay.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording, frozen
from truepose.models.machine.machine import Machine

ROUNDS = 5
"""Most fits to which the errors are estimated anew."""
SETTLED = 1e-2
"""Change of a residual, in sigmas, below which another round would change nothing that matters."""
NEWTON_STEPS = 3
STEP = 1e-4
"""Step of a central difference by a reading: mm, rad."""
LEAST_MOVEMENT = 0.2
"""Share of the largest singular value below which joints cannot have moved the prediction: noise along it is not theirs."""


def estimate_reading_errors(machine: Machine, recording: Recording) -> Recording:
    """Return the recording with the estimated errors of its joint readings; itself where a length is measured.

    Raises ConvergenceError where the machine cannot be fitted.
    """
    if not _can_shrink(machine):
        return recording
    predictor = Predictor(machine, recording, machine.effects, visits=FIT)
    start = p = aligned_start(predictor)
    before: Array | float = np.inf
    for _ in range(ROUNDS):
        corrected, noise = _correct(predictor, p, start)
        if np.max(np.abs(noise - before), initial=0.0) < SETTLED:
            break
        here, before = predictor.over(corrected), noise
        p = estimate(machine, corrected, machine.effects, start=p, loss="huber", predictor=here).p
    return corrected


def _can_shrink(machine: Machine) -> bool:
    """Return True if a model may shrink what is compared: nothing measures a length, or not along every slide."""
    own = [sensor for sensor in machine.sensors if sensor.compares_itself]
    slides = any(actuator.unit == "mm" for actuator in machine.mechanism.actuators)
    return bool(own) and (slides or not any(sensor.measures_length for sensor in machine.sensors))


def _correct(predictor: Predictor, p: Array, stated: Array) -> tuple[Recording, Array]:
    """Estimate the errors of all readings at the parameters ``p``, and their effect on predictions in sigmas, (n, k).

    The stated sigma is of the machine as ``stated``: there the effect of the errors is worked out.
    """
    recording = predictor.recording
    channels = [c for sensor in predictor.machine.sensors if sensor.compares_itself for c in sensor.channels]
    errors = np.zeros(recording.q.shape)
    measured, gap = _predict(predictor, p, errors)
    wanted, inverse = measured - gap, _inverse(_slopes(predictor, p))
    for _ in range(NEWTON_STEPS):
        missed = np.nan_to_num(_predict(predictor, p, errors)[0] - wanted)
        errors = errors + np.einsum("nqk,nk->nq", inverse, missed)
    as_stated = (_predict(predictor, stated, size)[0] for size in (np.zeros_like(errors), errors))
    offset = np.nan_to_num(np.subtract(*as_stated))
    added = {channel.name: frozen(column) for channel, column in zip(channels, offset.T, strict=True)}
    observations = {**recording.observations, **added}
    corrected = replace(recording, reading_errors=frozen(errors), observations=observations)
    return corrected, offset / np.array([channel.sigma for channel in channels])


def _predict(predictor: Predictor, p: Array, errors: Array) -> tuple[Array, Array]:
    """Return predictions of single rows and compared values, (n, k), at readings less ``errors``; NaN where not assembled."""
    here = predictor.over(replace(predictor.recording, reading_errors=errors))
    x, good = here.assemble(p)
    pairs = here.self_compared(p, x)
    single, compared = (np.where(good[:, None], np.hstack(part), np.nan) for part in zip(*pairs, strict=True))
    return single, compared


def _slopes(predictor: Predictor, p: Array) -> Array:
    """Return the derivative of the predictions by the readings, effects included, shape (n, k, n_joints)."""
    columns = []
    for step in STEP * np.eye(len(predictor.recording.joints)):
        apart = np.broadcast_to(step, predictor.recording.q.shape)
        columns.append((_predict(predictor, p, -apart)[0] - _predict(predictor, p, apart)[0]) / (2.0 * STEP))
    return np.nan_to_num(np.stack(columns, axis=2))


def _inverse(slopes: Array) -> Array:
    """Return the smallest errors that explain a change of the predictions, shape (n, n_joints, k).

    Joints count alike: each is scaled by how far it moves the predictions on average.
    """
    size = np.sqrt(np.mean(np.sum(slopes**2, axis=1), axis=0))
    scale = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
    return np.asarray(scale[:, None] * np.linalg.pinv(slopes * scale, rcond=LEAST_MOVEMENT))
