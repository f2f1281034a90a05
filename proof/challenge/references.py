"""Fits to compare an engine with: ordinary ones without effects, and an oracle that is told effects and places.

Each may fail; a case stays, without that reference.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from challenge.imitations import Imitations
from challenge.measures import held_out_error, parameter_bias
from challenge.rivals import INDISTINCT, rivals
from challenge.solutions import Geometry, HeldOut, Reference
from truepose.errors import TrueposeError
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import FREE_WIDENING, estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.report.results import parameters_json
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
SETTLED = 1e-4
"""Half chi2 that an oracle may leave to be gained."""
MOST_TERMS = 4
"""Terms (orders of a harmonic) that an oracle may take at one place."""


def ordinary_fit(machine: Machine, recording: Recording, exclude: Mask | None = None) -> Estimate | None:
    """The fit under tolerances, without effects, some rows (n,) left out; None where it does not converge."""
    try:
        predictor = Predictor(machine, recording)
        start = aligned_start(predictor)
        return estimate(machine, recording, start=start, predictor=predictor, exclude=exclude)
    except TrueposeError:
        return None


def free_fit(
    machine: Machine, recording: Recording, start: Array, exclude: Mask | None = None
) -> Estimate | None:
    """The same with wide tolerances, as wide as converges, from parameters ``start`` (np,)."""
    for factor in (FREE_WIDENING, FREE_WIDENING / 3, FREE_WIDENING / 10):
        try:
            return estimate(machine, recording, start=start, widen=factor, exclude=exclude)
        except TrueposeError:
            continue
    return None


def oracle_terms(
    known: Imitations, effect: str, place: tuple[str, ...], change: Array, beside: Sequence[Array]
) -> tuple[PlacedEffect, ...]:
    """Terms of the catalogue for one true effect: the best settings, or orders as long as each adds something.

    ``change`` (N,) is what it does to the readings, ``beside`` (N,) other directions. Empty where the catalogue lacks it.
    """
    candidates = known.catalogue.candidates
    chosen: list[PlacedEffect] = []
    taken: list[Array] = list(beside)
    missed = known.bench.snr(change, taken) ** 2
    for _ in range(MOST_TERMS):
        ranked = rivals(known, change, taken, lambda name: name == (effect, place))
        fitting = [r for r in ranked if candidates[r.signature.index] not in chosen]
        if not fitting or (chosen and missed - fitting[0].missed < INDISTINCT):
            break
        missed = fitting[0].missed
        chosen.append(candidates[fitting[0].signature.index])
        taken += list(fitting[0].signature.columns.T)
        if not chosen[-1].effect.settings_add:
            break
    return tuple(chosen)


def oracle(
    machine: Machine,
    recording: Recording,
    terms: Sequence[PlacedEffect],
    starts: Sequence[Array],
    exclude: Mask | None = None,
) -> Estimate | None:
    """The fit with the true effects from the first of the parameters ``starts`` (np,) that leads to a minimum."""
    try:
        predictor = Predictor(machine, recording, terms)
    except TrueposeError:
        return None
    for start in starts:
        full = np.append(start, np.zeros(len(predictor.model.names) - len(start)))
        try:
            return estimate(
                machine, recording, terms, start=full, predictor=predictor, tolerance=SETTLED, exclude=exclude
            )
        except TrueposeError:
            continue
    return None


def reference(
    fit: Estimate, recording: Recording, held_text: str, held: HeldOut, geometry: Geometry
) -> Reference:
    """Errors of a fit, written and read back as a user would (see ``truepose predict``)."""
    values = {name: float(entry["value"]) for name, entry in parameters_json(fit).items()}
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        write_calibrated(at / "fit.yaml", fit, recording)
        (at / "heldout.csv").write_text(held_text, encoding="utf-8")
        machine = load_machine(at / "fit.yaml")
        rows = load_recording(machine, [at / "heldout.csv"], need_observations=False)
        error = held_out_error(predict(machine, rows), held)
    names = tuple(effect.label for effect in fit.effects)
    return Reference(error, parameter_bias(values, geometry), names)


__all__ = ["free_fit", "oracle", "oracle_terms", "ordinary_fit", "reference"]
