"""The ordinary fit and the one under tolerances, both without effects beyond those of the file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import outliers
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine


@dataclass(frozen=True)
class Fits:
    """The ordinary fit, the one under tolerances, both without effects, and the rows (n,) that both leave out."""

    free: Estimate
    before: Estimate
    outliers: Mask

    @property
    def rms(self) -> float:
        """Of the whitened residual of the worse of both."""
        return float(np.sqrt(max(self.before.chi2_per_dof, self.free.chi2_per_dof)))


def null_fits(machine: Machine, recording: Recording) -> Fits:
    """From nothing, with rows left out that a fit which bends for them finds far off."""
    known = machine.effects
    predictor = Predictor(machine, recording, known, visits=FIT)
    start = aligned_start(predictor)
    rough = estimate(machine, recording, known, start=start, loss="huber", predictor=predictor)
    far = outliers.outlying_rows(rough, recording, ~recording.validation & ~outliers.bridges(recording))
    before = estimate(machine, recording, known, start=rough.p, exclude=far, predictor=predictor)
    return Fits(free_fit(machine, recording, before, far, before.p), before, far)


def free_fit(machine: Machine, recording: Recording, before: Estimate, far: Mask, start: Array) -> Estimate:
    """The ordinary fit beside it; where its valley has no bottom, with tolerances less wide."""
    for factor in (FREE_WIDENING, FREE_WIDENING / 3, FREE_WIDENING / 10):
        try:
            return estimate(machine, recording, before.effects, start=start, widen=factor, exclude=far)
        except ConvergenceError:
            start = before.p
    return before


def refitted(machine: Machine, recording: Recording, fits: Fits, far: Mask) -> Fits:
    """With other rows left out."""
    before = estimate(machine, recording, machine.effects, start=fits.before.p, exclude=far)
    return Fits(free_fit(machine, recording, before, far, fits.free.p), before, far)
