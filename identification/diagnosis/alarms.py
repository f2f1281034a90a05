"""Three alarms: lack of fit of the free fit, conflict with tolerances, structure in the residuals.

Each statistic's distribution when nothing is missing is known for a linear Gaussian model or drawn from it
(parametric bootstrap); p-values are those of that null.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as fisher

from truepose.identification.diagnosis.conflict import conflict_with_tolerances
from truepose.identification.fit.estimate import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.smooth import orthonormal, powers, scaled, waves

Array = NDArray[np.float64]
RAISED = 0.01
DRAWS, SEED = 300, 1
MIN_REPLICATES = 8
LARGEST_PROJECTION = 30_000_000


@dataclass(frozen=True)
class Alarm:
    """A statistic, its p-value when nothing is missing, and whether that is below 1 %."""

    statistic: float
    p: float
    about: str = ""

    @property
    def raised(self) -> bool:
        """p below 1 %."""
        return self.p < RAISED


@dataclass(frozen=True)
class Noise:
    """Noise scale from replicates: rms of pure error in units of sigma, degrees of freedom."""

    scale: float
    dof: int


def replicate_noise(fit: Estimate, recording: Recording) -> Noise:
    """Pure error: scatter of residuals among rows of the same pose (all model error is alike there)."""
    labels = recording.replicates()[fit.used]
    residual = fit.residual[fit.used]
    lost = fit.lost_among(fit.used)
    told = np.ones(residual.shape, dtype=bool) if lost is None else ~lost
    total, dof = 0.0, 0
    order = np.argsort(labels, kind="stable")
    for group in np.split(order, np.flatnonzero(np.diff(labels[order])) + 1):
        if len(group) > 1:
            own, count = told[group], told[group].sum(axis=0)
            mean = np.sum(residual[group] * own, axis=0) / np.maximum(count, 1)
            total += float(np.sum(((residual[group] - mean) * own) ** 2))
            dof += int(np.sum(np.maximum(count - 1, 0)))
    return Noise(np.sqrt(total / dof) if dof else 1.0, dof)


def residual_alarm(free: Estimate, recording: Recording) -> Alarm:
    """Lack of fit of the free fit: against replicates where there are enough, else against the stated sigma."""
    dof = max(free.n_observations - free.effective_parameters, 1.0)
    noise = replicate_noise(free, recording)
    ratio = free.chi2 / dof
    if noise.dof >= MIN_REPLICATES and dof - noise.dof >= 1.0:
        pure = noise.scale**2 * noise.dof
        lack = max(free.chi2 - pure, 0.0) / (dof - noise.dof)
        return Alarm(
            ratio,
            float(fisher.sf(lack / max(noise.scale**2, 1e-300), dof - noise.dof, noise.dof)),
            "replicates",
        )
    return Alarm(ratio, float(chi2.sf(free.chi2, dof)), "stated sigma")


def prior_conflict(lin: Linearisation, noise: float) -> Alarm:
    """Conflict of identifiable combinations, and of the readings at the drawing, with tolerances; ``noise`` scales sigma."""
    found = conflict_with_tolerances(lin, noise)
    return Alarm(found.statistic, found.p, "tolerances")


@dataclass(frozen=True)
class Structure:
    """The alarm and what drives the remainder most: driver name, its log10 p, share of the residual it explains."""

    alarm: Alarm
    driver: str
    log10_p: float
    share: float


def structure_alarm(fit: Estimate, recording: Recording) -> Structure:
    """Runs, order and driver tests on whitened residuals, the largest of them judged against random draws."""
    residual = fit.residual[fit.used]
    lost = fit.lost_among(fit.used)
    told = 1.0 if lost is None else (~lost).astype(float)
    r = _standard(residual)
    bases = _bases(fit, recording)
    order = _order(fit, recording)
    observed = _tests(r[None], bases, order)
    rng = np.random.default_rng(SEED)
    project = projector(fit, recording)
    back = np.argsort(order)  # noise is drawn in the order of acquisition: shuffled rows get the same draws
    drawn = (project(rng.standard_normal(r.shape)[back]) for _ in range(draws_for(r)))
    null = _tests(np.array([_standard(noise * told) for noise in drawn]), bases, order)
    draws = np.max(list(null.values()), axis=0)
    worst = max(observed, key=lambda name: float(observed[name][0]))
    largest = float(observed[worst][0])
    p = (1 + int(np.sum(draws >= largest))) / (1 + len(draws))
    if p <= 2.0 / (1 + len(draws)):  # beyond the draws: Bonferroni over the tests
        p = min(p, 10**-largest * len(observed))
    share = _share(r, bases[worst]) if worst in bases else 0.0
    return Structure(Alarm(largest, float(p), worst), worst, largest, share)


def _standard(residual: Array) -> Array:
    """Channels of unit rms, far values pulled in: heavy tails are no structure."""
    scale = np.sqrt(np.mean(residual**2, axis=0))
    return np.clip(residual / np.where(scale > 0, scale, 1.0), -3.5, 3.5)


def draws_for(r: Array) -> int:
    """How many random draws judge residuals (n, m): fewer of many readings."""
    return DRAWS if r.size < 50_000 else 60


def _order(fit: Estimate, recording: Recording) -> NDArray[np.intp]:
    """Places of the fitted rows, among themselves, in the order of acquisition."""
    place = np.cumsum(fit.used) - 1
    return np.asarray(place[recording.order[fit.used[recording.order]]])


def _bases(fit: Estimate, recording: Recording) -> dict[str, Array]:
    """Orthonormal functions (n, k) of each recorded driver: three powers and two waves over its range."""
    out = {}
    for name, column in recording.columns().items():
        values = column[fit.used]
        low, high = float(values.min()), float(values.max())
        if low == high:
            continue
        t = scaled(values, low, high)
        few = len(np.unique(np.round(t, 9))) - 1
        functions = [*powers(t, 3), *waves(t, 1), *waves(t, 2)]
        out[name] = orthonormal(functions[: max(1, few)])
    return out


def _tests(r: Array, bases: Mapping[str, Array], order: NDArray[np.intp]) -> dict[str, Array]:
    """-log10 p (b,) of each test on residuals (b, n, m): each driver's functions, and neighbours in time."""
    out = {}
    flat = r.transpose(1, 0, 2).reshape(r.shape[1], -1)
    for name, basis in bases.items():
        squares = np.sum((basis.T @ flat) ** 2, axis=0).reshape(len(r), -1)
        out[name] = -chi2.logsf(squares.sum(axis=1), basis.shape[1] * r.shape[2]) / np.log(10)
    if r.shape[1] > 10:
        ordered = r[:, order]
        lag = np.sum(ordered[:, 1:] * ordered[:, :-1], axis=(1, 2)) / np.sqrt(ordered[0, 1:].size)
        out["order"] = -chi2.logsf(lag**2, 1) / np.log(10)
    return out


def _share(r: Array, basis: Array) -> float:
    return float(np.sum((basis.T @ r) ** 2) / max(np.sum(r**2), 1e-300))


def projector(fit: Estimate, recording: Recording) -> Callable[[Array], Array]:
    """What a fit under tolerances leaves of random residuals: noise - J A^-1 J' noise (whole when J is too large to hold)."""
    free = fit.prior.free
    if fit.n_observations * len(free) > LARGEST_PROJECTION:
        return lambda noise: noise
    predictor = Predictor(fit.machine, recording, fit.effects)
    rows = [
        block.jacobian[fit.used[block.rows]][:, :, free] * fit.prior.scale[free]
        for block in predictor.blocks(fit.p, fit.x, fit.used)
    ]
    jacobian = np.concatenate(rows).reshape(-1, len(free))
    q, _ = np.linalg.qr(np.vstack([jacobian, np.diag(fit.prior_weight)]))
    top = q[: len(jacobian)]

    def apply(noise: Array) -> Array:
        out: Array = (noise.ravel() - top @ (top.T @ noise.ravel())).reshape(noise.shape)
        return out

    return apply
