"""A signal as excursions above and below half of its fringe, and how fast the mirror went through each.

The half level divides a fringe into a part around its low end (resonance) and one around its high end. What
lies between two crossings of that level is an excursion: it goes to one end of the fringe, and the mirror
either passes there or turns around (`truepose.identification.leaves.fringes.turns`). Everything here is O(n).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.models.sensors.irradiance import folded_phase

# -- A signal as excursions above and below half of its fringe, and how fast the mirror went through each

HALF = 0.5
_HYSTERESIS = 0.08
_COUNTED = 8  # samples around a crossing from which on it is found by counting


@dataclass(frozen=True)
class Excursions:
    """K + 1 excursions of a series, ``high`` and low by turns; the first and the last are cut by its ends.

    Crossing k, at ``times[k]``, lies between excursions k and k + 1; excursion k owns the samples from
    ``first[k]`` to ``first[k + 1]``. ``reach`` are the phases (rad) between the half level and the low and the
    high end of a fringe.
    """

    high: Mask  # (K + 1,)
    first: Index  # (K + 2,)
    times: Array  # (K,)
    reach: tuple[float, float]

    def __len__(self) -> int:
        return len(self.high)

    @property
    def durations(self) -> Array:
        """(K + 1,) time between the crossings around each; NaN for the first and the last."""
        out = np.full(len(self), np.nan)
        out[1:-1] = np.diff(self.times)
        return out

    @property
    def half_width(self) -> Array:
        """(K + 1,) phase from a crossing to the end of the fringe that the excursion goes to, rad."""
        return np.where(self.high, self.reach[1], self.reach[0])

    @property
    def speeds(self) -> Array:
        """(K + 1,) mean phase rate if the mirror passed, rad per time; NaN for the first and the last."""
        return 2.0 * self.half_width / self.durations

    @property
    def sizes(self) -> Index:
        """(K + 1,) number of samples of each."""
        return np.diff(self.first)


def find_excursions(t: Array, v: Array, noise: float, g: float) -> Excursions:
    """Excursions of a normalised signal v (n,) at times (n,), with 1-sigma ``noise``.

    A band around the half level, wider than the noise, keeps noise from counting as crossings.
    """
    band = max(_HYSTERESIS, 5.0 * noise)
    up = v > HALF + band
    outside = np.flatnonzero(up | (v < HALF - band))
    high = up[outside]
    change = np.flatnonzero(high[1:] != high[:-1])
    before, after = outside[change], outside[change + 1]
    kinds = high[np.concatenate([change, [len(high) - 1]])] if len(high) else np.array([v.mean() > HALF])
    times = _crossing_times(t, v, before, after, g)
    first = np.concatenate([[0], np.searchsorted(t, times, side="right"), [len(t)]]).astype(np.intp)
    low = float(folded_phase(HALF, g))
    return Excursions(kinds, first, times, (low, np.pi - low))


def _crossing_times(t: Array, v: Array, before: Index, after: Index, g: float) -> Array:
    """(K,) times at which v passes its half level between samples ``before`` and ``after`` on either side."""
    if not len(before):
        return np.empty(0)
    above = v > HALF
    rising = above[after]
    # where samples are dense: as much of the time below the level as there are samples below it
    pairs = np.column_stack([before, after]).ravel()
    inside = np.add.reduceat(above, pairs, dtype=np.intp)[::2]
    span = after - before
    share = np.where(rising, span - inside, inside) / span
    counted = t[before] + (t[after] - t[before]) * share
    # where they are sparse: the phase is straight between the two samples around the level
    sparse = np.flatnonzero(span < _COUNTED)
    low, up = neighbours_around(above, before[sparse], after[sparse])
    phase0, phase1 = folded_phase(v[low], g), folded_phase(v[up], g)
    level = float(folded_phase(HALF, g))
    turn = np.where(phase1 == phase0, 1.0, phase1 - phase0)
    counted[sparse] = t[low] + (t[up] - t[low]) * np.clip((level - phase0) / turn, 0.0, 1.0)
    return np.asarray(np.maximum.accumulate(counted))


def neighbours_around(above: Mask, before: Index, after: Index) -> tuple[Index, Index]:
    """The first pair of neighbours on different sides of the level between two samples."""
    low = before.copy()
    for _ in range(_COUNTED):
        same = (above[low + 1] == above[before]) & (low + 1 < after)
        low = np.where(same, low + 1, low)
    return low, low + 1


def centre_means(t: Array, v: Array, found: Excursions) -> tuple[Array, Array]:
    """(K + 1,) means of v (n,) in the middle third of each excursion's time, and (K + 1,) numbers of samples there.

    NaN with 0 samples for the first, the last, and excursions too short to have a middle.
    """
    mean, count = np.full(len(found), np.nan), np.zeros(len(found))
    if len(found) < 3:
        return mean, count
    start, third = found.times[:-1], np.diff(found.times) / 3.0
    low, high = np.searchsorted(t, start + third), np.searchsorted(t, start + 2.0 * third)
    some = np.flatnonzero(high > low)
    if len(some):
        pairs = np.column_stack([low[some], high[some]]).ravel()
        total = np.add.reduceat(v, np.minimum(pairs, len(v) - 1))[::2]
        count[1:-1][some] = high[some] - low[some]
        mean[1:-1][some] = total / (high[some] - low[some])
    return mean, count


def extremes(v: Array, found: Excursions) -> Array:
    """(K + 1,) largest v (n,) of high excursions, smallest of low ones."""
    starts = np.minimum(found.first[:-1], len(v) - 1)
    return np.where(found.high, np.maximum.reduceat(v, starts), np.minimum.reduceat(v, starts))


# -- What makes a count of fringes untrustworthy, and single samples that are no light

_FEWEST = 4  # samples a fringe: the sampling theorem asks for two, noise and changes of speed for more
_LARGE_STEP = 0.12  # of a fringe: smaller steps between samples are no jumps
_GAP = 1.8  # times the usual time between samples


class Fault(Enum):
    """Why a count is not used; the value says it."""

    FAST = "fewer than four samples a fringe, so that fringes may be lost"
    GAP = "samples are missing while the mirror moves, so that fringes may be lost"
    JUMP = "the signal jumps between two samples, so that fringes may be lost"
    TURN = "the signal does not tell whether the mirror passed the end of a fringe or turned there"
    SIDE = "the signal does not tell on which side of the end of a fringe the mirror rests"
    WEAK = "its fringes are too small for its noise"
    LEVELS = "it spans too few fringes to show how large they are"
    UNEVEN = "the motion is too uneven to follow"
    COUNT = "the fringes counted disagree with the wavelength scans before and after"


def too_fast(found: Excursions) -> bool:
    """Whether some fringe has fewer samples than `_FEWEST`."""
    sizes = found.sizes[1:-1]
    pairs = sizes[1:] + sizes[:-1]
    return bool(len(pairs) and pairs.min() < _FEWEST)


def has_gap(t: Array, found: Excursions) -> bool:
    """Whether times t (n,) leave a gap in which the phase may have moved by more than a quarter turn."""
    if len(found) < 3 or len(t) < 3:
        return False
    step = np.diff(t)
    usual = float(np.median(step[:: max(1, len(step) // 100_000)]))
    long = np.flatnonzero(step > _GAP * usual)
    return bool((_fastest_near(found, long) * step[long] > np.pi / 2.0).any())


def has_jump(t: Array, v: Array, noise: float, found: Excursions) -> bool:
    """Whether two neighbouring samples of v (n,), times (n,), differ by more than the speed around them allows."""
    change = np.abs(np.diff(v))
    large = np.flatnonzero(change > _LARGE_STEP + 12.0 * noise)
    if not len(large):
        return False
    # without a crossing nothing moves fast enough for a large step
    near = _fastest_near(found, large) if len(found) > 2 else np.zeros(len(large))
    step = near * (t[large + 1] - t[large])
    slope = float(np.max(1.0 / np.array(found.reach)))  # of the steeper half of a fringe, on average
    return bool((change[large] > 2.5 * step * slope + 12.0 * noise).any())


def _fastest_near(found: Excursions, at: Index) -> Array:
    """Largest phase rate of the excursion that holds each sample and of its two neighbours."""
    speed = np.nan_to_num(found.speeds, nan=0.0)
    padded = np.concatenate([[0.0], speed, [0.0]])
    widest = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    which = np.clip(np.searchsorted(found.first, at, side="right") - 1, 0, len(found) - 1)
    return np.asarray(widest[which])


def without_spikes(signal: Array, noise: float) -> tuple[Array, int]:
    """The signal (n,) with single outlying samples replaced by their neighbours' mean, and how many there were.

    Only where the signal is otherwise calm: a peak of a fast fringe is no spike.
    """
    if len(signal) < 20:
        return signal, 0
    span = float(np.ptp(signal[:: max(1, len(signal) // 100_000)]))
    limit = 12.0 * noise + 0.1 * span
    bend = np.abs(signal[1:-1] - 0.5 * (signal[:-2] + signal[2:]))
    at = np.flatnonzero(bend > limit) + 1
    at = at[(at >= 8) & (at < len(signal) - 8)]
    # the same spike bends the signal at its neighbours too, half as much
    peaks = at[(bend[at - 1] >= bend[at - 2]) & (bend[at - 1] >= bend[at])]
    if not len(peaks) or len(peaks) > len(signal) // 500 + 1:
        return signal, 0
    around = signal[peaks[:, None] + np.array([*range(-8, 0), *range(1, 9)])]
    calm = np.max(np.abs(np.diff(around, axis=1)), axis=1) < 0.3 * limit + 6.0 * noise
    peaks = peaks[calm]
    if not len(peaks):
        return signal, 0
    mended = signal.copy()
    mended[peaks] = 0.5 * (signal[peaks - 1] + signal[peaks + 1])
    return mended, len(peaks)
