"""Figures of a fit: rms of the 3-D norm by kind, validation rms, and the largest parameter against its null.

Whether a fit may be called a calibration: it left its drawing grossly, or no sigma explains what it leaves.

One number decides, ``GROSS``: physics that a model leaves out pushes constants 10 or 20 tolerances away and leaves residuals
of 10 or 30 sigma. A hundred of either is another machine than the file's: a unit, a sign, an order of columns, a frame that
is not there. Where a sigma is a nanometre, residuals of a hundred are ordinary; so they must also be larger than all that the
drawing's tolerances could have made of the readings before anything was fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.estimated import Estimate
from truepose.models.sensors.base import Channel
from truepose.wording import joined

LEVEL, DRAWS, SEED = 0.99, 2000, 7
"""Quantile of the largest departure that a true model is allowed, and the machines that are drawn to find it."""


@dataclass(frozen=True)
class FitSummary:
    """rms by kind (internal units), chi2 per degree of freedom, validation rms, worst parameter."""

    rms: Mapping[str, float]
    chi2_per_dof: float
    validation_rms: Mapping[str, float] | None
    worst_parameter_sigma: float
    worst_parameter: str
    worst_allowed: float


def rms_by_kind(residual: Array, channels: Sequence[Channel], lost: Mask | None = None) -> dict[str, float]:
    """Root of the mean over rows and points of the squared norm (mm, rad); ``residual`` (n, m) is whitened.

    Points of which a reading was ``lost`` (n, m) do not count.
    """
    if lost is not None:
        residual = np.where(lost, np.nan, residual)
    out = {}
    for kind in dict.fromkeys(channel.kind for channel in channels):
        squares = []
        for point in dict.fromkeys(c.point for c in channels if c.kind == kind):
            at = [k for k, c in enumerate(channels) if c.kind == kind and c.point == point]
            squares.append(np.sum((residual[:, at] * [channels[k].sigma for k in at]) ** 2, axis=1))
        values = np.concatenate(squares)
        known = values[np.isfinite(values)]
        out[kind] = float(np.sqrt(np.mean(known))) if known.size else float("nan")
    return out


def worst_allowed(fit: Estimate) -> float:
    """Bootstrap null of the largest |estimate - nominal| / tolerance: what a true model exceeds once in a hundred.

    Under a true model the estimate's departure is N(0, S - C), S tolerances and C the posterior covariance.
    """
    free = fit.prior.free
    tolerance = fit.prior.sigma[free]
    known = np.isfinite(tolerance) & (free < len(fit.nominal.parameters))
    if not known.any():
        return float("inf")
    scaled = fit.posterior_among(known) / np.outer(tolerance[known], tolerance[known])
    return largest_departure(np.eye(int(known.sum())) - scaled)


def largest_departure(covariance: Array) -> float:
    """Return what the largest of several normal numbers of this covariance (n, n) exceeds once in a hundred.

    The symmetric root is one matrix; eigenvectors of equal eigenvalues are any, whatever rounding makes of them.
    """
    values, vectors = np.linalg.eigh(covariance)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    sample = root @ np.random.default_rng(SEED).standard_normal((len(root), DRAWS))
    return float(np.quantile(np.max(np.abs(sample), axis=0), LEVEL))


def summarise(fit: Estimate, validation: Mask) -> FitSummary:
    """All figures of one fit; ``validation`` (n,) are the rows that are never fitted."""
    channels = fit.nominal.channels
    rows = validation & np.isfinite(fit.residual).all(axis=1)
    worst = fit.prior.names[int(np.argmax(np.abs(fit.in_tolerances)))]
    rms = rms_by_kind(fit.residual[fit.used], channels, fit.lost_among(fit.used))
    held = rms_by_kind(fit.residual[rows], channels, fit.lost_among(rows)) if rows.any() else None
    return FitSummary(rms, fit.chi2_per_dof, held, fit.worst_parameter_sigma, worst, worst_allowed(fit))


GROSS = 100.0
"""Tolerances from the drawing, or sigmas of residuals, beyond which a fit is no calibration."""
CONSTANT = "wrong-constant"
REFUSED = "NOT CALIBRATED"
MOST = 3
"""Most constants that are named."""


@dataclass(frozen=True)
class Misfit:
    """What a fit leaves: rms by kind of reading with its unit, the same in sigmas, and what tolerances could have made."""

    rms: Mapping[str, tuple[float, str]]
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

    @property
    def why(self) -> list[str]:
        """The reasons in words, a clause each; empty where there are none."""
        misfit = [] if self.misfit is None else [_misfit_words(self.misfit)]
        return misfit + ([_departure_words(self.departures)] if self.departures else [])

    @property
    def refusal(self) -> str:
        """The first words of what is told of such a fit; nothing of another."""
        return f"{REFUSED}: {'; '.join(self.why)}" if self.why else ""


def judged(fit: Estimate) -> Judgement:
    """The judgement of a fit of geometry and effects.

    One constant that was found grossly wrong may be a number mistyped, which is what was to be found; several are another
    machine.
    """
    departures = _departures(fit)
    if len(departures) == 1 and departures[0][0] in _constants(fit):
        departures = ()
    return Judgement(departures, _misfit(fit))


def judged_diagnosis(before: Estimate, after: Estimate, *, named: bool) -> Judgement:
    """The judgement of a diagnosis: of the model that it ends with, and of the one without effects unless what was found
    explains it.

    ``named``: whether anything was found by name.
    """
    found = judged(after)
    explained = named and after.chi2_per_dof * GROSS < before.chi2_per_dof
    return found if not found.calibrated or explained else Judgement((), _misfit(before))


def _departures(fit: Estimate) -> tuple[tuple[str, float], ...]:
    """Constants beyond ``GROSS`` tolerances, farthest first. Frames count for nothing: where a base stands is no drawing's."""
    away = dict(zip(fit.prior.names, fit.in_tolerances.tolist(), strict=True))
    tolerances = {p.name: p.tolerance for p in fit.nominal.parameters}
    for name, value in _constants(fit).items():
        away[name] += value / tolerances[name]
    standing = {parameter.name for parameter in fit.nominal.frames}
    gross = [(name, abs(v)) for name, v in away.items() if abs(v) > GROSS and name not in standing]
    return tuple(sorted(gross, key=lambda item: -item[1]))


