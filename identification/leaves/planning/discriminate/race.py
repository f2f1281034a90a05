"""Measure how well rows tell explanations apart, and choose the rows that do it best.

With the readings whitened, let i be true with coefficients a, and let j claim to be. What j cannot reproduce, with
any size of its own and with geometry adapting within its tolerances, is

    chi2(i | j) = a' [L_ii - L_ij (L_jj + 1/WIDE^2)^-1 L_ji] a,   L = G' V^-1 G,  V = I + J S^2 J',

and the log Bayes factor of i against j is expected to be half of it. A set of rows is worth what it says of the
worst pair. Adding a row never lowers it: chi2 is a Schur complement of the information.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from truepose.arrays import Array, Index, Mask

Single = NDArray[np.float32]
WORST = 4.0
"""Exponent of the mean that stands for the worst pair: smooth, and of no unit."""
_LEAST = 1e-12
_GAIN = 1e-3
_TRIALS = 3
_SHORT, _EVERY = 300, 5


@dataclass(frozen=True)
class Contest:
    """One rival against everything that may be true instead.

    nuisance (c, m, k): readings' derivatives by geometry and by the rival, precision (k,) their prior; signal
    (c, m, s): what each true explanation does to the readings, in sigmas; base (k + s, k + s): Gram matrix of
    [nuisance signal] over rows that exist already; pair (s,): number of the pair that a signal belongs to.
    """

    nuisance: Array
    signal: Array
    precision: Array
    base: Array
    pair: Index

    def missed(self, design: Sequence[int]) -> Array:
        """(s,) chi2 that the rival cannot reproduce on the rows of a design and on those that exist."""
        return self._solved(design)[2]

    def after_adding(self, design: Sequence[int], rows: Index) -> Array:
        """(r, s) the same with one more row, for each of ``rows`` (r,)."""
        white, error, missed = self._seen(design, rows)
        return np.asarray(missed + _weighed(white, error, 1.0))

    def after_removing(self, design: Sequence[int]) -> Array:
        """(n, s) the same with one row of the design less, for every one."""
        white, error, missed = self._seen(design, np.asarray(design))
        return np.asarray(np.maximum(missed - _weighed(white, error, -1.0), 0.0))

    def _seen(self, design: Sequence[int], rows: Index) -> tuple[Single, Array, Array]:
        """Of some rows: nuisance in units of what the design leaves open (n, m, k), signal that it would not foresee
        (n, m, s); and the design's chi2 (s,)."""
        root, answer, missed = self._solved(design)
        nuisance = self.nuisance[rows]
        c, m, k = nuisance.shape
        # single precision serves to rank rows; what a design is worth never comes from here
        single = nuisance.reshape(-1, k).astype(np.float32) @ root.astype(np.float32)
        white = np.asarray(single.reshape(c, m, k))
        return white, self.signal[rows] - nuisance @ answer, missed

    def _solved(self, design: Sequence[int]) -> tuple[Array, Array, Array]:
        """Root of the nuisance's covariance (k, k), what it answers to the signals (k, s), chi2 left (s,)."""
        k = len(self.precision)
        at = np.asarray(design, dtype=np.intp)
        rows = np.concatenate([self.nuisance[at], self.signal[at]], axis=2)
        rows = rows.reshape(-1, rows.shape[2])
        gram = self.base + rows.T @ rows
        inner = gram[:k, :k] + np.diag(self.precision)
        size = np.sqrt(np.diag(inner))
        factor = cho_factor(inner / np.outer(size, size) + 1e-14 * np.eye(k), lower=True)
        root = solve_triangular(factor[0], np.diag(1.0 / size), lower=True).T
        cross = gram[:k, k:]
        answer = cho_solve(factor, cross / size[:, None]) / size[:, None]
        left = np.diag(gram[k:, k:]) - np.sum(cross * answer, axis=0)
        return np.asarray(root), np.asarray(answer), np.maximum(left, 0.0)


