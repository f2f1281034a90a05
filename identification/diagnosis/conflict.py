"""The alarm of a conflict with tolerances.

The conflict is linear algebra on one Gram matrix of [J r]. In steps of tolerances, an identifiable combination of
parameters with information h departs from the drawing, in the least-squares sense, with variance 1 + 1/h when
nothing is missing; the readings at the drawing values have covariance k^2 I + J S J'. The noise k is that of the
free fit, which makes neither statistic exactly chi2: machines are drawn from their tolerances, readings from
the noise, and both go through the same steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.fit.estimate import FREE_WIDENING
from truepose.identification.signatures.linearisation import Linearisation

MACHINES, MACHINES_SEED = 999, 17
"""Machines that are drawn from their tolerances, and their seed."""


@dataclass(frozen=True)
class _Seen:
    """Combinations that readings see, in tolerances at unit noise: information h (m,), and what to project by.

    ``known`` and ``unknown`` index geometry with and without a tolerance; ``solve`` inverts the latter's
    information, which is projected out.
    """

    lin: Linearisation
    known: Index
    unknown: Index
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