def _constants(fit: Estimate) -> dict[str, float]:
    """Constants that were found wrong, and by how much (mm, rad)."""
    tolerances = {p.name: p.tolerance for p in fit.nominal.parameters}
    found = [e for e in fit.fitted_effects() if e.effect.slug == CONSTANT and len(e.place) == 1]
    return {
        e.place[0]: e.values["value"] for e in found if 0.0 < tolerances.get(e.place[0], 0.0) < float("inf")
    }


def _misfit(fit: Estimate) -> Misfit | None:
    """A misfit beyond ``GROSS`` sigmas that the drawing's tolerances do not allow for; None where there is none."""
    expected = 1.0 + _allowed(fit) / max(fit.n_observations, 1)
    if not fit.chi2_per_dof > max(GROSS**2, expected):
        return None
    units = fit.nominal.residual_units
    rms = rms_by_kind(fit.residual[fit.used], fit.nominal.channels)
    told = {kind: (value, units[kind]) for kind, value in rms.items()}
    return Misfit(told, float(np.sqrt(fit.chi2_per_dof)), float(np.sqrt(expected)))


def _allowed(fit: Estimate) -> float:
    """Expected sum of squares, in sigmas, that constants of the drawing make when they vary by their tolerances."""
    total, steps = 0.0, fit.slopes
    parameters = fit.nominal.parameters
    for column, k in enumerate(fit.prior.free):
        own = k < len(parameters) and parameters[k] not in fit.nominal.frames
        if own and np.isfinite(parameters[k].tolerance):
            size = parameters[k].tolerance / fit.prior.scale[k]
            total += float(np.sum((steps[:, column] * size) ** 2))
    return total


def _misfit_words(misfit: Misfit) -> str:
    rms = joined(f"{kind} {_number(value)} {unit}" for kind, (value, unit) in misfit.rms.items())
    allowed = _number(misfit.expected)
    return (
        f"it leaves {rms} rms, {_number(misfit.sigmas)} sigma, where the drawing's tolerances allow {allowed}"
    )


def _departure_words(departures: tuple[tuple[str, float], ...]) -> str:
    told = [f"{name} by {_number(value)}" for name, value in departures[:MOST]]
    more = [f"{len(departures) - MOST} more"] if len(departures) > MOST else []
    return f"it left its drawing: {joined([*told, *more])} tolerances"


def _number(value: float) -> str:
    return f"{value:,.0f}" if 100.0 <= value < 1e6 else f"{value:.3g}"
