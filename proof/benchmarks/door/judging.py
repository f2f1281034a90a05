"""What a pair is worth, by calibrating it: constants in tolerances from the drawing, and errors at rows held out.

The truth of a case is judged by this alone: a slip that a free frame or a tolerance takes up is none, and a mended pair
is right if it predicts rows that it did not see as the right pair does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from truepose.errors import TrueposeError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.load import load_recording
from truepose.identification.prediction.predictor import Predictor
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.compliance import JointCompliance
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

from .pairs import found

WITHIN = 4.0
"""Tolerances: constants of a pair that may be right are no farther from the drawing."""
ALIKE = 1.5
"""Factor within which misfits of one recording are alike."""
OFF = 3.0
"""Factor of misfit beyond which a pair is off, where the drawn machine's is less, too."""
EVERY = 4
"""Every fourth row is held out."""
LOST = 0.1
"""Share of rows that may be impossible to assemble."""


@dataclass(frozen=True)
class Worth:
    """worst: tolerances of the constant farthest from the drawing; rms: errors of held-out rows by unit; failed: why
    nothing could be fitted."""

    worst: float = np.inf
    rms: Mapping[str, float] = field(default_factory=dict)
    failed: str = ""

    def times(self, right: Worth) -> float:
        """Return the largest ratio of errors to those of the right pair."""
        if self.failed or set(self.rms) != set(right.rms):
            return float("inf")
        return max(self.rms[unit] / max(right.rms[unit], 1e-12) for unit in right.rms)


def worth(folder: Path, *, rigid: bool = False, giving: bool = False) -> Worth:
    """Return what the pair in a folder is worth; ``rigid``: as drawn, with frames alone fitted; ``giving``: with joints that
    give way under weights."""
    try:
        path, tables = found(folder)
        machine = load_machine(path)
        recording = load_recording(machine, tables)  # in range, as `calibrate` asks
        held = np.arange(len(recording)) % EVERY == EVERY - 1
        fitted = _drawn(machine) if rigid else machine
        effects = (*fitted.effects, *(_compliances(fitted) if giving else ()))
        start = aligned_start(Predictor(fitted, recording, effects))
        fit = estimate(fitted, recording, effects, exclude=held, start=start)
    except (TrueposeError, ValueError, ArithmeticError) as exc:
        return Worth(failed=f"{type(exc).__name__}: {exc}")
    lost = float(np.mean(~np.isfinite(fit.residual).all(axis=1)))
    if lost > LOST:
        return Worth(failed=f"{lost:.0%} of the rows cannot be assembled")
    channels = machine.channels
    left = np.square(fit.residual[held] * [c.sigma for c in channels])
    units = {c.unit for c in channels}
    rms = {u: float(np.sqrt(np.nanmean(left[:, [c.unit == u for c in channels]]))) for u in units}
    return Worth(float(fit.worst_parameter_sigma), rms)


def _compliances(machine: Machine) -> list[PlacedEffect]:
    effect = JointCompliance()
    return [PlacedEffect.at(effect, machine, place) for place in effect.places(machine)]


def shows_sag(right: Worth, giving: Worth) -> bool:
    """Return True if readings show that joints give way: without it they are missed by far more."""
    return not giving.failed and right.times(giving) > OFF


def _drawn(machine: Machine) -> Machine:
    """Return the machine with its mechanism exactly as drawn."""
    exact = tuple(replace(p, tolerance=0.0) for p in machine.mechanism.parameters)
    return replace(machine, mechanism=replace(machine.mechanism, parameters=exact))


def may_be_right(right: Worth) -> bool:
    """Return True if a pair without a slip is one that the law speaks of."""
    return not right.failed and right.worst <= WITHIN


def fits(pair: Worth, right: Worth) -> bool:
    """Return True if a pair is as good as the right one."""
    return pair.worst <= max(WITHIN, ALIKE * right.worst) and pair.times(right) <= ALIKE


def is_off(pair: Worth, right: Worth, drawn: Worth) -> bool:
    """Return True if no physics that the right pair has, nor its drawing, makes a pair so bad."""
    if pair.failed or pair.worst > ALIKE * max(WITHIN, right.worst):
        return True
    if pair.times(right) <= OFF:
        return False
    return drawn.failed != "" or pair.times(drawn) > 1.0


__all__ = ["Worth", "fits", "is_off", "may_be_right", "shows_sag", "worth"]
