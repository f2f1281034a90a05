"""Damped Gauss-Newton (Levenberg-Marquardt) on whitened residuals that arrive in blocks.

The residuals are never stored: each block is folded into one triangular factor of [J r] (Householder
QR), from which the step, the covariance, the rank and the null space all come.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TypeAlias

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dgeqrf, dgesdd
from scipy.sparse import csr_array

from truepose.arrays import Array
from truepose.identification.prediction.by_ports import GramSum, Part
from truepose.threads import Cached

Rows: TypeAlias = Array | Part
"""Rows of [J r] (k, n + 1), or what they follow from where n is large."""
Blocks = Callable[[Array], Iterable[Rows]]
"""Scaled parameters (n,) to blocks of rows [J r], (k, n + 1)."""
WIDE_PROBLEM = 250
"""Columns beyond which the Gram matrix pays."""
SPARSE = 0.02
"""Share of entries up to which products of sparse matrices are quicker."""
LOST = 1e-12
"""Part of the sum of squares below which a predicted decrease is lost in rounding."""
VANISHED = 1e-10
"""Part of its length at the start below which a column of J counts as lost."""
SURE = 1e-6
"""Predicted decrease below which a step is right without a trial."""
POLISHING = 10
UNSEEN = 1e-10
"""Singular values below this share of the largest say nothing: the last step does not follow them."""


class Status(Enum):
    """How the iteration ended."""

    CONVERGED = "the step and the gradient are below their limits"
    STALLED = "no step lowers the sum of squares, and the gradient is not small"
    ESCAPED = "a parameter went so far off that it has no influence any more"
    LIMIT = "the iteration limit was reached"
    FAILED = "the residuals cannot be evaluated at the start"

    @property
    def ok(self) -> bool:
        """Whether the result is a minimum."""
        return self is Status.CONVERGED


@dataclass(frozen=True)
class Solution:
    """Minimum of half the sum of squares: t (n,), triangular factor of [J r] (n + 1, n + 1) at or next to it,
    the outcome, the decrease that was left to gain, and the last step."""

    t: Array
    factor: Array
    cost: float
    status: Status
    iterations: int
    decrement: float
    movement: Array


def triangular(blocks: Iterable[Rows], columns: int) -> Array:
    """Upper triangular factor (columns, columns) of rows that arrive in blocks.

    Wide problems go through the Gram matrix (a fifth of the time); it squares the condition number, so that
    they should carry priors and scaled columns.
    """
    if columns <= WIDE_PROBLEM:
        return _by_qr((np.asarray(block) for block in blocks), columns)  # parts are of wide problems
    return _by_cholesky(_grams(blocks, columns, [None])[0])


def triangular_parts(blocks: Iterable[Rows], columns: int, groups: Sequence[Sequence[int]]) -> list[Array]:
    """A triangular factor (columns, columns) for each group of channels; each pose has one row for every channel, in order."""
    if len(groups) == 1:
        return [triangular(blocks, columns)]
    if columns > WIDE_PROBLEM:
        return [_by_cholesky(gram) for gram in _grams(blocks, columns, groups)]
    size, parts = sum(len(at) for at in groups), [np.zeros((columns, columns)) for _ in groups]
    for block in blocks:
        rows = np.asarray(block).reshape(-1, size, columns)
        own = [rows[:, at].reshape(-1, columns) for at in groups]
        parts = [_by_qr([part, k], columns) for part, k in zip(parts, own, strict=True)]
    return parts


def _grams(blocks: Iterable[Rows], columns: int, groups: Sequence[Sequence[int] | None]) -> list[Array]:
    """A Gram matrix (columns, columns) of the rows of each group of channels; of all rows for None."""
    sums = [GramSum(columns, at) for at in groups]
    plain = [np.zeros((columns, columns)) for _ in groups]
    size = sum(len(at) for at in groups if at is not None)
    for block in blocks:
        for k, at in enumerate(groups):
            if isinstance(block, Part):
                sums[k].add(block)
            else:
                own = block if at is None else block.reshape(-1, size, columns)[:, at].reshape(-1, columns)
                plain[k] += _gram_of(own)
    return [one + own.matrix() for one, own in zip(plain, sums, strict=True)]


def _gram_of(rows: Array) -> Array:
    """(n, n) of rows (k, n); those of tolerances are mostly zeros."""
    if np.count_nonzero(rows) > SPARSE * rows.size:
        return np.asarray(rows.T @ rows)
    few = csr_array(rows)
    return np.asarray((few.T @ few).toarray())


def _by_cholesky(gram: Array) -> Array:
    """Triangular factor of a Gram matrix; NaN where rounding left it short of positive."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram / np.outer(size, size)
    for lift in (0.0, 1e-15, 1e-13, 1e-11):  # rounding may leave it a hair short of positive
        try:
            return np.asarray(np.linalg.cholesky(scaled + lift * np.eye(len(gram))).T * size)
        except np.linalg.LinAlgError:
            continue
    return np.full(gram.shape, np.nan)


