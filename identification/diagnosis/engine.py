"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from truepose.identification.diagnosis import outliers
from truepose.identification.diagnosis.null_fits import Fits, null_fits, refitted
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.diagnosis.search import Expansion, search, settled
from truepose.identification.diagnosis.stages import further, stages
from truepose.identification.diagnosis.verdict import concluded
from truepose.identification.fit.set_ups import with_set_ups
from truepose.identification.learned_prior import FleetPrior, LearnedPrior, read_prior
from truepose.identification.recording.load import Sources, as_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.tried import with_measured_loads
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine import Machine


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
    every = stages(machine, recording)
    fits, cat = null_fits(machine, every[0]), catalogue(machine, recording)
    if learned is not None:
        cat = replace(cat, learned=FleetPrior(learned, machine.mechanism_type))
    progress(f"weighing {len(cat.candidates)} explanations")
    fits, near = _first(machine, every[0], fits, cat)
    for rows in every[1:]:
        fits, near = further(near, fits, rows, progress)
    found = [near.found()]
    del near  # and what its chains remember
    progress("naming and proving")
    return concluded(fits, found.pop())  # whose matrices are let go there


def _first(machine: Machine, recording: Recording, fits: Fits, cat: Catalogue) -> tuple[Fits, Expansion]:
    """The search of these rows from nothing; once more where other rows are far off beside what it finds."""
    signatures = Signatures(machine, recording, cat.candidates)
    near = search(signatures, cat, fits.before, fits.outliers, fits.rms)
    again = outliers.outlying_rows(near.fit, recording, ~recording.validation)
    if np.array_equal(again, fits.outliers):
        return fits, near
    fits = refitted(machine, recording, fits, again)
    start = near.without(again, fits.before, fits.rms)
    del near
    return fits, search(signatures, cat, fits.before, again, fits.rms) if start is None else settled(start)
