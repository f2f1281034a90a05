"""Whether a fit may be called a calibration: it left its drawing grossly, or no sigma explains what it leaves.

One number decides, ``GROSS``: physics that a model leaves out pushes constants 10 or 20 tolerances away and leaves residuals
of 10 or 30 sigma. A hundred of either is another machine than the file's: a unit, a sign, an order of columns, a frame that
is not there. Where a sigma is a nanometre, residuals of a hundred are ordinary; so they must also be larger than all that the
drawing's tolerances could have made of the readings before anything was fitted.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.models.machine import FRAME_OF

GROSS = 100.0
"""Tolerances from the drawing, or sigmas of residuals, beyond which a fit is no calibration."""
CONSTANT = "wrong-constant"


@dataclass(frozen=True)
class Misfit:
    """What a fit leaves: rms by kind of reading (mm, rad), the same in sigmas, and what tolerances could have made."""

    rms: Mapping[str, float]
    sigmas: float
    expected: float


@dataclass(frozen=True)
class Judgement:
    """Why a fit is no calibration: constants grossly off their drawing (in tolerances), a misfit beyond any sigma."""

    departures: tuple[tuple[str, float], ...] = ()
    misfit: Misfit | None = None

    @property
    def calibrated(self) -> bool:
        """Whether nothing of the kind was found."""
        return not self.departures and self.misfit is None


def judged(fit: Estimate) -> Judgement:
    """The judgement of a fit of geometry, and of the effects that its machine states."""
    return Judgement(_departures(fit), _misfit(fit))


def judged_diagnosis(before: Estimate, after: Estimate, *, named: bool) -> Judgement:
    """The judgement of a diagnosis: of the model that it ends with, and of the one without effects unless what was found
    explains it.

    ``named``: whether anything was found by name. One constant that is grossly wrong may be a number mistyped, which is what
    was to be found; several are another machine.
    """
    found = judged(after)
    if len(found.departures) == 1 and found.departures[0][0] in _constants(after):
        found = Judgement((), found.misfit)
    explained = named and after.chi2_per_dof * GROSS < before.chi2_per_dof
    return found if not found.calibrated or explained else Judgement((), _misfit(before))


def _departures(fit: Estimate) -> tuple[tuple[str, float], ...]:
    """Constants beyond ``GROSS`` tolerances, farthest first. Frames count for nothing: where a base stands is no drawing's."""
    away = dict(zip(fit.prior.names, fit.in_tolerances.tolist(), strict=True))
    tolerances = {p.name: p.tolerance for p in fit.machine.parameters}
    for name, value in _constants(fit).items():
        away[name] += value / tolerances[name]
    gross = [(name, abs(v)) for name, v in away.items() if abs(v) > GROSS and name not in FRAME_OF]
    return tuple(sorted(gross, key=lambda item: -item[1]))


def _constants(fit: Estimate) -> dict[str, float]:
    """Constants that were found wrong, and by how much (mm, rad)."""
    tolerances = {p.name: p.tolerance for p in fit.machine.parameters}
    found = [e for e in fit.fitted_effects() if e.effect.slug == CONSTANT and len(e.place) == 1]
    return {
        e.place[0]: e.values["value"]
        for e in found
        if 0.0 < tolerances.get(e.place[0], 0.0) < float("inf") and "value" in e.values
    }


def _misfit(fit: Estimate) -> Misfit | None:
    """A misfit beyond ``GROSS`` sigmas that the drawing's tolerances do not allow for; None where there is none."""
    expected = 1.0 + _allowed(fit) / max(fit.n_observations, 1)
    if not fit.chi2_per_dof > max(GROSS**2, expected):
        return None
    residual = fit.residual[fit.used]
    return Misfit(
        rms_by_kind(residual, fit.machine.channels),
        float(np.sqrt(fit.chi2_per_dof)),
        float(np.sqrt(expected)),
    )


def _allowed(fit: Estimate) -> float:
    """Expected sum of squares, in sigmas, that constants of the drawing make when they vary by their tolerances."""
    total, steps = 0.0, fit.factor[:, : len(fit.prior.free)]
    parameters = fit.machine.parameters
    for column, k in enumerate(fit.prior.free):
        if (
            k < len(parameters)
            and parameters[k].name not in FRAME_OF
            and np.isfinite(parameters[k].tolerance)
        ):
            size = parameters[k].tolerance / fit.prior.scale[k]
            total += float(np.sum((steps[:, column] * size) ** 2))
    return total


__all__ = ["GROSS", "Judgement", "Misfit", "judged", "judged_diagnosis"]
