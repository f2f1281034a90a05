"""Find the level at which a series rests before it moves, or after it moved (given reversed)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.fringes.levels import Noise

_DRIFT = 0.001  # of a fringe: slower changes at rest are averaged
_SIGMAS = 5.0
_FINE = 0.02  # of a fringe: no step is so short that noise hides more than this
_MOVED = 0.2  # of a fringe: the mirror moves for certain
_BLOCKS = 8
_END = 0.05  # of a fringe
_BACK = 2.5
_PARTS = 8
_SPARSE = 4096  # samples that are enough for a level to compare with


@dataclass(frozen=True)
class Rest:
    """The first ``samples`` of a series stay at ``level``, known to ``sigma``.

    ``still``: they are so many that the mirror rests; else they are the first ones of a motion.
    """

    samples: int
    level: float
    sigma: float
    still: bool


def find_rest(v: Array, noise: Noise) -> Rest:
    """How long v (n,) stays where it starts; with ``noise`` in units of v.

    Windows double while their halves agree, then grow in ever shorter steps. Motions begin within the noise: the
    rest ends as long before the first sign of motion as that is before a large one, and `_BACK` times as long
    at the end of a fringe, where the signal may grow with the sixth power of time. A series that moves from its
    first sample on rests for one.
    """
    samples = 1
    while 2 * samples <= len(v) and _stays(v, samples, samples, noise.sigma):
        samples *= 2
    step, finest = samples // _BLOCKS, max(1, round((_SIGMAS * noise.sigma / _FINE) ** 2))
    while step >= finest:
        if samples + step <= len(v) and _stays(v, samples, step, noise.sigma):
            samples, step = samples + step, min(2 * step, samples // _BLOCKS)
        else:
            step //= 2
    level = float(np.mean(v[:samples]))
    back = _BACK if min(level, 1.0 - level) < _END else 1.0
    moved = _until_moved(v, samples, level)
    calm = max(samples - round(back * moved), samples // 2, 1)
    return Rest(calm, float(np.mean(v[:calm])), _spread(v[:calm], noise), calm >= moved)


def _spread(v: Array, noise: Noise) -> float:
    """1-sigma of the mean of v (n,): by the noise, or by the means of parts where vibrations make them differ."""
    random = float(np.hypot(noise.sigma / np.sqrt(len(v)), noise.stuck))
    if len(v) < 4 * _PARTS:
        return random
    means = [float(np.mean(part)) for part in np.array_split(v, _PARTS)]
    return max(random, float(np.std(means, ddof=1)) / float(np.sqrt(_PARTS)))


def _stays(v: Array, samples: int, more: int, noise: float) -> bool:
    """Whether the mean of ``more`` samples after the first ones, and of each quarter of them, is theirs."""
    first, then = v[: samples : max(1, samples // _SPARSE)], v[samples : samples + more]
    level = float(np.mean(first))
    parts = [then, *np.array_split(then, 4)] if more >= 4 else [then]
    limits = [_SIGMAS * noise * np.sqrt(1.0 / len(first) + 1.0 / len(part)) + _DRIFT for part in parts]
    return all(abs(np.mean(part) - level) <= limit for part, limit in zip(parts, limits, strict=True))


def _until_moved(v: Array, samples: int, level: float) -> int:
    """Samples from the first sign of motion to a large one, 0 when there is none."""
    start, length = samples, max(samples // _BLOCKS, 64)
    while start < len(v):
        far = np.flatnonzero(np.abs(v[start : start + length] - level) > _MOVED)
        if len(far):
            return int(start + far[0] - samples)
        start, length = start + length, 2 * length
    return 0
