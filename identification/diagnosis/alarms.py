"""Three alarms: lack of fit of the free fit, conflict with tolerances, structure in the residuals.

Each statistic's distribution when nothing is missing is known for a linear Gaussian model or drawn from it
(parametric bootstrap); p-values are those of that null.

Tests of structure in the residuals of very many rows, from sums over them: see ``alarms.structure_alarm``.

With functions F (n, k) of a driver, F'F = L L', the orthonormal ones have Q'r = L^-1 F'r. For white noise r of variance one
Q'r is normal, with the covariance Q'Q between drivers, and so is the sum of products of neighbours over the root of their
number: what chance makes is drawn from these few numbers. Rows are visited once, some at a time.

The alarm of a conflict with tolerances.

The conflict is linear algebra on one Gram matrix of [J r]. In steps of tolerances, an identifiable combination of
parameters with information h departs from the drawing, in the least-squares sense, with variance 1 + 1/h when
nothing is missing; the readings at the drawing values have covariance k^2 I + J S J'. The noise k is that of the
free fit, which makes neither statistic exactly chi2: machines are drawn from their tolerances, readings from
the noise, and both go through the same steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice

import numpy as np
import pandas as pd
from scipy.linalg import solve_triangular
from scipy.stats import chi2
from scipy.stats import f as fisher

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.null_fits import CHANCE
from truepose.identification.diagnosis.result import Alarm
from truepose.identification.fit.estimate import FREE_WIDENING
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import TOGETHER
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.polynomials import orthonormal, powers, scaled, waves


@dataclass(frozen=True)
class Functions:
    """The constant and ``width`` - 1 functions of a driver's values (n,), by name of the driver; written out for some rows."""

    values: Array
    width: int
    made: Callable[[Array], Sequence[Array]]

    def at(self, rows: slice) -> Array:
        """(k, width) of some rows."""
        values = self.values[rows]
        return np.column_stack([np.ones(len(values)), *self.made(values)])[:, : self.width]


class StructureSums:
    """Of residuals (n, m) of unit rms: Q'r (k, m) of all drivers, their spans among the k, Q'Q (k, k), and the sum of products
    of neighbours over the root of their number, None where rows have no order."""

    def __init__(self, residual: Array, functions: Mapping[str, Functions], order: Index | None) -> None:
        """``order`` (n,): indices that put rows in the order of acquisition."""
        width = sum(one.width for one in functions.values())
        squares, products = np.zeros((width, width)), np.zeros((width, residual.shape[1]))
        for start in range(0, len(residual), TOGETHER):
            rows = slice(start, start + TOGETHER)
            phi = np.hstack([one.at(rows) for one in functions.values()])
            squares += phi.T @ phi
            products += phi.T @ residual[rows]
        turn, self.spans = _orthonormal(squares, functions)
        self.along, self.among = turn @ products, turn @ squares @ turn.T
        self.lag: float | None = None
        if order is not None:
            total = 0.0
            for start in range(0, len(order) - 1, TOGETHER):
                here = residual[order[start : start + TOGETHER + 1]]
                total += float(np.sum(here[1:] * here[:-1]))
            self.lag = total / float(np.sqrt((len(order) - 1) * residual.shape[1]))

    def tests(self) -> dict[str, float]:
        """-log10 p of each test."""
        lag = None if self.lag is None else np.array([self.lag])
        return {name: float(value[0]) for name, value in self._tests(self.along[None], lag).items()}

    def null(self, draws: int, seed: int) -> Array:
        """(draws,) the largest -log10 p of all tests where nothing but chance is there."""
        rng, (k, m) = np.random.default_rng(seed), self.along.shape
        values, vectors = np.linalg.eigh(self.among)  # functions of two drivers may depend on each other
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        drawn = root @ rng.standard_normal((draws, k, m))
        lag = None if self.lag is None else rng.standard_normal(draws)
        return np.asarray(np.max(list(self._tests(drawn, lag).values()), axis=0))

    def _tests(self, along: Array, lag: Array | None) -> dict[str, Array]:
        """(d,) each, of d sets of sums ``along`` (d, k, m)."""
        out = {}
        for name, span in self.spans.items():
            squares = np.sum(along[:, span] ** 2, axis=(1, 2))
            out[name] = -chi2.logsf(squares, (span.stop - span.start) * along.shape[2]) / np.log(10)
        if lag is not None:
            out["order"] = -chi2.logsf(lag**2, 1) / np.log(10)
        return out


