"""Tests of structure in the residuals of very many rows, from sums over them: see ``alarms.structure_alarm``.

With functions F (n, k) of a driver, F'F = L L', the orthonormal ones have Q'r = L^-1 F'r. For white noise r of variance one
Q'r is normal, with the covariance Q'Q between drivers, and so is the sum of products of neighbours over the root of their
number: what chance makes is drawn from these few numbers. Rows are visited once, some at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.stats import chi2

from truepose.arrays import Array, Index
from truepose.identification.prediction.blocks import TOGETHER


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


@dataclass(frozen=True)
class StructureSums:
    """Of residuals (n, m) of unit rms: Q'r (k, m) of all drivers, their spans among the k, Q'Q (k, k), and the sum of products
    of neighbours over the root of their number, None where rows have no order."""

    along: Array
    spans: Mapping[str, slice]
    among: Array
    lag: float | None

    @classmethod
    def of(cls, residual: Array, functions: Mapping[str, Functions], order: Index | None) -> StructureSums:
        """``order`` (n,): indices that put rows in the order of acquisition."""
        width = sum(one.width for one in functions.values())
        squares, products = np.zeros((width, width)), np.zeros((width, residual.shape[1]))
        for start in range(0, len(residual), TOGETHER):
            rows = slice(start, start + TOGETHER)
            phi = np.hstack([one.at(rows) for one in functions.values()])
            squares += phi.T @ phi
            products += phi.T @ residual[rows]
        turn, spans = _orthonormal(squares, functions)
        lag = None if order is None else _lag(residual, order)
        return cls(turn @ products, spans, turn @ squares @ turn.T, lag)

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


def _lag(residual: Array, order: Index) -> float:
    """The sum of products of neighbours over the root of their number."""
    total = 0.0
    for start in range(0, len(order) - 1, TOGETHER):
        here = residual[order[start : start + TOGETHER + 1]]
        total += float(np.sum(here[1:] * here[:-1]))
    return total / float(np.sqrt((len(order) - 1) * residual.shape[1]))
