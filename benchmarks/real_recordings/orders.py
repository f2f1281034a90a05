"""Periodic errors of a joint at any number of cycles a turn: which stand out of what is left, in both recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from real_recordings.common import Array, Mask
from real_recordings.linearised import Linearised

STEP = 0.5
SHUFFLES = 20
SEED = 11


@dataclass(frozen=True)
class Spectrum:
    """Orders (m,), power (m,): 1 on average where nothing is periodic, and amplitude (m,) rad; limit of chance.

    limit is the largest power that 20 shuffles of the rows reached anywhere.
    """

    order: Array
    power: Array
    amplitude: Array
    limit: float

    def peaks(self, count: int) -> Array:
        """(count,) places of the highest powers, none within three orders of a higher one."""
        chosen: list[int] = []
        for k in np.argsort(-self.power).tolist():
            if all(abs(self.order[k] - self.order[c]) > 3.0 for c in chosen):
                chosen.append(k)
            if len(chosen) == count:
                break
        return np.array(chosen)


def spectrum(
    data: Linearised, left: Array, outlier: Mask, joint: int, lowest: float, highest: float
) -> Spectrum:
    """What waves of one joint's angle would explain of the rows, each order alone."""
    good = ~outlier
    sigma = np.repeat([np.sqrt(np.mean(left[good][:, k] ** 2)) for k in (slice(0, 3), slice(3, 6))], 3)
    port = data.joint[good, :, joint] / sigma
    score = np.einsum("nc,nc->n", port, left[good] / sigma)
    weight = float(np.sum(port**2))
    angle = data.q[good, joint]
    order = np.arange(lowest, highest, STEP)
    sums = _waves(angle, order, score[:, None])[:, 0]
    rng = np.random.default_rng(SEED)
    shuffled = np.column_stack([rng.permutation(score) for _ in range(SHUFFLES)])
    energy = float(score @ score)
    chance = np.abs(_waves(angle, order, shuffled)) ** 2 / energy
    return Spectrum(order, np.abs(sums) ** 2 / energy, 2.0 * np.abs(sums) / weight, float(chance.max()))


def _waves(angle: Array, order: Array, values: Array) -> np.ndarray[tuple[int, int], np.dtype[np.complex128]]:
    """(m, c) sums of values (n, c) times exp(i order angle)."""
    turn, step = np.exp(1j * order[0] * angle), np.exp(1j * STEP * angle)
    out = np.empty((len(order), values.shape[1]), dtype=complex)
    for k in range(len(order)):
        out[k] = turn @ values
        turn = turn * step
    return out