def _by_qr(blocks: Iterable[Array], columns: int) -> Array:
    factor = np.zeros((columns, columns))
    for block in blocks:
        if not np.isfinite(block).all():  # LAPACK would come to NaN too, but slowly
            return np.full((columns, columns), np.nan)
        # numpy's own takes five times as long where there is little to factor
        factor = np.triu(dgeqrf(np.vstack([factor, block]), lwork=64 * columns)[0][:columns])
    return factor


def minimise(
    blocks: Blocks,
    start: Array,
    *,
    limit: int = 100,
    tolerance: float = 1e-9,
    share: float = 1e-15,
    damping: float = 1e-4,
) -> Solution:
    """Levenberg-Marquardt with Nielsen's damping; ``damping=0`` starts as plain Gauss-Newton.

    ``start`` (n,): the first unknowns; ``blocks`` gives rows (k, n + 1) of [J r] at any.
    Converged when the predicted decrease of the sum of squares is below ``tolerance`` of one
    degree of freedom (sum of squares in units of the noise), or below ``share`` of the whole, by default its
    rounding; but not where a column of J has vanished since the start. Blocks of NaN forbid a place.
    """
    t = start.astype(float)
    factor = triangular(blocks(t), len(t) + 1)
    cost = _cost(factor)
    if not np.isfinite(cost):
        return Solution(t, factor, cost, Status.FAILED, 0, np.inf, np.zeros(len(t)))
    found = _descend(blocks, t, factor, limit, (tolerance, share), damping)
    if found.status.ok and np.any(_influence(found.factor) < VANISHED * _influence(factor)):
        return replace(found, status=Status.ESCAPED)
    return _polished(blocks, found, tolerance) if found.status.ok and found.decrement < SURE else found


def _descend(
    blocks: Blocks, t: Array, factor: Array, limit: int, enough: tuple[float, float], damping: float
) -> Solution:
    n, cost, movement = len(t), _cost(factor), np.zeros(len(t))
    mu, growth, linear = damping, 2.0, Linear(factor, n)
    for iteration in range(1, limit + 1):
        decrement = linear.decrement
        if decrement < enough[0] + enough[1] * cost:
            return Solution(t, factor, cost, Status.CONVERGED, iteration, decrement, movement)
        step = linear.step(mu)
        trial = triangular(blocks(t + step), n + 1)
        after = _cost(trial)
        left = factor[:, :n] @ step + factor[:, n]
        predicted = cost - 0.5 * float(left @ left)
        ratio = (cost - after) / predicted if predicted > 0 and np.isfinite(after) else -1.0
        if ratio > 1e-4:
            t, factor, cost, movement = t + step, trial, after, step
            linear = Linear(factor, n)
            mu = mu * max(1.0 / 5.0, 1.0 - (2.0 * ratio - 1.0) ** 3) if ratio < 0.9 else 0.1 * mu
            mu, growth = (mu if mu > 1e-15 else 0.0), 2.0
            continue
        lost = predicted < LOST * (1.0 + cost) and np.isfinite(after)
        if lost or mu > 1e20:
            small = lost and decrement < 1e-6 * (1.0 + cost)
            status = Status.CONVERGED if small else Status.STALLED
            return Solution(t, factor, cost, status, iteration, decrement, movement)
        mu, growth = max(mu, 1e-7) * growth, 2.0 * growth
    return Solution(t, factor, cost, Status.LIMIT, limit, linear.decrement, movement)