@dataclass(frozen=True)
class Race:
    """All contests; ``pairs`` of them are counted, those that no row at all could tell apart are not."""

    contests: tuple[Contest, ...]
    pairs: int
    counted: Mask

    def values(self, design: Sequence[int]) -> Array:
        """(p,) expected log Bayes factor of each pair; of a rival's forms the one that does best counts."""
        return self._gathered([c.missed(design) for c in self.contests])

    def judged(self, values: Array) -> Array:
        """Smooth stand-in, of shape (...), of the worst of the p pairs that count, from ``values`` (..., p)."""
        some = np.maximum(values[..., self.counted], _LEAST)
        least = np.min(some, axis=-1, keepdims=True)
        return np.asarray(least[..., 0] * np.mean((some / least) ** -WORST, axis=-1) ** (-1.0 / WORST))

    def adding(self, design: Sequence[int], rows: Index) -> Array:
        """(r,) judgement of the design with one more row, for each of ``rows``; none is taken twice."""
        out = self.judged(self._gathered([c.after_adding(design, rows) for c in self.contests]))
        return np.where(np.isin(rows, design), -np.inf, out)

    def removing(self, design: Sequence[int]) -> Array:
        """(n,) judgement of the design with one row less."""
        return self.judged(self._gathered([c.after_removing(design) for c in self.contests]))

    def _gathered(self, chi2: Sequence[Array]) -> Array:
        """(..., p) half the chi2 of each pair, by the rival's best form."""
        shape = chi2[0].shape[:-1]
        out = np.full((*shape, self.pairs), np.inf)
        for contest, found in zip(self.contests, chi2, strict=True):
            for pair in np.unique(contest.pair):
                total = 0.5 * np.sum(found[..., contest.pair == pair], axis=-1)
                out[..., pair] = np.minimum(out[..., pair], total)
        return out


def chosen(race: Race, n: int) -> list[int]:
    """``n`` rows by greedy addition, then by exchange as long as that gains.

    All rows are looked at again every few steps, in between those that promised most.
    """
    every = np.arange(len(race.contests[0].signal))
    design: list[int] = []
    some = every
    while len(design) < min(n, len(every)):
        fresh = len(design) < _EVERY or len(design) % _EVERY == 0
        rows = every if fresh else some
        scores = race.adding(design, rows)
        design.append(int(rows[np.argmax(scores)]))
        some = rows[np.argsort(-scores)[:_SHORT]] if fresh else some
    if len(every) <= n:
        return design
    value = float(race.judged(race.values(design)))
    for step in range(n):
        trial, reached, some = _exchanged(race, design, every if step % _EVERY == 0 else some)
        if reached <= value * (1.0 + _GAIN):
            break
        design, value = trial, reached
    return design


def _exchanged(race: Race, design: list[int], rows: Index) -> tuple[list[int], float, Index]:
    """The row that is missed least exchanged for the best other one, its value, and the rows that came closest.

    Where that gains nothing the next ones are tried.
    """
    before = float(race.judged(race.values(design)))
    best, reached, some = design, before, rows
    for place in np.argsort(-race.removing(design))[:_TRIALS]:
        rest = [row for k, row in enumerate(design) if k != place]
        scores = np.where(rows == design[place], -np.inf, race.adding(rest, rows))
        some = rows[np.argsort(-scores)[:_SHORT]]
        trial = [*rest, int(some[0])]
        value = float(race.judged(race.values(trial)))
        if value > reached:
            return trial, value, some
    return best, reached, some


def _weighed(white: Single, error: Array, sign: float) -> Array:
    """(n, s) e' (1 + sign H)^-1 e, H = white white': what a row adds to chi2, or what it takes away."""
    inner = np.eye(white.shape[1]) + sign * (white @ white.transpose(0, 2, 1)).astype(float)
    return np.asarray(np.sum(error * np.linalg.solve(inner, error), axis=1))
