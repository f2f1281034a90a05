"""The fits side by side, as the tables and figures want them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import FitSummary, rms_by_kind
from truepose.models.machine.machine import Machine

NAMES = {
    "free": ("free fit", "ordinary fit, parameters free"),
    "before": ("tolerances", "under tolerances, no effects"),
    "calibrated": ("calibrated", "calibrated, under tolerances"),
    "after": ("with effects", "under tolerances, with effects"),
}


@dataclass(frozen=True)
class FitColumn:
    """One fit: names, rms in sigma of calibration and validation rows (None without any), other figures."""

    key: str
    short: str
    name: str
    sigma: tuple[float | None, float | None]
    summary: FitSummary

    @property
    def rms(self) -> Mapping[str, float]:
        """rms by kind of the calibration rows, in the units of the channels."""
        return self.summary.rms

    def rms_of(self, role: int, kind: str) -> float | None:
        """rms of a kind on calibration (0) or validation (1) rows."""
        figures = self.summary.rms if role == 0 else self.summary.validation_rms
        return None if figures is None else figures.get(kind)


def fit_column(key: str, fit: Estimate, summary: FitSummary, validation: Mask) -> FitColumn:
    """One fit of the three; ``validation`` (n,) are rows never fitted."""
    return FitColumn(
        key, *NAMES[key], (_rms(fit.residual[fit.used]), _rms(fit.residual[validation])), summary
    )


def fit_columns(diagnosis: Diagnosis) -> list[FitColumn]:
    """Free, before, and after where an effect was added."""
    keys = ["free", "before", *(["after"] if diagnosis.terms else [])]
    fits = {"free": diagnosis.free, "before": diagnosis.before, "after": diagnosis.after}
    validation = diagnosis.recording.validation
    return [fit_column(k, fits[k], diagnosis.fits[k], validation) for k in keys if k in diagnosis.fits]


def stated_noise(machine: Machine) -> dict[str, float]:
    """What the stated sigmas make of each kind's norm, in its unit: root of the summed squares of a point."""
    return rms_by_kind(np.ones((1, len(machine.channels))), machine.channels)


def _rms(residual: Array) -> float | None:
    values = residual[np.isfinite(residual) & (residual != 0.0)]  # a row that refers to itself reads nothing
    return float(np.sqrt(np.mean(values**2))) if values.size else None
