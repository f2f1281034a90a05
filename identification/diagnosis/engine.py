"""The whole procedure: detect, locate, name or abstain, model, prove.

``diagnose`` is the one entry; every step is a module of this package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from truepose.identification.diagnosis.null_fits import null_fits
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.diagnosis.stages import first, further, stages
from truepose.identification.diagnosis.verdict import concluded
from truepose.identification.fit.reading_errors import estimate_reading_errors
from truepose.identification.fit.set_ups import with_set_ups
from truepose.identification.learned_prior import FleetPrior, LearnedPrior
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.tried import with_measured_loads
from truepose.identification.signatures.candidates import catalogue
from truepose.models.machine.machine import Machine


def diagnose(
    machine: Machine,
    recording: Recording,
    *,
    prior: LearnedPrior | None = None,
    progress: Callable[[str], None] = lambda _: None,
    stop: Callable[[], bool] = lambda: False,
) -> Diagnosis:
    """Say what physics the model of ``machine`` leaves out of ``recording``, model it and prove it.

    ``prior``: what a fleet of machines leaves for this one (``truepose.identification.learned_prior``). ``stop`` is asked now
    and then: once it returns True, the search ends, and what it found by then is named and proved (``Diagnosis.stopped``).
    Raises InputError for unusable input and ConvergenceError when the fit without effects finds no minimum.
    """
    machine = with_measured_loads(with_set_ups(machine, recording), recording)
    progress("fitting without effects")
    every = stages(machine, estimate_reading_errors(machine, recording))
    fits, cat = null_fits(machine, every[0]), catalogue(machine, recording)
    if prior is not None:
        cat = replace(cat, learned=FleetPrior(prior, machine.mechanism_type))
    progress(f"weighing {len(cat.candidates)} explanations")
    fits, near = first(machine, every[0], fits, cat, stop)
    for rows in every[1:]:
        fits, near = further(near, fits, rows, progress)
    found = [near.found()]
    del near  # and what its chains remember
    stopped = stop()
    progress("naming and proving")
    return replace(concluded(fits, found.pop()), stopped=stopped)  # whose matrices are let go there