def _polished(blocks: Blocks, found: Solution, tolerance: float) -> Solution:
    """Undamped steps where the sum of squares tells no more: as long as they leave less than half to gain.

    The last one is not tried: what is left after it is of second order.
    """
    n = len(found.t)
    linear = Linear(found.factor, n)
    for _ in range(POLISHING):
        after = found.t + linear.step(least=UNSEEN)
        if found.decrement < tolerance:
            return replace(found, t=after)
        factor = triangular(blocks(after), n + 1)
        if not np.isfinite(factor).all():
            return found
        linear = Linear(factor, n)
        left = linear.decrement
        if left > 0.5 * found.decrement:
            return found
        found = replace(found, t=after, factor=factor, cost=_cost(factor), decrement=left)
    return found


def _cost(factor: Array) -> float:
    """Half the sum of squares."""
    return 0.5 * float(factor[:, -1] @ factor[:, -1])


def _influence(factor: Array) -> Array:
    """Length of each column of J."""
    return np.asarray(np.sqrt(np.einsum("kn,kn->n", factor[:, :-1], factor[:, :-1])))


class Linear:
    """The linear problem of a triangular factor of [J r], columns of J at unit length; decomposed once."""

    def __init__(self, factor: Array, n: int) -> None:
        self._norms = _influence(factor)
        self._norms[self._norms == 0] = 1.0
        self._a, self._r = factor[:, :n] / self._norms, factor[:, n]
        self._wide = n >= WIDE_PROBLEM
        if not self._wide:
            u, self._s, self._vt, failed = dgesdd(self._a, full_matrices=0)
            if failed:
                raise np.linalg.LinAlgError("singular values did not converge")
            self._inside = u.T @ self._r

    def step(self, mu: float = 0.0, *, least: float = 1e-13) -> Array:
        """(n,) step with damping ``mu`` (Marquardt); directions of singular values below a share ``least`` stay put."""
        if self._wide:
            return -self._normal(mu) / self._norms
        k, s = self._rank(least), self._s
        return np.asarray(-((self._inside[:k] * s[:k] / (s[:k] ** 2 + mu)) @ self._vt[:k]) / self._norms)

    @Cached
    def decrement(self) -> float:
        """Half the squared length of r inside the span of J: what an undamped step would gain."""
        if self._wide:
            return 0.5 * float(self._normal(1e-14) @ self._sums[1])
        inside = self._inside[: self._rank(1e-13)]
        return 0.5 * float(inside @ inside)

    @Cached
    def _sums(self) -> tuple[Array, Array]:
        """(n, n) a'a and (n,) a'r."""
        return self._a.T @ self._a, self._a.T @ self._r

    def _normal(self, mu: float) -> Array:
        """Solution of (a'a + mu) x = a'r by Cholesky: for wide problems, whose SVD takes too long."""
        h, right = self._sums[0].copy(), self._sums[1]
        h[np.diag_indices_from(h)] += max(mu, 1e-14 * float(np.max(np.diag(h))))
        return np.asarray(cho_solve(cho_factor(h, lower=True, overwrite_a=True), right))

    def _rank(self, least: float) -> int:
        return int(np.count_nonzero(self._s > least * max(self._s[0], 1e-300)))
