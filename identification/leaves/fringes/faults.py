"""What makes a count of fringes untrustworthy, and single samples that are no light."""

from __future__ import annotations

from enum import Enum

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.leaves.fringes.excursions import Excursions

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
    return bool((change[large] > 2.5 * step * np.max(_slopes(found)) + 12.0 * noise).any())


def _slopes(found: Excursions) -> Array:
    """Mean slope dv / d phase of the halves of a fringe, a measure of its steepest."""
    return 0.5 / np.array(found.reach) * 2.0


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
