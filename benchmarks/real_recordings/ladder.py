"""One cause after the other: fits of growing models to one recording, and what each leaves of the held-out rows.

All stages are parts of one linear model, so that one Gram matrix serves them all. Coefficients have the prior that
their columns are scaled by; the noise of positions and of rotations is what the largest model leaves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from real_recordings.common import Array, Mask, rms
from real_recordings.linearised import Linearised
from real_recordings.regressors import Rows, Term

Noise = tuple[float, ...]
"""Sigma of positions (mm) and of rotations (rad)."""
CHUNK = 512
KINDS = (slice(0, 3), slice(3, 6))
START = (0.05, 2e-4)
"""Noise to begin with: mm, rad."""
OUTLIER = 5.0
"""Rows further off than so many robust sigmas (of the norm of their three positions) are set aside."""


@dataclass(frozen=True)
class Rung:
    """What one stage leaves: residual (n, 6) mm and rad."""

    name: str
    columns: int
    residual: Array


@dataclass(frozen=True)
class Ladder:
    """All stages, the rows set aside as outliers (n,), and the noise sigmas of positions (mm) and rotations (rad)."""

    rungs: tuple[Rung, ...]
    outlier: Mask
    noise: Noise

    def residual(self, name: str) -> Array:
        """(n, 6) of the stage of that name."""
        return next(r.residual for r in self.rungs if r.name == name)


def climb(data: Linearised, stages: Mapping[str, Sequence[Term]]) -> Ladder:
    """Fit every stage with all stages before it to the rows that are not held out."""
    terms = [term for own in stages.values() for term in own]
    geometry = data.geometry.shape[2]
    sizes = np.cumsum([0] + [t.columns(np.array([0])).shape[2] for t in terms]) + geometry
    ends, used = [], 0
    for own in stages.values():
        used += len(own)
        ends.append(int(sizes[used]))
    grams = _Grams(data, terms, int(sizes[-1]))
    train = np.flatnonzero(~data.held)
    grams.add(train, 1.0)
    noise: Noise = START
    outlier = np.zeros(len(data), dtype=bool)
    for _ in range(3):
        left = grams.residual([grams.solve(noise, ends[-1])])[0]
        found = outliers(left)
        for rows, sign in (
            (train[found[train] & ~outlier[train]], -1.0),
            (train[~found[train] & outlier[train]], 1.0),
        ):
            grams.add(rows, sign)
        outlier = found
        good = ~found & ~data.held
        spent = left[good].size / (left[good].size - grams.effective(noise))
        noise = tuple(float(np.sqrt(spent * np.mean(left[good][:, kind] ** 2))) for kind in KINDS)
    residuals = grams.residual([grams.solve(noise, end) for end in ends])
    rungs = [Rung(name, end, e) for name, end, e in zip(stages, ends, residuals, strict=True)]
    return Ladder(tuple(rungs), outlier, noise)


def outliers(residual: Array) -> Mask:
    """(n,) rows whose position is further off than ``OUTLIER`` robust sigmas."""
    sigma = 1.4826 * float(np.median(np.abs(residual[:, :3])))
    return np.asarray(np.linalg.norm(residual[:, :3], axis=1) > OUTLIER * sigma * np.sqrt(3.0))


class _Grams:
    """Sums of X'X and X'y over rows, apart for positions and rotations, so that noise may change later."""

    def __init__(self, data: Linearised, terms: Sequence[Term], size: int) -> None:
        self._data, self._terms = data, terms
        self._square = [np.zeros((size, size)) for _ in KINDS]
        self._right = [np.zeros(size) for _ in KINDS]

    def _columns(self, rows: Rows) -> Array:
        return np.concatenate([self._data.geometry[rows], *(t.columns(rows) for t in self._terms)], axis=2)

    def _chunks(self, rows: Rows) -> list[Rows]:
        return [rows[k : k + CHUNK] for k in range(0, len(rows), CHUNK)]

    def add(self, rows: Rows, sign: float) -> None:
        for part in self._chunks(rows):
            columns, y = self._columns(part), self._data.residual[part]
            for k, kind in enumerate(KINDS):
                x = columns[:, kind].reshape(-1, columns.shape[2])
                self._square[k] += sign * (x.T @ x)
                self._right[k] += sign * (x.T @ y[:, kind].reshape(-1))

    def _normal(self, noise: Noise, end: int) -> Array:
        return np.asarray(
            sum(g[:end, :end] / s**2 for g, s in zip(self._square, noise, strict=True)) + np.eye(end)
        )

    def effective(self, noise: Noise) -> float:
        """How many readings all coefficients cost, their priors counted."""
        size = len(self._right[0])
        return size - float(np.trace(np.linalg.inv(self._normal(noise, size))))

    def solve(self, noise: Noise, end: int) -> Array:
        """(end,) coefficients of the first columns, each with prior sigma 1."""
        right = sum(h[:end] / s**2 for h, s in zip(self._right, noise, strict=True))
        return np.asarray(np.linalg.solve(self._normal(noise, end), right))

    def residual(self, solutions: Sequence[Array]) -> list[Array]:
        """(n, 6) what each solution leaves of every row."""
        padded = np.zeros((len(self._right[0]), len(solutions)))
        for k, b in enumerate(solutions):
            padded[: len(b), k] = b
        rows = np.arange(len(self._data))
        predicted = np.concatenate([self._columns(part) @ padded for part in self._chunks(rows)])
        return [self._data.residual - predicted[:, :, k] for k in range(len(solutions))]


def held_out(data: Linearised, residual: Array, without: Mask | None = None) -> tuple[float, float]:
    """Rms of held-out rows: position um, rotation urad (3-D norms)."""
    rows = data.held if without is None else data.held & ~without
    return 1e3 * rms(residual[rows][:, :3]), 1e6 * rms(residual[rows][:, 3:])
