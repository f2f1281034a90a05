"""Log evidence of every candidate from one Gram matrix, geometry marginalised under its tolerance.

With e the residual at the drawing values, J the geometry and G a candidate,
    nothing missing:  e ~ N(0, k^2 I + J S J'),      candidate:  + q^2 G D^2 G'
where S holds tolerances times an inflation l per class of part. The noise scale k, the inflations l and the
amplitude q are marginalised on a grid: wrong sigmas and wrong tolerances are rival explanations.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import log_ndtr, logsumexp

from truepose.identification.diagnosis.signatures import Linearisation

Array = NDArray[np.float64]
AMPLITUDES = np.geomspace(1e-4, 1.0, 17)
INFLATIONS = (1.0, 2.0, 4.0, 10.0)
INFLATED = ("length", "angle")


@dataclass(frozen=True)
class Grid:
    """Noise scales and tolerance inflations, with the log prior of each combination."""

    noise: tuple[float, ...]
    inflation: tuple[tuple[float, ...], ...]
    classes: tuple[str, ...]

    def log_prior(self, noise: float, inflation: Sequence[float]) -> float:
        """Stated sigmas are mostly right and sometimes far off; tolerances are rarely off by much."""
        step = np.log(noise)
        stated = np.logaddexp(np.log(0.8 / 0.1) - 0.5 * (step / 0.1) ** 2, np.log(0.2) - 0.5 * step**2)
        return float(stated - sum(0.5 * (np.log(value) / 0.6) ** 2 for value in inflation))


def grid_for(lin: Linearisation, rms: float) -> Grid:
    """Noise scales from half the stated sigma to what geometry alone leaves; inflations of the classes present."""
    top = max(2.0, 1.5 * rms)
    noise = tuple(np.unique(np.round([0.7, 0.85, 1.0, 1.2, *np.geomspace(1.5, top, max(2, int(np.ceil(np.log(top) / 0.35))))], 6)).tolist())
    classes = tuple(c for c in INFLATED if c in lin.parts)
    return Grid(noise, tuple(itertools.product(INFLATIONS, repeat=len(classes))), classes)


@dataclass(frozen=True)
class Evidence:
    """log evidence of the null and of each candidate (integrated over the grid), with fitted amplitudes.

    gain (C,): log Bayes factor of a candidate against nothing more; amplitude: posterior mean in units of
    scale, std beside it, at the best grid point; noise, inflation: of the null, posterior mean in the log.
    """

    null: float
    gain: Array
    amplitude: tuple[Array, ...]
    spread: tuple[Array, ...]
    noise: float
    inflation: tuple[float, ...]
    best_noise: Array


def evidence(lin: Linearisation, wanted: Sequence[int], grid: Grid, accepted: Sequence[int] = ()) -> Evidence:
    """Evidence of the candidates ``wanted`` when the candidates ``accepted`` are part of the model already."""
    context, columns = _Context(lin, lin.indices(accepted)), [lin.columns[i] for i in wanted]
    points = [(k, inflation) for k in grid.noise for inflation in grid.inflation]
    prior = np.array([grid.log_prior(*point) for point in points])
    sizes = sorted({c.stop - c.start for c in columns})
    groups = {s: [i for i, c in enumerate(columns) if c.stop - c.start == s] for s in sizes}
    null = np.empty(len(points))
    gain = np.empty((len(points), len(columns)))
    best: list[tuple[float, Array, Array, float]] = [(-np.inf, np.zeros(0), np.zeros(0), 1.0)] * len(columns)
    for g, (noise, inflation) in enumerate(points):
        null[g], state = context.null(noise, dict(zip(grid.classes, inflation, strict=True)))
        for size, members in groups.items():
            which = np.array([np.arange(columns[i].start, columns[i].stop) for i in members])
            logs, mean, std = context.candidates(state, which, noise, size)
            gain[g, members] = logs
            for j, i in enumerate(members):
                total = null[g] + prior[g] + logs[j]
                if total > best[i][0]:
                    best[i] = (total, mean[j], std[j], noise)
    base = float(logsumexp(null + prior))
    weight = np.exp(null + prior - base)
    mean_noise = float(np.exp(np.sum(weight * np.log([k for k, _ in points]))))
    mean_inflation = tuple(float(np.exp(np.sum(weight * np.log([p[1][c] for p in points])))) for c in range(len(grid.classes)))
    total = logsumexp(gain + (null + prior)[:, None], axis=0) - base if len(columns) else np.zeros(0)
    return Evidence(base, total, tuple(b[1] for b in best), tuple(b[2] for b in best), mean_noise, mean_inflation, np.array([b[3] for b in best]))


class _Context:
    """Gram blocks with accepted candidates moved into J (prior: their scale)."""

    def __init__(self, lin: Linearisation, accepted: Sequence[int]) -> None:
        n, last = lin.free, len(lin.gram) - 1
        extra = np.array(accepted, dtype=int) + n
        self.inside = np.concatenate([np.arange(n), extra]).astype(int)
        self.weight = np.concatenate([lin.weight, np.ones(len(extra))])
        self.parts = (*lin.parts, *("effect" for _ in extra))
        self.readings, self.offset, self.gram = lin.readings, n, lin.gram
        shift = np.append(lin.departure, 0.0)
        # e = r - [J G] d: the residual at the drawing values, without effects
        self.cross = lin.gram[:, last] - lin.gram @ shift
        self.square = float(lin.gram[last, last] - 2 * shift @ lin.gram[:, last] + shift @ lin.gram @ shift)

    def null(self, noise: float, inflation: dict[str, float]) -> tuple[float, tuple[object, Array, Array]]:
        inside = self.inside
        widened = np.array([inflation.get(part, 1.0) for part in self.parts])
        precision = (self.weight / widened) ** 2
        a = self.gram[np.ix_(inside, inside)] / noise**2 + np.diag(precision)
        jitter = 1e-12 * np.max(np.diag(a))
        factor = cho_factor(a + jitter * np.eye(len(a)), lower=True)
        b = self.cross[inside] / noise**2
        solved = cho_solve(factor, b)
        quadratic = self.square / noise**2 - b @ solved
        finite = precision > 0
        log_det = 2 * np.sum(np.log(np.diag(factor[0]))) - np.sum(np.log(precision[finite]))
        return -self.readings * np.log(noise) - 0.5 * float(quadratic) - 0.5 * float(log_det), (factor, b, solved)

    def candidates(self, state: tuple[object, Array, Array], which: NDArray[np.intp], noise: float, size: int) -> tuple[Array, Array, Array]:
        """Log Bayes factors (C,), posterior means and stds (C, size) of candidates of one size."""
        factor, _, solved = state
        rows = self.offset + which.ravel()
        jg = self.gram[np.ix_(self.inside, rows)] / noise**2
        half = solve_triangular(factor[0], jg, lower=True)  # type: ignore[index]
        score = (self.cross[rows] / noise**2 - jg.T @ solved).reshape(-1, size)
        blocks = half.reshape(len(half), -1, size)
        own = np.array([self.gram[np.ix_(self.offset + w, self.offset + w)] for w in which]) / noise**2
        information = own - np.einsum("ick,icl->ckl", blocks, blocks)
        values, vectors = np.linalg.eigh(information)
        values = np.maximum(values, 0.0)
        turned = np.einsum("ckl,ck->cl", vectors, -score)
        q2 = AMPLITUDES[:, None, None] ** 2
        damped = 1.0 + q2 * values
        logs = 0.5 * np.sum(q2 * turned**2 / damped - np.log(damped), axis=2)
        best = np.argmax(logs, axis=0)
        at = AMPLITUDES[best, None] ** 2
        mean = np.einsum("ckl,cl->ck", vectors, at * turned / (1 + at * values))
        std = np.sqrt(np.einsum("ckl,cl->ck", vectors**2, at / (1 + at * values)))
        return logsumexp(logs, axis=0) - np.log(len(AMPLITUDES)), mean, std


def log_positive(mean: float, std: float) -> float:
    """Log factor of a one-sided prior: 2 P(c > 0 | data)."""
    return float(np.log(2.0) + log_ndtr(mean / max(std, 1e-300)))
