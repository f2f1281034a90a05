"""One singular value decomposition that rank, null space, covariance and observability all come from.

Scale before you decompose: columns are steps of each parameter's ``scale``, readings are in sigmas. What the
readings see is decided once, by one threshold; what tolerances add is then exact algebra on top of it, so
that rank, covariance and unknown directions cannot contradict each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular

from truepose.arrays import Array, Mask
from truepose.identification.fit.leastsquares import WIDE_PROBLEM

ROUNDING = 1e-10
"""Singular values below this share of the largest are no information.

Jacobians are exact but for some 1e-13 of their largest column (loops are closed to that), Householder factors
keep it, and three digits are left for products of both.
"""
ROUNDING_OF_GRAM = 1e-7
"""The same where the factor came from a Gram matrix, which holds squares: a few times the root of 1e-16."""
COMPONENT = 1e-8
"""Components of a unit vector below this are rounding."""
TAKES_PART = 1e-3
"""An unseen direction of length one that moves an entry by less than this, in steps or in mm at a lever, leaves it
determined: it is the same share for the 1-sigma and for what counts as identifiable."""


@dataclass(frozen=True)
class Observability:
    """Observability indices of the directions that are seen; singular values s_1 >= ... >= s_r, m readings.

    o1 = (s_1 ... s_r)^(1/r) / sqrt(m) (Borm and Menq), o2 = s_r / s_1 (Driels and Pathre), o3 = s_r and
    o4 = s_r^2 / s_1 (Nahvi and Hollerbach), o5 = 1 / (1/s_1 + ... + 1/s_r) (Sun and Hollerbach 2008). All are
    without a unit: columns in tolerances, readings in sigmas. Zeros where nothing is seen.
    """

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float

    @property
    def condition(self) -> float:
        """s_1 / s_r."""
        return 1.0 / self.o2 if self.o2 > 0 else float("inf")


@dataclass(frozen=True)
class Decomposition:
    """Readings' Jacobian as U diag(singular) directions, and the weights of the prior beside it.

    singular (n,) largest first, directions (n, n) rows orthonormal, weight (n,) scale / tolerance of each
    parameter (0: no prior), rank: how many directions the readings see.
    """

    singular: Array
    directions: Array
    weight: Array
    rank: int

    @classmethod
    def of(cls, factor: Array, weight: Array) -> Decomposition:
        """From a triangular factor (k, n) of the scaled Jacobian (or its rows), a column for each weight."""
        n = len(weight)
        if n == 0:
            return cls(np.zeros(0), np.zeros((0, 0)), weight, 0)
        _, s, directions = np.linalg.svd(factor)
        singular = np.zeros(n)
        singular[: len(s)] = s
        share = ROUNDING if n < WIDE_PROBLEM else ROUNDING_OF_GRAM
        rank = int(np.sum(singular > share * singular[0]))
        return cls(singular, directions, weight, rank)

    @property
    def seen(self) -> Array:
        """(rank, n) orthonormal directions that the readings see, best first."""
        return self.directions[: self.rank]

    @property
    def null_space(self) -> Array:
        """(n - rank, n) orthonormal directions that no reading sees."""
        return self.directions[self.rank :]

    @property
    def lengths(self) -> Array:
        """(n,) length of each column of the scaled Jacobian."""
        return np.asarray(np.linalg.norm(self.singular[:, None] * self.directions, axis=0))

    @cached_property
    def unknown(self) -> Array:
        """(k, n) orthonormal directions that neither readings nor prior determine."""
        return self._split[1]

    @cached_property
    def _split(self) -> tuple[Array, Array]:
        """The null space in two: what the prior holds, and what nothing holds."""
        blind = self.null_space
        if not len(blind):
            return blind, blind
        turn, held, _ = np.linalg.svd(blind * self.weight)
        held = np.concatenate([held, np.zeros(len(blind) - len(held))])
        loose = held <= self._blur * np.max(self.weight, initial=0.0)
        unknown = turn.T[loose] @ blind
        return turn.T[~loose] @ blind, np.where(np.abs(unknown) < self._blur, 0.0, unknown)

    @property
    def _blur(self) -> float:
        """How far rounding turns the null space: more where the last direction seen is hardly seen."""
        gap = self.singular[0] / self.singular[self.rank - 1] if self.rank else 1.0
        return max(COMPONENT, 4 * len(self.weight) * float(np.finfo(float).eps) * gap)

    @cached_property
    def _determined(self) -> tuple[Array, Array]:
        """Basis (n, k) of what is determined, and the readings' factor (rank, k) in it."""
        held, _ = self._split
        basis = np.vstack([self.seen, held]).T
        k = basis.shape[1]
        return basis, np.eye(self.rank, k) * np.append(self.singular[: self.rank], np.zeros(k - self.rank))

    @cached_property
    def _posterior(self) -> tuple[Array, Array]:
        """Root (n, k) of the covariance of what is determined, and the readings' share (rank, k) of it."""
        basis, seen = self._determined
        if basis.shape[1] == 0:
            return np.zeros((len(self.weight), 0)), np.zeros((0, 0))
        triangle = np.linalg.qr(np.vstack([seen, self.weight[:, None] * basis]), mode="r")
        root = solve_triangular(triangle, basis.T, trans="T").T
        share = solve_triangular(triangle, seen.T, trans="T").T
        return np.asarray(root), np.asarray(share)

    @property
    def root(self) -> Array:
        """(n, k) F with covariance F F' in steps; without the directions that nothing determines."""
        return self._posterior[0]

    def root_with(self, slope: float, noise: Sequence[Array]) -> Array:
        """(n, k) F of the covariance F F' = A^-1 M A^-1 of an estimate whose readings were not as noisy as stated.

        With R the readings' factor and P the prior's information, A = slope R'R + P and M = sum of N'N + P over the
        factors (k, n) of ``noise``. Equal to that of ``root`` where slope is 1 and M is A.
        """
        basis, seen = self._determined
        if basis.shape[1] == 0:
            return self.root
        held = self.weight[:, None] * basis
        triangle = np.linalg.qr(np.vstack([np.sqrt(slope) * seen, held]), mode="r")
        moved = np.vstack([*(part @ basis for part in noise), held])
        return np.asarray(basis @ solve_triangular(triangle, solve_triangular(triangle, moved.T, trans="T")))

    @property
    def effective(self) -> float:
        """Degrees of freedom that the readings use: trace of their share of the information."""
        return float(np.sum(self._posterior[1] ** 2))

    def share(self, factor: Array) -> float:
        """Degrees of freedom that readings with this factor (k, n) use."""
        return float(np.sum((factor @ self.root) ** 2))

    @property
    def std(self) -> Array:
        """(n,) 1-sigma in steps, inf where an unknown direction takes part."""
        out: Array = np.linalg.norm(self.root, axis=1)
        return np.where(moved_by(self.unknown), np.inf, out)

    def observability(self, n_observations: int) -> Observability:
        """Indices O1 to O5 of the seen directions, for a number of readings."""
        s = self.singular[: self.rank]
        if not len(s):
            return Observability(0.0, 0.0, 0.0, 0.0, 0.0)
        volume = float(np.exp(np.mean(np.log(s)))) / np.sqrt(max(n_observations, 1))
        first, last = float(s[0]), float(s[-1])
        return Observability(volume, last / first, last, last**2 / first, 1.0 / float(np.sum(1.0 / s)))


def moved_by(directions: Array) -> Mask:
    """(n,) the entries that orthonormal directions (k, n), in steps, move by enough to leave them open."""
    return np.asarray(np.linalg.norm(directions, axis=0) >= TAKES_PART)
