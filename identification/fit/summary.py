"""Figures of a fit: rms of the 3-D norm by kind, validation rms, and the largest parameter against its null."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.estimate import Estimate
from truepose.models.machine.sensor import Channel

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
        out[kind] = (
            float(np.sqrt(np.mean(values[np.isfinite(values)])))
            if np.isfinite(values).any()
            else float("nan")
        )
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
    values, vectors = np.linalg.eigh(np.eye(int(known.sum())) - scaled)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    sample = root @ np.random.default_rng(SEED).standard_normal((root.shape[1], DRAWS))
    return float(np.quantile(np.max(np.abs(sample), axis=0), LEVEL))


def summarise(fit: Estimate, validation: Mask) -> FitSummary:
    """All figures of one fit; ``validation`` (n,) are the rows that are never fitted."""
    channels = fit.nominal.channels
    rows = validation & np.isfinite(fit.residual).all(axis=1)
    away = np.abs(fit.in_tolerances)
    return FitSummary(
        rms=rms_by_kind(fit.residual[fit.used], channels, fit.lost_among(fit.used)),
        chi2_per_dof=fit.chi2_per_dof,
        validation_rms=rms_by_kind(fit.residual[rows], channels, fit.lost_among(rows))
        if rows.any()
        else None,
        worst_parameter_sigma=fit.worst_parameter_sigma,
        worst_parameter=fit.prior.names[int(np.argmax(away))],
        worst_allowed=worst_allowed(fit),
    )