def _orthonormal(squares: Array, functions: Mapping[str, Functions]) -> tuple[Array, dict[str, slice]]:
    """(k, w) from all functions to the orthonormal ones of each driver without its constant, and each driver's span of k."""
    turn, spans, row, at = np.zeros_like(squares), dict[str, slice](), 0, 0
    for name, one in functions.items():
        own = slice(at, at := at + one.width)
        root = np.linalg.cholesky(squares[own, own])
        spans[name] = slice(row, row := row + one.width - 1)
        turn[spans[name], own] = solve_triangular(root, np.eye(one.width), lower=True)[1:]
    return turn[:row], spans


MACHINES, MACHINES_SEED = 999, 17
"""Machines that are drawn from their tolerances, and their seed."""


class _Seen:
    """Combinations that readings see, in tolerances at unit noise: information h (m,), and what to project by.

    ``known`` and ``unknown`` index geometry with and without a tolerance; ``solve`` inverts the latter's
    information, which is projected out.
    """

    def __init__(self, lin: Linearisation) -> None:
        n, weight, gram = lin.free, lin.weight, lin.gram
        known, unknown = np.flatnonzero(weight > 0), np.flatnonzero(weight == 0)
        h, across = gram[:n, :n], gram[np.ix_(known, unknown)]
        solve = np.linalg.pinv(h[np.ix_(unknown, unknown)], rcond=1e-12, hermitian=True)
        reduced = h[np.ix_(known, known)] - across @ solve @ across.T
        values, vectors = np.linalg.eigh(reduced / np.outer(weight[known], weight[known]))
        seen = values > max(1e-6, 1e-10 * float(np.max(values, initial=0.0)))
        self.known, self.unknown, self.solve, self.weight = known, unknown, np.asarray(solve), weight[known]
        self.lin, self.information, self.vectors = lin, values[seen], vectors[:, seen]

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
    seen, gram = _Seen(lin), lin.gram
    shift = np.append(lin.departure, 0.0)
    cross = (gram[:, -1] - gram @ shift)[:-1]
    square = float(gram[-1, -1] - 2 * shift @ gram[:, -1] + shift @ gram @ shift)
    statistic, log_p = seen.tests(*seen.squares(cross[None], np.array([square])), np.array([noise]))
    drawn = seen.draws(noise)
    _, null = seen.tests(*drawn, seen.noise(*drawn))
    beyond = int(np.sum(null <= log_p[0]))
    p = (1 + beyond) / (1 + MACHINES) if beyond else min(2.0 * float(np.exp(log_p[0])), 1 / (1 + MACHINES))
    return Alarm(float(statistic[0]), p, "tolerances")


SIGMA_OFF = 3.0
"""A stated sigma may be wrong by so much."""
MIN_REPLICATES = 8
"""Degrees of freedom from which on replicates say how large the noise is."""
DRAWS, SEED = 300, 1
"""Random draws that judge residuals, and their seed."""
LARGEST_PROJECTION = 30_000_000
"""Entries of a Jacobian beyond which draws go without it."""
DRAWN_TOGETHER = 4_000_000
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
    if by_rows:
        observed, draws, explained = _by_rows(fit, recording, r)
    else:  # of so many rows that what a fit takes of noise is nothing beside it
        sums = StructureSums(r, _functions(fit, recording), order)
        observed, draws = sums.tests(), sums.null(DRAWS, SEED)
        explained = {name: float(np.sum(sums.along[span] ** 2)) for name, span in sums.spans.items()}
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
    draws = DRAWS if r.size < 50_000 else DRAWS // 5
    drawn = (rng.standard_normal(r.shape)[back] for _ in range(draws))
    largest = list[Array]()
    while some := list(islice(drawn, max(1, DRAWN_TOGETHER // max(r.size, 1)))):
        noise = [_standard(left * told) for left in project(np.array(some))]
        largest.append(np.max(list(_tests(np.array(noise), bases, neighbours).values()), axis=0))
    along = {name: float(np.sum((basis.T @ r) ** 2)) for name, basis in bases.items()}
    return {name: float(value[0]) for name, value in observed.items()}, np.concatenate(largest), along


def _standard(residual: Array) -> Array:
    """Channels of unit rms, far values pulled in: heavy tails are no structure."""
    scale = np.sqrt(np.mean(residual**2, axis=0))
    return np.clip(residual / np.where(scale > 0, scale, 1.0), -3.5, 3.5)


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
    root = fit.step_root
    rows = [fit.by_steps(block)[fit.used[block.rows]] for block in predictor.blocks(fit.p, fit.x, fit.used)]
    slopes = np.concatenate(rows).reshape(-1, len(root))

    def left(noise: Array) -> Array:
        each = noise.reshape(-1, len(slopes)).T
        return np.asarray((each - slopes @ (root @ (root.T @ (slopes.T @ each)))).T.reshape(noise.shape))

    return left
