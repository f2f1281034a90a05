"""A signal as excursions above and below half of its fringe, and how fast the mirror went through each.

The half level divides a fringe into a part around its low end (resonance) and one around its high end. What
lies between two crossings of that level is an excursion: it goes to one end of the fringe, and the mirror
either passes there or turns around (`truepose.identification.leaves.fringes.turns`). Everything here is O(n).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.models.sensors.irradiance import folded_phase

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
