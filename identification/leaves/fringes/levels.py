"""Find gain, offset and contrast of a photocurrent from the signal itself: the two levels of its fringe.

The signal at resonance (``low``) and between resonances (``high``) normalises a fringe to v in [0, 1]. Both
may drift during a series. They are found where the mirror passes several fringes evenly: there the times of the
crossings give the phase without any level, and the levels follow by linear least squares.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.leaves.fringes.excursions import Excursions, extremes
from truepose.models.sensors.irradiance import fringe

EVEN = 10
"""Excursions passed evenly that are enough to find levels."""
_PER_KNOT, _SAMPLES, _EXCURSIONS = 12, 50_000, 20_000
_KNOTS = (1, 2, 3, 5, 9)
_PRICE = 30.0  # in chi2, of a knot
_EVENNESS = (1.15, 1.3)  # factors between neighbours' rates, the first that enough excursions meet
_LONGER = float(np.log(1.35))
_SMALLER = 0.15
_SHARE = 0.05  # of what does not fit may be in the levels


@dataclass(frozen=True)
class Levels:
    """Signal at the ends of a fringe, straight between ``knots`` (times) and constant outside.

    ``sigma`` is their 1-sigma and ``misfit`` the rms by which fringes differ from the cavity's shape beyond
    noise, both in units of v.
    """

    knots: Array  # (m,)
    low: Array  # (m,)
    high: Array  # (m,)
    sigma: float = 0.0
    misfit: float = 0.0

    def normalise(self, t: Array | float, signal: Array | float) -> Array:
        """v of one sample, or of samples (n,) at times (n,): 0 at resonance, 1 between resonances."""
        if len(self.knots) == 1:
            return np.asarray((signal - self.low[0]) / (self.high[0] - self.low[0]))
        low = np.interp(t, self.knots, self.low)
        return np.asarray((signal - low) / np.interp(t, self.knots, self.high - self.low))

    def at(self, t: float) -> Levels:
        """Constant levels, those at time ``t``."""
        low, high = (np.array([np.interp(t, self.knots, end)]) for end in (self.low, self.high))
        return Levels(np.array([t]), low, high, self.sigma, self.misfit)

    def corrected(self, low: float, high: float, sigma: float) -> Levels:
        """These levels, corrected by the v (near 0 and 1) at which the ends of the fringe were found."""
        span = self.high - self.low
        return Levels(self.knots, self.low + low * span, self.low + high * span, sigma, self.misfit)

    def differs(self, other: Levels, share: float) -> bool:
        """Whether the other levels are elsewhere by more than a share of the fringe, at the knots of both."""
        at = np.concatenate([self.knots, other.knots])
        low = np.interp(at, self.knots, self.low) - np.interp(at, other.knots, other.low)
        high = np.interp(at, self.knots, self.high) - np.interp(at, other.knots, other.high)
        return bool(max(np.abs(low).max(), np.abs(high).max()) > share * self.size)

    @property
    def size(self) -> float:
        """Mean peak-to-peak signal of a fringe."""
        return float(np.mean(self.high - self.low))


@dataclass(frozen=True)
class Noise:
    """Noise of a sample: its 1-sigma, and the part of it (``stuck``) that averaging does not reduce.

    That part comes from a converter: a signal calmer than its steps stays on one of them.
    """

    sigma: float
    stuck: float

    def over(self, size: float) -> Noise:
        """The noise in units of ``size``, such as the signal between the levels."""
        return Noise(self.sigma / size, self.stuck / size)


def noise_of(signal: Array) -> Noise:
    """Noise of samples (n,): from second differences where they are calmest, and from a converter's step."""
    length = 256
    if len(signal) < 4:
        return Noise(0.0, 0.0)
    starts = np.linspace(0, max(len(signal) - length, 0), 64).astype(int)
    pieces = [signal[s : s + length] for s in np.unique(starts)]
    seconds = [np.median(np.abs(np.diff(piece, 2))) for piece in pieces]
    random = 1.4826 * float(np.quantile(seconds, 0.2)) / np.sqrt(6.0)
    sampled = signal if len(signal) <= 64 * length else np.concatenate(pieces)  # pieces do not overlap
    values = np.unique(sampled)
    if len(values) < 2 or len(values) > 0.5 * len(sampled):  # values hardly repeat: no steps
        return Noise(float(random), 0.0)
    step = float(np.min(np.diff(values)))
    # the mean error of a rounded Gaussian: its first harmonic
    stuck = step / np.pi * np.exp(-2.0 * (np.pi * random / step) ** 2) / np.sqrt(2.0)
    return Noise(float(np.hypot(random, step / np.sqrt(12.0))), float(stuck))


