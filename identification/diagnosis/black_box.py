"""What as many free functions of the joints predict: physics that was named must do better than so much freedom."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from truepose.arrays import Array, Index, Mask
from truepose.identification.diagnosis.holdout import ROLE, held_out_blocks
from truepose.identification.fit.estimate import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording

LARGEST = 30_000_000
"""Entries of the Jacobian with waves that are held: with more, evenly spread rows are asked."""
FREE_WAVE = 10.0
"""1-sigma of an amplitude of the black box, in sigmas of a reading: it may be anything."""
ROUNDING = 1e-13
"""Squared pivots, and shares of the largest eigenvalue, that are rounding."""


def black_box(before: Estimate, after: Estimate, recording: Recording, outliers: Mask) -> float | None:
    """Held-out ratio of as many free waves of the readings, in each residual channel, as the terms have coefficients."""
    count = sum(len(e.coefficients) for e in after.effects)
    free, m = before.prior.free, before.residual.shape[1]
    columns = len(free) + count
    if before.residual.size * columns > LARGEST:
        return _of_some(before, after, recording, outliers, LARGEST // (m * columns))
    predictor = Predictor(before.nominal, recording, before.effects)
    parts = predictor.blocks(before.p, before.x, before.used)
    jacobian = np.concatenate([b.jacobian[:, :, free] * before.prior.scale[free] for b in parts])
    rng = np.random.default_rng(13)
    t = (recording.q - recording.q.mean(axis=0)) / np.maximum(recording.q.std(axis=0), 1e-12)
    waves = np.cos(t @ rng.normal(0, 1.0, (t.shape[1], count)) + rng.uniform(0, 2 * np.pi, count))
    free_waves = Waves(waves, rng.integers(0, m, count), before.lost)
    split, blocks = held_out_blocks(recording, before.used)
    left, usable = [], np.isfinite(before.residual).all(axis=1) & ~outliers
    for beside in (None, free_waves):
        squares = [
            linear_test(jacobian, before, before.used & ~block.rows & usable, block.rows & usable, beside)
            for block in (blocks[-1:] if split == ROLE else blocks)
        ]
        left.append(np.concatenate(squares).mean())
    return float(np.sqrt(left[1] / left[0]))


def _of_some(
    before: Estimate, after: Estimate, recording: Recording, outliers: Mask, most: int
) -> float | None:
    """The same of evenly spread rows, as many as memory holds; None where readings compare rows."""
    if most < 1 or any(sensor.compares for sensor in before.nominal.sensors):
        return None
    every = recording.in_time(np.ones(len(recording), dtype=bool))
    rows = np.sort(every[:: -(-len(every) // most)])
    part = replace(
        before,
        x=before.x[rows],
        residual=before.residual[rows],
        used=before.used[rows],
        weights=before.weights[rows],
        lost=before.lost_among(rows),
        unassembled=(),
    )
    return black_box(part, after, recording.subset(rows), outliers[rows])


@dataclass(frozen=True)
class Waves:
    """Functions of the row (n, k), each in one ``channel`` (k,); nothing where a reading was ``lost`` (n, m)."""

    values: Array
    channel: Index
    lost: Mask | None

    def gram(self, jacobian: Array, residual: Array, rows: Mask) -> Array:
        """(n + k + 1, n + k + 1) of [J W r] over some rows; waves of two channels have no reading in common."""
        n, size = jacobian.shape[2], jacobian.shape[2] + len(self.channel) + 1
        out = np.zeros((size, size))
        for channel in range(jacobian.shape[1]):
            own = np.flatnonzero(self.channel == channel)
            at = np.concatenate([np.arange(n), n + own, [size - 1]])
            columns = [
                jacobian[rows, channel],
                self._of(channel, own)[rows],
                residual[rows, channel][:, None],
            ]
            part = np.hstack(columns)
            out[np.ix_(at, at)] += part.T @ part
        return out

    def seen(self, amplitudes: Array, shape: tuple[int, ...]) -> Array:
        """(n, m) what they do to the readings with amplitudes (k,)."""
        out = np.zeros(shape)
        for channel in range(shape[1]):
            own = np.flatnonzero(self.channel == channel)
            out[:, channel] = self._of(channel, own) @ amplitudes[own]
        return out

    def _of(self, channel: int, own: Index) -> Array:
        there = 1.0 if self.lost is None else ~self.lost[:, [channel]]
        return np.asarray(self.values[:, own] * there)


def linear_test(
    jacobian: Array, before: Estimate, train: Mask, test: Mask, beside: Waves | None = None
) -> Array:
    """Squared residuals of held-out rows after one linear fit under tolerances from the training rows.

    ``beside``: free functions of the row, each with a tolerance of ``FREE_WAVE``.
    """
    free = before.prior.free
    waves = beside or Waves(np.zeros((len(jacobian), 0)), np.zeros(0, dtype=np.intp), None)
    n, k = len(free), len(free) + len(waves.channel)
    weight = np.concatenate([before.prior_weight, np.full(k - n, 1.0 / FREE_WAVE)])
    moved = (before.p - before.prior.mean)[free] / before.prior.scale[free]
    departure = np.concatenate([np.where(before.prior_weight > 0, moved, 0.0), np.zeros(k - n)])
    gram = waves.gram(jacobian, before.residual, train)
    right = gram[:-1, -1] + weight**2 * departure
    known = gram[:-1, :-1] + np.diag(weight**2)
    unit = 1.0 / np.sqrt(np.maximum(np.diag(known), 1e-300))
    step = -unit * _solution(known * unit[:, None] * unit, unit * right)
    changed = jacobian[test] @ step[:n] + waves.seen(step[n:], before.residual.shape)[test]
    return np.asarray(np.sum((before.residual[test] + changed) ** 2, axis=1))


def _solution(matrix: Array, right: Array) -> Array:
    """Of a symmetric problem of unit diagonal; the shortest one where rounding leaves directions open."""
    factor, failed = dpotrf(matrix, lower=1)
    if failed or np.min(np.diag(factor), initial=1.0) ** 2 < ROUNDING:
        return np.asarray(np.linalg.lstsq(matrix, right, rcond=ROUNDING)[0])
    return np.asarray(dpotrs(factor, right, lower=1)[0])
