"""Log evidence of every candidate from one Gram matrix, geometry marginalised under its tolerance.

With e the residual at the drawing values, J the geometry and G a candidate,
    nothing missing:  e ~ N(0, k^2 I + J S J'),      candidate:  + q^2 G D^2 G'
where S holds tolerances times an inflation l per class of part. The noise scale k, the inflations l and the
amplitude q are marginalised on a grid: wrong sigmas and wrong tolerances are rival explanations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular
from scipy.special import log_ndtr

from truepose.identification.diagnosis.signatures import Linearisation
from truepose.identification.selection.scales import Grid, Point, log_gains, noise_scales
from truepose.identification.selection.tolerance_classes import PartClass, inflations

Array = NDArray[np.float64]
AMPLITUDES = np.geomspace(1e-4, 10.0, 21)
"""Sizes of coefficients, in units of the largest expected one."""
_SHARES = np.minimum(1.0, AMPLITUDES**-2.0)
LOG_SHARES = np.log(_SHARES / np.sum(_SHARES))
"""Every size up to the largest expected one is as likely; beyond it, ten times larger is a hundred times rarer."""
HOPELESS = 16.0
"""Log odds below which an inflation is not weighed with candidates: it would add 1e-7 of a narrower one's share."""
LONG = 60
"""Coefficients from which on a candidate is a long series (a hundred harmonics)."""
MANY_OBSERVATIONS = 4000
"""Beyond so many readings tolerances decide little, and one inflation for all classes is enough."""


def grid_for(lin: Linearisation, rms: float) -> Grid:
    """Noise scales from below the stated sigma to what geometry alone leaves; inflations of the classes present."""
    classes = tuple(dict.fromkeys(lin.parts))
    if lin.n_observations > MANY_OBSERVATIONS:
        top = max(1.7, 1.2 * rms)
        coarse = np.geomspace(1.0, top, max(3, int(np.ceil(np.log(top) / 0.55)) + 1))
        return Grid(tuple(float(v) for v in coarse), ((1.0,) * len(classes),), classes)
    return Grid(noise_scales(rms, 0.6), inflations(classes), classes)


@dataclass(frozen=True)
class Evidence:
    """log evidence of the null and of each candidate (integrated over the grid), with fitted amplitudes.

    gain (C,): log Bayes factor of a candidate against nothing more; amplitude: posterior mean in units of
    scale, std beside it, at the best grid point; spread: the size of amplitudes there, in units of scale.
    noise, inflation: of the null, posterior mean in the log.
    """

    null: float
    gain: Array
    amplitude: tuple[Array, ...]
    std: tuple[Array, ...]
    spread: Array
    noise: float
    inflation: tuple[float, ...]
    best_noise: Array


class _Best:
    """Where on the grid each candidate (C,) does best, and its amplitudes there."""

    def __init__(self, sizes: Sequence[int]) -> None:
        self.total = np.full(len(sizes), -np.inf)
        self.spread, self.noise = np.ones(len(sizes)), np.ones(len(sizes))
        self.amplitude = [np.zeros(size) for size in sizes]
        self.std = [np.zeros(size) for size in sizes]

    def improve(self, members: NDArray[np.intp], total: Array, weighed: _Weighed, noise: float) -> None:
        """Take a point where it is better."""
        for j in np.flatnonzero(total > self.total[members]):
            i = members[j]
            self.total[i], self.spread[i], self.noise[i] = total[j], weighed.spread[j], noise
            self.amplitude[i], self.std[i] = weighed.mean[j], weighed.std[j]


@dataclass(frozen=True)
class _Weighed:
    """Candidates of one size at one point: log Bayes factors (C,), means and stds (C, size), spreads (C,)."""

    logs: Array
    mean: Array
    std: Array
    spread: Array


def weigh(lin: Linearisation, wanted: Sequence[int], grid: Grid, accepted: Mapping[int, float]) -> Evidence:
    """Evidence of the candidates ``wanted`` when ``accepted`` (index to spread, in scales) are part of the model already."""
    context, columns = _Context(lin, accepted), [lin.columns[i] for i in wanted]
    points = grid.points
    prior = np.array([point.log_prior for point in points])
    groups = [context.group(columns, members) for members in _by_size(columns)]
    states = [context.null(p.noise, dict(zip(grid.classes, p.inflation, strict=True))) for p in points]
    null = np.array([value for value, _ in states])
    gain = np.full((len(points), len(columns)), -np.inf)
    best = _Best([c.stop - c.start for c in columns])
    likely = set(np.argsort(-(null + prior))[:2].tolist())
    worth = _worth_weighing(points, null + prior)
    for g, (point, (_, state)) in enumerate(zip(points, states, strict=True)):
        if not worth[g]:
            continue
        for group in groups:
            # a long series is weighed at the stated tolerances and at the likeliest points only: each point costs
            if group.size >= LONG and g not in likely and max(point.inflation, default=1.0) > 1.0:
                continue
            weighed = context.candidates(state, group, point.noise)
            gain[g, group.members] = weighed.logs
            best.improve(group.members, null[g] + prior[g] + weighed.logs, weighed, point.noise)
    return _gather(points, prior, null, gain, best)


