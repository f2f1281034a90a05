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
from truepose.identification.leaves.readers.importing import frame_of
from truepose.identification.leaves.readers.probe import Clock, Pairing, clock_of
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.effects.timing import Latency
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import PlacedEffect

_ROWS = 800
_STEPS = 10
_ENOUGH = 0.05
"""A step of so many of its 1-sigma is the last."""
_BLOCKS = 10
_SURE = 4.0
"""1-sigmas from which on a trend is one."""


def clock_by_model(machine: Machine, pairing: Pairing) -> Clock:
    """Return the clock of ``pairing``, from the one that the motion alone tells.

    Raises InputError where nothing tells it: a machine without a sensor that is apart from its joints, joints that rest.
    """
    places = Latency().places(machine)
    if not places:
        raise InputError(
            f"{machine.name}: found no sensor but encoders, expected the probe's: {pairing.files} have a clock each"
        )
    machine = machine.with_effects(tuple(e for e in machine.effects if not isinstance(e.effect, Latency)))
    lag = PlacedEffect.at(Latency(), machine, places[0])
    clock, before = replace(clock_of(pairing), middle=float(np.mean(pairing.time))), None
    for _ in range(_STEPS):
        frame = frame_of(pairing.rows(clock, most=_ROWS))
        recording = load_recording(machine, frame)
        effects = (*machine.effects, lag)
        predictor = Predictor(machine, recording, effects, visits=FIT)
        fit = estimate(machine, recording, effects, loss="huber", start=before, predictor=predictor)
        before = np.append(fit.p[:-1], 0.0)
        # what each row weighs in the latency, and what it says of all of it, s
        jacobian = np.concatenate([block.jacobian[..., -1] for block in predictor.blocks(fit.p, fit.x)])
        size = np.sum(jacobian**2, axis=1)
        late = fit.p[-1] - np.sum(jacobian * np.nan_to_num(fit.residual), axis=1) / np.maximum(size, 1e-300)
        time = np.asarray(recording.time) - clock.offset
        found = trend(clock, time, fit.weights * size, -late)
        step = abs(found.offset - clock.offset) + abs(found.rate - clock.rate) * float(np.ptp(time)) / 2
        clock = found
        if step < _ENOUGH * (found.sigma or 0.0):
            break
    return clock


def trend(clock: Clock, time: Array, weight: Array, late: Array) -> Clock:
    """Return a better clock where rows at ``time`` (n,) of the probe say that it is ``late`` (n,), with ``weight`` (n,).

    Blocks of rows make up for what neighbours have in common. The rate changes where their trend is beyond doubt.
    """
    blocks = np.array_split(np.arange(len(time)), _BLOCKS)
    heavy = np.array([np.sum(weight[b]) for b in blocks])
    own = np.array([np.sum(weight[b] * late[b]) for b in blocks]) / np.maximum(heavy, 1e-300)
    when = np.array([np.mean(time[b]) for b in blocks]) - clock.middle
    centre, step = (float(np.average(v, weights=heavy)) for v in (when, own))
    size = np.average((when - centre) ** 2, weights=heavy)
    slope = float(np.average((when - centre) * (own - step), weights=heavy) / size)
    left = np.average((own - step - slope * (when - centre)) ** 2, weights=heavy)
    if abs(slope + clock.rate) <= _SURE * np.sqrt(left / size / (_BLOCKS - 2)):
        spread = np.average((own - step) ** 2, weights=heavy)
        return Clock(clock.offset + step, float(np.sqrt(spread / (_BLOCKS - 1))), 0.0, clock.middle)
    offset = clock.offset + step - slope * centre
    return Clock(offset, float(np.sqrt(left / (_BLOCKS - 2))), clock.rate + slope, clock.middle)
