"""Three alarms: lack of fit of the free fit, conflict with tolerances, structure in the residuals.

Each statistic's distribution when nothing is missing is known for a linear Gaussian model or drawn from it
(parametric bootstrap); p-values are those of that null.

The conflict is linear algebra on one Gram matrix of [J r]. In steps of tolerances, an identifiable combination of
parameters with information h departs from the drawing, in the least-squares sense, with variance 1 + 1/h when
nothing is missing; the readings at the drawing values have covariance k^2 I + J S J'. The noise k is that of the
free fit, which makes neither statistic exactly chi2: machines are drawn from their tolerances, readings from
the noise, and both go through the same steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import chi2
from scipy.stats import f as fisher

from truepose.identification.diagnosis.outliers import CHANCE
from truepose.identification.fit.estimate import FREE_WIDENING, Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.smooth import orthonormal, powers, scaled, waves

Array = NDArray[np.float64]
RAISED = 0.01
"""p below which an alarm is raised."""
SIGMA_OFF = 3.0
"""A stated sigma may be wrong by so much."""
MIN_REPLICATES = 8
"""Degrees of freedom from which on replicates say how large the noise is."""
DRAWS, SEED = 300, 1
"""Random draws that judge residuals, and their seed."""
LARGEST_PROJECTION = 30_000_000
"""Entries of a Jacobian beyond which draws go without it."""
MACHINES, MACHINES_SEED = 999, 17
"""Machines that are drawn from their tolerances, and their seed."""


@dataclass(frozen=True)
class Alarm:
    """A statistic, its p-value when nothing is missing, what it is about, and the share of the residual that this explains."""

    statistic: float
    p: float
    about: str = ""
    share: float = 0.0

    @property
    def raised(self) -> bool:
        """p below 1 %."""
        return self.p < RAISED


def alarms_of(
    ordinary: Estimate, fit: Estimate, lin: Linearisation, recording: Recording
) -> dict[str, Alarm]:
    """Of ``fit``, with ``lin`` there; ``ordinary`` is the fit whose misfit counts, and says how large the noise is."""
    noise = max(float(np.sqrt(max(ordinary.chi2_per_dof, 1e-300))), 1.0)
    return {
        "residual": residual_alarm(ordinary, recording),
        "prior_conflict": conflict_with_tolerances(lin, noise),
        "structure": structure_alarm(fit, recording),
    }


def misfits(alarms: Mapping[str, Alarm]) -> bool:
    """Whether a model lacks fit against replicates, or by more than a stated sigma wrong by three would make."""
    lack = alarms["residual"]
    return lack.p < CHANCE and (lack.about == "replicates" or lack.statistic > SIGMA_OFF**2)


def replicate_noise(fit: Estimate, recording: Recording) -> tuple[float, int]:
    """Noise in units of sigma, and its degrees of freedom, from pure error: scatter among rows of the same pose.

    All model error is alike there.
    """
    residual, lost = fit.residual[fit.used], fit.lost_among(fit.used)
    read = pd.DataFrame(residual if lost is None else np.where(lost, np.nan, residual))
    poses = read.groupby(recording.replicates()[fit.used])
    dof = int(np.maximum(poses.count().to_numpy() - 1, 0).sum())
    total = float(np.nansum((read - poses.transform("mean")).to_numpy() ** 2))
    return float(np.sqrt(total / dof)) if dof else 1.0, dof


def residual_alarm(free: Estimate, recording: Recording) -> Alarm:
    """Lack of fit of the free fit: against replicates where there are enough, else against the stated sigma."""
    dof = max(free.n_observations - free.effective_parameters, 1.0)
    noise, repeats = replicate_noise(free, recording)
    ratio, rest = free.chi2 / dof, dof - repeats
    if repeats >= MIN_REPLICATES and rest >= 1.0:
        lack = max(free.chi2 - noise**2 * repeats, 0.0) / rest
        p = float(fisher.sf(lack / max(noise**2, 1e-300), rest, repeats))
        return Alarm(ratio, p, "replicates")
    return Alarm(ratio, float(chi2.sf(free.chi2, dof)), "stated sigma")


def structure_alarm(fit: Estimate, recording: Recording) -> Alarm:
    """Runs, order and driver tests on whitened residuals, the largest of them judged against random draws.

    It is about what drives the residuals most.
    """
    residual = fit.residual[fit.used]
    lost = fit.lost_among(fit.used)
    told = 1.0 if lost is None else (~lost).astype(float)
    r = _standard(residual)
    bases = _bases(fit, recording)
    order = _order(fit, recording)
    neighbours = order if recording.ordered else None
    observed = _tests(r[None], bases, neighbours)
    rng = np.random.default_rng(SEED)
    project = projector(fit, recording)
    back = np.argsort(order)  # noise is drawn in the order of acquisition: shuffled rows get the same draws
    drawn = (project(rng.standard_normal(r.shape)[back]) for _ in range(draws_for(r)))
    null = _tests(np.array([_standard(noise * told) for noise in drawn]), bases, neighbours)
    draws = np.max(list(null.values()), axis=0)
    worst = max(observed, key=lambda name: float(observed[name][0]))
    largest = float(observed[worst][0])
    p = (1 + int(np.sum(draws >= largest))) / (1 + len(draws))
    if p <= 2.0 / (1 + len(draws)):  # beyond the draws: Bonferroni over the tests
        p = min(p, 10**-largest * len(observed))
    along = bases[worst].T @ r if worst in bases else np.zeros(0)
    return Alarm(largest, float(p), worst, float(np.sum(along**2) / max(np.sum(r**2), 1e-300)))


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
    return np.asarray(place[recording.in_time(fit.used)])


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


def _tests(r: Array, bases: Mapping[str, Array], order: NDArray[np.intp] | None) -> dict[str, Array]:
    """-log10 p (b,) of each test on residuals (b, n, m): each driver's functions, and neighbours in time where known."""
    out = {}
    flat = r.transpose(1, 0, 2).reshape(r.shape[1], -1)
    for name, basis in bases.items():
        squares = np.sum((basis.T @ flat) ** 2, axis=0).reshape(len(r), -1)
        out[name] = -chi2.logsf(squares.sum(axis=1), basis.shape[1] * r.shape[2]) / np.log(10)
    if order is not None and r.shape[1] > 10:
        ordered = r[:, order]
        lag = np.sum(ordered[:, 1:] * ordered[:, :-1], axis=(1, 2)) / np.sqrt(ordered[0, 1:].size)
        out["order"] = -chi2.logsf(lag**2, 1) / np.log(10)
    return out