def _worth_weighing(points: Sequence[Point], log: Array) -> NDArray[np.bool_]:
    """Points that matter: inflations that are not hopeless beside narrower ones at their noise.

    What explains more of the readings makes wider tolerances less needed, never more: where narrower ones do
    better without it they do better with it. Narrower ones that are hopeless without it may be the best with it.
    """
    noise = np.array([p.noise for p in points])
    width = np.array([p.inflation for p in points]).reshape(len(points), -1)
    narrower = np.all(width[:, None] <= width[None, :], axis=2) & (noise[:, None] == noise[None, :])
    rival = np.max(np.where(narrower, log[:, None], -np.inf), axis=0)
    return np.asarray(log > rival - HOPELESS)


def _gather(points: Sequence[Point], prior: Array, null: Array, gain: Array, best: _Best) -> Evidence:
    base = float(_log_sum(null + prior))
    weight = np.exp(null + prior - base)
    total = _log_sum(gain + (null + prior)[:, None]) - base
    inflations = np.log([p.inflation for p in points]).reshape(len(points), -1)
    return Evidence(
        null=base,
        gain=total,
        amplitude=tuple(best.amplitude),
        std=tuple(best.std),
        spread=best.spread,
        noise=float(np.exp(np.sum(weight * np.log([p.noise for p in points])))),
        inflation=tuple(float(v) for v in np.exp(weight @ inflations)),
        best_noise=best.noise,
    )


def _log_sum(logs: Array) -> Array:
    """log sum exp along the first axis; scipy's takes ten times as long on small arrays."""
    top = np.max(logs, axis=0)
    safe = np.where(np.isfinite(top), top, 0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(safe + np.log(np.sum(np.exp(logs - safe), axis=0)))


@dataclass(frozen=True)
class _Group:
    """Candidates of one size: their rows (C * size,) of the Gram matrix, and its blocks with J and with themselves."""

    members: NDArray[np.intp]
    size: int
    rows: NDArray[np.intp]
    across: Array
    own: Array


def _by_size(columns: Sequence[slice]) -> list[list[int]]:
    groups: dict[int, list[int]] = {}
    for i, c in enumerate(columns):
        groups.setdefault(c.stop - c.start, []).append(i)
    return list(groups.values())


class _Context:
    """Gram blocks with accepted candidates moved into J (prior: their spread)."""

    def __init__(self, lin: Linearisation, accepted: Mapping[int, float]) -> None:
        n, last = lin.free, len(lin.gram) - 1
        extra = np.array(lin.indices(list(accepted)), dtype=int) + n
        self.inside = np.concatenate([np.arange(n), extra]).astype(int)
        sizes = [lin.columns[i].stop - lin.columns[i].start for i in accepted]
        self.weight = np.concatenate([lin.weight, 1.0 / np.repeat(list(accepted.values()), sizes)])
        self.parts = (*lin.parts, *(PartClass("effect") for _ in extra))
        self.n_observations, self.offset, self.gram = lin.n_observations, n, lin.gram
        shift = np.append(lin.departure, 0.0)
        # e = r - [J G] d: the residual at the drawing values, without effects
        self.cross = lin.gram[:, last] - lin.gram @ shift
        self.square = float(lin.gram[last, last] - 2 * shift @ lin.gram[:, last] + shift @ lin.gram @ shift)

    def null(
        self, noise: float, inflation: dict[PartClass, float]
    ) -> tuple[float, tuple[object, Array, Array]]:
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
        return -self.n_observations * np.log(noise) - 0.5 * float(quadratic) - 0.5 * float(log_det), (
            factor,
            b,
            solved,
        )

    def group(self, columns: Sequence[slice], members: list[int]) -> _Group:
        """What the grid's points share of candidates of one size."""
        which = self.offset + np.array([np.arange(columns[i].start, columns[i].stop) for i in members])
        own = self.gram[which[:, :, None], which[:, None, :]]
        return _Group(
            np.array(members),
            which.shape[1],
            which.ravel(),
            self.gram[np.ix_(self.inside, which.ravel())],
            own,
        )

    def candidates(self, state: tuple[object, Array, Array], group: _Group, noise: float) -> _Weighed:
        """Candidates of one size against nothing more."""
        factor, _, solved = state
        jg, size = group.across / noise**2, group.size
        half = solve_triangular(factor[0], jg, lower=True, check_finite=False)  # type: ignore[index]
        score = (self.cross[group.rows] / noise**2 - jg.T @ solved).reshape(-1, size)
        blocks = half.reshape(len(half), -1, size).transpose(1, 2, 0)
        information = group.own / noise**2 - blocks @ blocks.transpose(0, 2, 1)
        # a single coefficient needs no turning
        values, vectors = (
            (information[:, :, 0], np.ones_like(information)) if size == 1 else np.linalg.eigh(information)
        )
        values = np.maximum(values, 0.0)
        turned = np.einsum("ckl,ck->cl", vectors, -score)
        logs = log_gains(AMPLITUDES, values, turned) + LOG_SHARES[:, None]
        best = np.argmax(logs, axis=0)
        at = AMPLITUDES[best, None] ** 2
        mean = np.einsum("ckl,cl->ck", vectors, at * turned / (1 + at * values))
        std = np.sqrt(np.einsum("ckl,cl->ck", vectors**2, at / (1 + at * values)))
        return _Weighed(_log_sum(logs), mean, std, AMPLITUDES[best])


def log_positive(mean: float, std: float) -> float:
    """Log factor of a one-sided prior: 2 P(c > 0 | data)."""
    return float(np.log(2.0) + log_ndtr(mean / max(std, 1e-300)))
