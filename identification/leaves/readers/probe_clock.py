"""The clock of a probe by that of a robot's log, as the machine's own geometry tells it.

The fit of the constants has one more unknown, the effect ``latency``: how late the joints are. What single blocks of time
say of it has a trend where one clock runs faster. Both are taken off the clock, and the rows are paired anew.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.leaves.readers.clock_offset import Clock, trend
from truepose.identification.leaves.readers.importing import frame_of
from truepose.identification.leaves.readers.probe import Pairing
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.effects.timing import Latency
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import PlacedEffect

_ROWS = 800
_STEPS = 10
_ENOUGH = 0.05
"""A step of so many of its 1-sigma is the last."""


def clock_by_model(machine: Machine, pairing: Pairing, start: Clock) -> Clock:
    """The clock of ``pairing``, from a ``start`` that is a few moves' length off at most.

    Raises InputError where nothing tells it: a machine without a sensor that is apart from its joints, joints that rest.
    """
    places = Latency().places(machine)
    if not places:
        raise InputError(
            f"{machine.name}: found no sensor but encoders, expected the probe's: {pairing.files} have a clock each"
        )
    machine = machine.with_effects(tuple(e for e in machine.effects if not isinstance(e.effect, Latency)))
    lag = PlacedEffect.at(Latency(), machine, places[0])
    clock, before = replace(start, middle=float(np.mean(pairing.time))), None
    for _ in range(_STEPS):
        frame = frame_of(pairing.rows(clock, most=_ROWS))
        recording = load_recording(machine, frame)
        effects = (*machine.effects, lag)
        predictor = Predictor(machine, recording, effects, visits=FIT)
        fit = estimate(machine, recording, effects, loss="huber", start=before, predictor=predictor)
        before = np.append(fit.p[:-1], 0.0)
        weight, own = _by_row(fit, predictor)
        time = np.asarray(recording.time) - clock.offset
        found = trend(clock, time, weight, -own)
        step = abs(found.offset - clock.offset) + abs(found.rate - clock.rate) * float(np.ptp(time)) / 2
        clock = found
        if step < _ENOUGH * (found.sigma or 0.0):
            break
    return clock


def _by_row(fit: Estimate, predictor: Predictor) -> tuple[Array, Array]:
    """(n,) what each row weighs in the latency, and what it says of all of it, s."""
    jacobian = np.concatenate([block.jacobian[..., -1] for block in predictor.blocks(fit.p, fit.x)])
    weight = fit.weights * np.sum(jacobian**2, axis=1)
    told = -np.sum(jacobian * np.nan_to_num(fit.residual), axis=1) / np.maximum(
        np.sum(jacobian**2, axis=1), 1e-300
    )
    return weight, fit.p[-1] + told