def projector(fit: Estimate, recording: Recording) -> Callable[[Array], Array]:
    """What a fit under tolerances leaves of random residuals: noise - J A^-1 J' noise (whole when J is too large to hold)."""
    free = fit.prior.free
    if fit.n_observations * len(free) > LARGEST_PROJECTION:
        return lambda noise: noise
    predictor = Predictor(fit.machine, recording, fit.effects)
    # of A = J'J + prior one factor serves all draws; the fit's own factor has J'J
    root = fit.known.step_root
    rows = [
        fit.by_steps(block)[fit.used[block.rows]] @ root for block in predictor.blocks(fit.p, fit.x, fit.used)
    ]
    turned = np.concatenate(rows).reshape(-1, root.shape[1])
    return lambda noise: np.asarray(noise.ravel() - turned @ (turned.T @ noise.ravel())).reshape(noise.shape)


@dataclass(frozen=True)
class _Seen:
    """Combinations that readings see, in tolerances at unit noise: information h (m,), and what to project by.

    ``known`` and ``unknown`` index geometry with and without a tolerance; ``solve`` inverts the latter's
    information, which is projected out.
    """

    lin: Linearisation
    known: NDArray[np.intp]
    unknown: NDArray[np.intp]
    solve: Array
    weight: Array
    information: Array
    vectors: Array

    @classmethod
    def of(cls, lin: Linearisation) -> _Seen:
        """Of free geometry."""
        n, weight, gram = lin.free, lin.weight, lin.gram
        known, unknown = np.flatnonzero(weight > 0), np.flatnonzero(weight == 0)
        h, across = gram[:n, :n], gram[np.ix_(known, unknown)]
        solve = np.linalg.pinv(h[np.ix_(unknown, unknown)], rcond=1e-12, hermitian=True)
        reduced = h[np.ix_(known, known)] - across @ solve @ across.T
        values, vectors = np.linalg.eigh(reduced / np.outer(weight[known], weight[known]))
        seen = values > max(1e-6, 1e-10 * float(np.max(values, initial=0.0)))
        return cls(
            lin, known, unknown, np.asarray(solve, dtype=float), weight[known], values[seen], vectors[:, seen]
        )

    def squares(self, cross: Array, square: Array) -> tuple[Array, Array]:
        """(b, m) squared components of J'e in each combination over its h, and (b,) squared length left of e."""
        pull = cross[:, self.unknown] @ self.solve
        left = square - np.sum(pull * cross[:, self.unknown], axis=1)
        own = cross[:, self.known] - pull @ self.lin.among(self.unknown, self.known)
        z = (own / self.weight) @ self.vectors
        return z**2 / self.information, left

    def draws(self, noise: float) -> tuple[Array, Array]:
        """Squares and lengths (as above) of drawn machines with readings drawn around them."""
        rng, count, m = np.random.default_rng(MACHINES_SEED), MACHINES, len(self.information)
        departure = rng.standard_normal((count, m)) * np.sqrt(self.information)
        error = noise * rng.standard_normal((count, m))
        rest = max(self.lin.n_observations - len(self.unknown) - m, 0)
        squares = (departure + error) ** 2
        return squares, squares.sum(axis=1) + noise**2 * rng.chisquare(max(rest, 1e-9), count)

    def noise(self, squares: Array, length: Array) -> Array:
        """(b,) noise scale of the free fit, at least the stated one."""
        share = self.information * FREE_WIDENING**2
        share = share / (1.0 + share)
        dof = max(self.lin.n_observations - len(self.unknown) - float(np.sum(share)), 1.0)
        found = np.sqrt(np.maximum(length - squares @ share, 0.0) / dof)
        return np.asarray(np.maximum(found, 1.0), dtype=float)

    def tests(self, squares: Array, length: Array, noise: Array) -> tuple[Array, Array]:
        """(b,) sum of squares of the combinations, and log of the smaller chi2 p of the two tests."""
        h = self.information / noise[:, None] ** 2
        z2 = squares / noise[:, None] ** 2
        conflict = np.sum(z2 / (1.0 + h), axis=1)
        predictive = length / noise**2 - np.sum(z2 * h / (1.0 + h), axis=1)
        count = max(self.lin.n_observations - len(self.unknown), 1)
        first = chi2.logsf(conflict, max(len(self.information), 1))
        second = chi2.logsf(np.maximum(predictive, 0.0), count)
        return conflict, np.minimum(first, second)


def conflict_with_tolerances(lin: Linearisation, noise: float) -> Alarm:
    """The smaller p of two tests, against machines drawn from their tolerances.

    The tests: identifiable combinations against their tolerances, and the prior-predictive e' V^-1 e. ``noise``
    (at least 1) scales sigma. Beyond the draws p is twice the smaller one of chi2.
    """
    lin = lin.bare()  # effects of the fit stay in the model: only geometry is taken back to the drawing
    seen, gram = _Seen.of(lin), lin.gram
    shift = np.append(lin.departure, 0.0)
    cross = (gram[:, -1] - gram @ shift)[:-1]
    square = float(gram[-1, -1] - 2 * shift @ gram[:, -1] + shift @ gram @ shift)
    statistic, log_p = seen.tests(*seen.squares(cross[None], np.array([square])), np.array([noise]))
    drawn = seen.draws(noise)
    _, null = seen.tests(*drawn, seen.noise(*drawn))
    beyond = int(np.sum(null <= log_p[0]))
    p = (1 + beyond) / (1 + MACHINES) if beyond else min(2.0 * float(np.exp(log_p[0])), 1 / (1 + MACHINES))
    return Alarm(float(statistic[0]), p, "tolerances")
