"""The nonlinear fit with what a search accepted; terms that turn out impossible are banned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError
from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.estimate import Estimate, estimate
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]


def refit(
    signatures: Signatures,
    cat: Catalogue,
    accepted: Mapping[int, float],
    fit: Estimate,
    exclude: NDArray[np.bool_],
    banned: set[int],
) -> tuple[Estimate, dict[int, float]]:
    """Nonlinear fit with the accepted terms.

    A term of the wrong sign, or the newest one where no minimum is found, is banned and the fit repeated without it.
    ``exclude`` (n,) are rows left out.
    """
    machine, recording = signatures.machine, signatures.recording
    current = dict(accepted)
    while True:
        terms = [replace(cat.candidates[i], spread=spread) for i, spread in current.items()]
        known = {e.label: e.amplitudes for e in fit.fitted_effects()}
        start = np.concatenate(
            [
                fit.p[: len(machine.parameters)],
                *[known.get(t.label, np.zeros(len(t.coefficients))) for t in terms],
            ]
        )
        try:
            result = estimate(machine, recording, terms, start=start, exclude=exclude)
        except ConvergenceError:
            added = [i for i in current if i not in cat.stated]
            if not added:
                raise
            banned.add(added[-1])
            del current[added[-1]]
            continue
        outside = [
            i for i, term in zip(current, result.fitted_effects(), strict=True) if _outside(term, result)
        ]
        if not outside:
            return result, current
        banned.update(outside)
        current = {i: v for i, v in current.items() if i not in outside}


def _outside(term: PlacedEffect, result: Estimate) -> bool:
    """Whether a coefficient that must be positive is negative by more than two of its standard deviations."""
    names = list(result.prior.names)
    std = result.std
    for c, value in zip(term.coefficients, term.amplitudes, strict=True):
        if c.lower == 0.0 and value < -2.0 * std[names.index(f"{term.label}:{c.name}")]:
            return True
    return False
