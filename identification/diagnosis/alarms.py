"""Three alarms: lack of fit of the free fit, conflict with tolerances, structure in the residuals.

Each statistic's distribution when nothing is missing is known for a linear Gaussian model or drawn from it
(parametric bootstrap); p-values are those of that null.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from itertools import islice

import numpy as np
import pandas as pd
from scipy.stats import chi2
from scipy.stats import f as fisher

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.diagnosis.conflict import conflict_with_tolerances
from truepose.identification.diagnosis.outliers import CHANCE
from truepose.identification.diagnosis.structure_sums import Functions, StructureSums
from truepose.identification.fit.estimate import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.empirical import orthonormal, powers, scaled, waves

SIGMA_OFF = 3.0
"""A stated sigma may be wrong by so much."""
MIN_REPLICATES = 8
"""Degrees of freedom from which on replicates say how large the noise is."""
DRAWS, SEED = 300, 1
"""Random draws that judge residuals, and their seed."""
LARGEST_PROJECTION = 30_000_000
"""Entries of a Jacobian beyond which draws go without it."""
TOGETHER = 4_000_000
"""Numbers of random draws that are held at a time."""


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
    if recording.pose is None:
        return 1.0, 0
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
    r = _standard(fit.residual[fit.used])
    order = _order(fit, recording) if recording.ordered else None
    by_rows = fit.n_observations * len(fit.prior.free) <= LARGEST_PROJECTION
    observed, draws, explained = (
        _by_rows(fit, recording, r) if by_rows else _by_sums(fit, recording, r, order)
    )
    worst = max(observed, key=lambda name: observed[name])
    largest = observed[worst]
    p = (1 + int(np.sum(draws >= largest))) / (1 + len(draws))
    if p <= 2.0 / (1 + len(draws)):  # beyond the draws: Bonferroni over the tests
        p = min(p, 10**-largest * len(observed))
    share = explained.get(worst, 0.0) / max(float(np.sum(r**2)), 1e-300)
    return Alarm(largest, float(p), worst, share)


def _by_rows(
    fit: Estimate, recording: Recording, r: Array
) -> tuple[dict[str, float], Array, dict[str, float]]:
    """Tests of residuals (n, m), the largest of them in random draws (d,), and the sum of squares along each driver."""
    lost = fit.lost_among(fit.used)
    told = 1.0 if lost is None else (~lost).astype(float)
    bases = {
        name: orthonormal(one.made(one.values)[: one.width - 1])
        for name, one in _functions(fit, recording).items()
    }
    order = _order(fit, recording)
    neighbours = order if recording.ordered else None
    observed = _tests(r[None], bases, neighbours)
    rng = np.random.default_rng(SEED)
    project = projector(fit, recording)
    back = np.argsort(order)  # noise is drawn in the order of acquisition: shuffled rows get the same draws
    drawn = (rng.standard_normal(r.shape)[back] for _ in range(draws_for(r)))
    largest = list[Array]()
    while some := list(islice(drawn, max(1, TOGETHER // max(r.size, 1)))):
        noise = [_standard(left * told) for left in project(np.array(some))]
        largest.append(np.max(list(_tests(np.array(noise), bases, neighbours).values()), axis=0))
    along = {name: float(np.sum((basis.T @ r) ** 2)) for name, basis in bases.items()}
    return {name: float(value[0]) for name, value in observed.items()}, np.concatenate(largest), along


def _by_sums(
    fit: Estimate, recording: Recording, r: Array, order: Index | None
) -> tuple[dict[str, float], Array, dict[str, float]]:
    """The same of so many rows that what a fit takes of noise is nothing beside it."""
    sums = StructureSums.of(r, _functions(fit, recording), order)
    along = {name: float(np.sum(sums.along[span] ** 2)) for name, span in sums.spans.items()}
    return sums.tests(), sums.null(DRAWS, SEED), along


def _standard(residual: Array) -> Array:
    """Channels of unit rms, far values pulled in: heavy tails are no structure."""
    scale = np.sqrt(np.mean(residual**2, axis=0))
    return np.clip(residual / np.where(scale > 0, scale, 1.0), -3.5, 3.5)


def draws_for(r: Array) -> int:
    """How many random draws judge residuals (n, m): fewer of many readings."""
    return DRAWS if r.size < 50_000 else 60


def _order(fit: Estimate, recording: Recording) -> Index:
    """Places of the fitted rows, among themselves, in the order of acquisition."""
    place = np.cumsum(fit.used) - 1
    return np.asarray(place[recording.in_time(fit.used)])


def _functions(fit: Estimate, recording: Recording) -> dict[str, Functions]:
    """Functions of each recorded driver in the fitted rows: three powers and two waves over its range."""
    out = {}
    for name, column in recording.columns().items():
        values = column[fit.used]
        low, high = float(values.min()), float(values.max())
        if low < high:
            few = len(np.unique(np.round(scaled(values, low, high), 9))) - 1
            made = partial(_powers_and_waves, low=low, high=high)
            out[name] = Functions(values, 1 + max(1, min(few, 7)), made)
    return out


def _powers_and_waves(values: Array, low: float, high: float) -> list[Array]:
    t = scaled(values, low, high)
    return [*powers(t, 3), *waves(t, 1), *waves(t, 2)]


def _tests(r: Array, bases: Mapping[str, Array], order: Index | None) -> dict[str, Array]:
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
    """What a fit under tolerances leaves of random residuals (n, m), or of several (b, n, m): noise - J A^-1 J' noise (whole
    when J is too large to hold)."""
    free = fit.prior.free
    if fit.n_observations * len(free) > LARGEST_PROJECTION:
        return lambda noise: noise
    predictor = Predictor(fit.nominal, recording, fit.effects)
    # of A = J'J + prior one factor serves all draws; the fit's own factor has J'J
    root = fit.known.step_root
    rows = [fit.by_steps(block)[fit.used[block.rows]] for block in predictor.blocks(fit.p, fit.x, fit.used)]
    slopes = np.concatenate(rows).reshape(-1, len(root))

    def left(noise: Array) -> Array:
        each = noise.reshape(-1, len(slopes)).T
        return np.asarray((each - slopes @ (root @ (root.T @ (slopes.T @ each)))).T.reshape(noise.shape))

    return left