def rough_levels(signal: Array) -> Levels:
    """Constant levels from the range of samples (n,), a few outliers apart."""
    sparse = signal[:: max(1, len(signal) // 1_000_000)]
    low, high = np.quantile(sparse, (1e-4, 1.0 - 1e-4))
    return Levels(np.zeros(1), np.array([low]), np.array([high]))


def evenly_passed(signal: Array, found: Excursions, size: float, within: float) -> Mask:
    """(K + 1,) excursions as large as most, whose neighbours' phase rates agree to a factor ``within``.

    A turning point is passed at another rate than its neighbours, or not as large.
    """
    even = np.zeros(len(found), dtype=bool)
    if len(found) < 5:
        return even
    speed = found.speeds[1:-1]
    # a half level that is off makes every other excursion longer: the first measure allows for that
    uneven = np.abs(np.log(speed[1:-1] / (0.5 * (speed[:-2] + speed[2:]))))
    change = np.abs(np.log(speed[2:] / speed[:-2]))
    even[2:-2] = (uneven < _LONGER) & (change < np.log(within))
    ends = extremes(signal, found)
    for kind in (True, False):
        same = even & (found.high == kind)
        if same.any():
            even[same] = np.abs(ends[same] - np.median(ends[same])) < _SMALLER * size
    return even


def fitted_levels(
    t: Array, signal: Array, found: Excursions, g: float, noise: float, size: float
) -> Levels | None:
    """Levels by least squares over excursions passed evenly; None when there are fewer than ``EVEN``.

    Times and samples are (n,). ``noise`` is the 1-sigma of a sample, ``size`` roughly the signal between the levels.
    Where the assumed half level was off, excursions to one side last longer than to the other: their durations give
    the phase of the crossings, so that no level enters. As many knots are taken as the data ask for.
    """
    for within in _EVENNESS:
        even = np.flatnonzero(evenly_passed(signal, found, size, within))
        if len(even) >= EVEN and found.high[even].any() and (~found.high[even]).any():
            break
    else:
        return None
    best, least = None, np.inf
    for m in _KNOTS:
        if m > 1 and len(even) < m * _PER_KNOT:
            break
        levels, chi2 = _levels_at(t, signal, found, even, _knots(found, even, m), g, noise)
        if levels is not None and chi2 + _PRICE * m < least:
            best, least = levels, chi2 + _PRICE * m
    return best


def _levels_at(
    t: Array, signal: Array, found: Excursions, even: Index, knots: Array, g: float, noise: float
) -> tuple[Levels | None, float]:
    """Levels at given knots, and chi2 of the samples."""
    at, which = inside_samples(found, even)
    x = crossing_phases(t[at], which, found, level_error(found, even, knots))
    shape = fringe(np.where(found.high[which], -np.cos(x), np.cos(x)), g)
    hats = hat_shares(t[at], knots)
    columns = np.hstack([hats * (1.0 - shape)[:, None], hats * shape[:, None]])
    values, covariance, rms = robust_fit(columns, signal[at])
    m = len(knots)
    size = float(np.mean(values[m:] - values[:m]))
    if not (values[m:] - values[:m] > 0.5 * size).all():
        return None, np.inf
    excess = np.sqrt(max(rms**2 - noise**2, 0.0))
    sigma = np.sqrt(max(float(np.max(np.diag(covariance))), 0.0) * rms**2 + (_SHARE * excess) ** 2)
    chi2 = len(at) * np.log(rms + 1e-300) * 2.0
    levels = Levels(knots, values[:m], values[m:], float(sigma / size), float(excess / size))
    return extended((float(t[0]), float(t[-1])), levels), float(chi2)


def extended(span: tuple[float, float], levels: Levels) -> Levels:
    """Levels that go on as they drift, up to the ends of the series."""
    knots, low, high = levels.knots, levels.low, levels.high
    if len(knots) < 2:
        return levels
    ends = min(span[0], float(knots[0])), max(span[1], float(knots[-1]))

    def beyond(values: Array) -> Array:
        first = values[0] + (values[1] - values[0]) / (knots[1] - knots[0]) * (ends[0] - knots[0])
        last = values[-1] + (values[-1] - values[-2]) / (knots[-1] - knots[-2]) * (ends[1] - knots[-1])
        return np.concatenate([[first], values, [last]])

    further = np.concatenate([[ends[0]], knots, [ends[1]]])
    return replace(levels, knots=further, low=beyond(low), high=beyond(high))


def _knots(found: Excursions, even: Index, m: int) -> Array:
    first, last = found.times[even[0] - 1], found.times[even[-1]]
    return np.linspace(first, last, m) if m > 1 else np.array([0.5 * (first + last)])


def hat_shares(t: Array, knots: Array) -> Array:
    """(n, m) shares of the knots: straight between them, constant outside."""
    if len(knots) == 1:
        return np.ones((len(t), 1))
    place = np.interp(t, knots, np.arange(len(knots)))
    left = np.minimum(place.astype(int), len(knots) - 2)
    out = np.zeros((len(t), len(knots)))
    rows = np.arange(len(t))
    out[rows, left] = 1.0 - (place - left)
    out[rows, left + 1] = place - left
    return out


def inside_samples(found: Excursions, even: Index) -> tuple[Index, Index]:
    """Samples inside the even excursions, at most so many, and the excursion of each."""
    sizes = found.sizes[even]
    total = int(sizes.sum())
    stride = max(1, total // _SAMPLES)
    place = np.arange(0, total, stride)
    ends = np.cumsum(sizes)
    which = np.searchsorted(ends, place, side="right")
    at = found.first[even[which]] + place - (ends - sizes)[which]
    return at.astype(np.intp), even[which]


def level_error(found: Excursions, even: Index, knots: Array) -> Array:
    """(K + 1,) phase by which a crossing is too near the high end: from excursions that last too long."""
    even = even[:: max(1, len(even) // _EXCURSIONS) | 1]  # an odd stride takes both kinds
    speed, width = found.speeds, found.half_width
    rate = 0.5 * (speed[even - 1] + speed[even + 1])  # rates of the neighbours have the opposite error
    other = width[even - 1]
    lasts = width[even] / speed[even]
    sign = np.where(found.high[even], -1.0, 1.0)
    # durations are (w -+ e) / true rate: 2 equations for the true rate and e
    ratio = lasts * rate / other
    error = sign * (ratio * other - width[even]) / (1.0 + ratio)
    middle = 0.5 * (found.times[even] + found.times[even - 1])
    coefficients, _, _ = robust_fit(hat_shares(middle, knots), error)
    centres = np.empty(len(found))
    centres[1:-1] = 0.5 * (found.times[1:] + found.times[:-1])
    centres[0], centres[-1] = found.times[0], found.times[-1]
    return np.asarray(hat_shares(centres, knots) @ coefficients)


def crossing_phases(t: Array, which: Index, found: Excursions, error: Array) -> Array:
    """Phase from the end of the fringe of samples (n,) in excursions ``which``, by the crossings' times.

    Cubic between crossings, with the slope of a parabola through three of them.
    """
    half = found.half_width + np.where(found.high, -error, error)
    start, stop = found.times[which - 1], found.times[which]
    duration = stop - start
    rate = 2.0 * half / found.durations  # NaN at both ends, which are no neighbours of even excursions

    def slope(left: Index) -> Array:
        a, b = found.durations[left], found.durations[left + 1]
        return np.asarray((rate[left] * b + rate[left + 1] * a) / (a + b))

    u = (t - start) / duration
    low, high = -half[which], half[which]
    first, last = slope(which - 1) * duration, slope(which) * duration
    straight = low + (high - low) * (3.0 * u**2 - 2.0 * u**3)
    return np.asarray(straight + first * u * (1.0 - u) ** 2 - last * u**2 * (1.0 - u))


def robust_fit(columns: Array, values: Array) -> tuple[Array, Array, float]:
    """Least squares without what lies beyond five sigmas, as the median deviation tells them; (J'J)^-1 and the rms."""
    keep = np.ones(len(values), dtype=bool)
    for _ in range(4):
        used = columns[keep]
        inverse = np.linalg.pinv(used.T @ used)
        solution = np.asarray(inverse @ (used.T @ values[keep]), dtype=np.float64)
        residual = values - columns @ solution
        spread = 1.4826 * float(np.median(np.abs(residual)))
        rms = float(np.sqrt(np.mean(residual[keep] ** 2)))
        keep = np.abs(residual) <= 5.0 * spread + 1e-300
        if not keep.any():
            break
    return solution, np.asarray(inverse, dtype=np.float64), rms
