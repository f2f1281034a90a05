"""Rival explanations of every movement: the noise is not as stated, or tolerances are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.tolerance_classes import PartClass, tolerance_cost
from truepose.identification.prior import SIGMA_DOUBT

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scales:
    """A noise scale and an inflation of tolerances per class of parts, with the log of their prior probability."""

    noise: float
    inflation: tuple[float, ...]
    log_prior: float


@dataclass(frozen=True)
class Grid:
    """Noise scales and tolerance inflations of the classes of parts; every combination is weighed."""

    noise: tuple[float, ...]
    inflation: tuple[tuple[float, ...], ...]
    classes: tuple[PartClass, ...]

    @cached_property
    def points(self) -> tuple[Scales, ...]:
        """Every combination: for each noise scale all inflations."""
        return tuple(Scales(k, i, self.log_prior(k, i)) for k in self.noise for i in self.inflation)

    def log_prior(self, noise: float, inflation: Sequence[float]) -> float:
        """Stated sigmas are mostly right and sometimes far off; tolerances are rarely off by much."""
        return float(SIGMA_DOUBT.log_prior(np.log(noise))) - tolerance_cost(inflation, self.classes)


def noise_scales(rms: float, step: float) -> tuple[float, ...]:
    """Noise scales from below the stated sigma to ``rms``, what geometry alone leaves, ``step`` apart in the log."""
    top = max(1.7, 1.2 * rms)
    above = np.geomspace(1.35, top, max(2, int(np.ceil(np.log(top / 1.35) / step)) + 1))
    return tuple(float(v) for v in (0.8, 1.0, *above))


def log_gains(sizes: Array, information: Array, score: Array) -> Array:
    """(s, ...) log Bayes factors of terms whose unknowns are N(0, size^2) for each of ``sizes`` (s,).

    ``information`` and ``score`` (..., k): eigenvalues of the unknowns' information, all else free, and the score turned
    to its eigenvectors.
    """
    squared = sizes.reshape(-1, *(1,) * score.ndim) ** 2
    damped = 1.0 + squared * information
    out: Array = 0.5 * np.sum(squared * score**2 / damped - np.log(damped), axis=-1)
    return out
