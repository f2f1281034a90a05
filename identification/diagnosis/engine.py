"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis import outliers
from truepose.identification.diagnosis.result import (
    Diagnosis,
)
from truepose.identification.diagnosis.search import search, settled
from truepose.identification.diagnosis.verdict import Fits, concluded
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate, estimate
from truepose.identification.fit.set_ups import with_set_ups
from truepose.identification.learned_prior import FleetPrior, LearnedPrior, read_prior
from truepose.identification.prediction.predictor import FIT, Predictor
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.tried import with_measured_loads
from truepose.identification.signatures.candidates import catalogue
from truepose.identification.signatures.linearisation import Signatures
from truepose.models.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def diagnose(
    machine: Machine,
    recording: Recording | Sources,
    *,
    prior: LearnedPrior | Path | str | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Say what physics the model of ``machine`` leaves out of ``recording``, model it and prove it.

    A path, a DataFrame or a dict of columns is a recording, too. ``prior``: what a fleet of machines leaves for this one, or
    the file of it (``truepose.identification.learned_prior``). Raises InputError for unusable input and
    ConvergenceError when the fit without effects finds no minimum.
    """
    learned = read_prior(prior) if isinstance(prior, Path | str) else prior
    recording = as_recording(machine, recording)
    machine = with_measured_loads(with_set_ups(machine, recording), recording)
    progress("fitting without effects")
    fits = _null_fits(machine, recording)
    cat = catalogue(machine, recording)
    if learned is not None:
        cat = replace(cat, learned=FleetPrior(learned, machine.mechanism_type))
    progress(f"weighing {len(cat.candidates)} explanations")
    signatures = Signatures(machine, recording, cat.candidates)
    near = search(signatures, cat, fits.before, fits.outliers, fits.rms)
    again = outliers.outlying_rows(near.fit, recording, ~recording.validation)
    if not np.array_equal(again, fits.outliers):
        fits = _refit_null(machine, recording, fits, again)
        start = near.without(again, fits.before, fits.rms)
        del near
        near = search(signatures, cat, fits.before, again, fits.rms) if start is None else settled(start)
    found = [near.found()]
    del near  # and what its chains remember
    progress("naming and proving")
    return concluded(fits, found.pop())  # whose matrices are let go there


def _null_fits(machine: Machine, recording: Recording) -> Fits:
    known = machine.effects
    predictor = Predictor(machine, recording, known, visits=FIT)
    start = aligned_start(predictor)
    rough = estimate(machine, recording, known, start=start, loss="huber", predictor=predictor)
    far = outliers.outlying_rows(rough, recording, ~recording.validation & ~outliers.bridges(recording))
    before = estimate(machine, recording, known, start=rough.p, exclude=far, predictor=predictor)
    free = free_fit(machine, recording, before, far, before.p)
    return Fits(free, before, far)


def free_fit(machine: Machine, recording: Recording, before: Estimate, far: Mask, start: Array) -> Estimate:
    """The ordinary fit beside it; where its valley has no bottom, with tolerances less wide."""
    for factor in (FREE_WIDENING, FREE_WIDENING / 3, FREE_WIDENING / 10):
        try:
            return estimate(machine, recording, before.effects, start=start, widen=factor, exclude=far)
        except ConvergenceError:
            start = before.p
    return before


def _refit_null(machine: Machine, recording: Recording, fits: Fits, far: Mask) -> Fits:
    known = machine.effects
    before = estimate(machine, recording, known, start=fits.before.p, exclude=far)
    free = free_fit(machine, recording, before, far, fits.free.p)
    return Fits(free, before, far)
