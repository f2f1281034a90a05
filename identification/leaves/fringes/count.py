"""From the samples of one move to how far the mirror went: fringes counted, phases at rest at both ends.

The phase is walked from end to end of the fringes: every excursion of the signal moves the mirror past one end
of a fringe, or turns it back. Only the two ends of the series need a phase inside a fringe, and there the
mirror rests, so that many samples are averaged. Nothing loops over samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.leaves.fringes import excursions
from truepose.identification.leaves.fringes.levels import Levels, Noise, fitted_levels, noise_of, rough_levels
from truepose.identification.leaves.fringes.resting_level import Rest, find_rest
from truepose.identification.leaves.fringes.turns import DECISIVE, Held, Light, Verdict, judge
from truepose.models.sensors.irradiance import Reflectivities, coupling, folded_phase, fringe, phase_noise

# -- Which excursions passed the end of their fringe: most at a glance, all at once; the others one by one

MOST_JUDGED = 1000
"""Excursions that are worth judging one by one: a motion with more is too uneven to follow."""
_SLOWER = 1.4
_LEVEL = 0.01  # of a fringe
_LATE = 0.015  # of an excursion's duration
_CROSSING = 0.05  # of an excursion's samples tell when it began
_REST = 0.03  # rad: a polynomial follows the beginning of a motion so well
_POINTS = 160  # groups of samples that a judgement takes
_FLOOR = 0.0015  # of a fringe: motions are not polynomials
_AROUND = 2  # excursions on either side of one that is judged
_SLACK = 0.001  # of a fringe: levels may differ so much from place to place


@dataclass(frozen=True)
class Series:
    """A normalised signal as excursions: t and v (n,), its noise, the 1-sigma of the levels, the rests."""

    t: Array
    v: Array
    noise: Noise
    slack: float
    g: float
    found: excursions.Excursions
    rests: tuple[Rest, Rest]


def normalised(t: Array, signal: Array, levels: Levels, noise: Noise, g: float, slack: float = 0.0) -> Series:
    """A signal (n,) at times (n,) as its excursions and rests; ``noise`` is in the signal's unit.

    ``slack``: 1-sigma of the levels (in parts of a fringe), where it is more than their own.
    """
    v, relative = levels.normalise(t, signal), noise.over(levels.size)
    found = excursions.find_excursions(t, v, relative.sigma, g)
    rests = find_rest(v, relative), find_rest(v[::-1], relative)
    return Series(t, v, relative, max(levels.sigma, slack, _SLACK), g, found, rests)


def passages(series: Series, *, everyone: bool = False) -> tuple[Array, list[tuple[int, Verdict]]] | None:
    """Return (K + 1,) how sure each excursion passed (positive) or turned (negative), and the verdicts so far made.

    The measure is chi2 of turning less chi2 of passing, infinite where the passage is plain. None when too many
    excursions would need judging; ``everyone`` is judged on request.
    """
    out = np.full(len(series.found), np.inf)
    if len(series.found) == 1 and sum(rest.samples for rest in series.rests) >= len(series.t):
        return np.array([-np.inf]), []  # the mirror rests all the time
    even = evenly(series)
    doubtful = np.flatnonzero(~(even & in_time(series, even)) | everyone)
    if len(doubtful) > MOST_JUDGED:
        return None
    verdicts = [(int(k), judge(light_of(series, int(k), even))) for k in doubtful]
    for k, verdict in verdicts:
        out[k] = verdict.odds
    return out, verdicts


def light_of(series: Series, k: int, even: Mask) -> Light:
    """Return the samples around excursion k, and where they lie from the end of the fringe that it visits."""
    found, last = series.found, len(series.found) - 1
    rows, high = window_of(series, k, even), bool(found.high[k])
    edges = (
        held_rest(series, series.rests[0], high) if k == 0 else None,
        held_rest(series, series.rests[1], high) if k == last else None,
    )
    t = series.t[rows]
    groups = np.linspace(0, len(t), min(_POINTS, len(t)) + 1).astype(int)
    sizes = np.diff(groups)
    time, mean = (np.add.reduceat(values, groups[:-1]) / sizes for values in (t, series.v[rows]))
    sigma = np.sqrt(series.noise.sigma**2 / sizes + series.noise.stuck**2 + _FLOOR**2)
    # half fringes to the end that is next to each group's middle, and the phase from there
    at = t[groups[:-1] + sizes // 2]
    which = np.searchsorted(found.times, at, side="right")
    bounds = np.concatenate([[-np.inf], found.times, [np.inf]])
    with np.errstate(invalid="ignore"):
        middle = 0.5 * (bounds[which] + bounds[which + 1])
    beyond = (which == k) | ((at > middle) == (which > k))
    phase = folded_phase(mean, series.g)
    local = np.where(found.high[which], np.pi - phase, phase)
    distance = np.pi * np.abs(which - k) + np.where(beyond, local, -local)
    u = 2.0 * (time - t[0]) / max(float(t[-1] - t[0]), 1e-300) - 1.0
    return Light(u, mean, sigma, distance, high, series.g, series.slack, edges)


def held_rest(series: Series, rest: Rest, high: bool) -> Held:
    """A rest by its distance from the end of its fringe."""
    phase = float(folded_phase(rest.level, series.g))
    sigma = float(phase_noise(rest.level, np.hypot(rest.sigma, series.slack), series.g))
    return Held(np.pi - phase if high else phase, max(sigma, _REST), rest.still)


def evenly(series: Series) -> Mask:
    """(K + 1,) excursions that passed for certain: not slower than their neighbours, and up to the end.

    A mirror that turns at the end of a fringe with steady acceleration needs at least 2.5 times as long as its
    neighbours; one that turns earlier misses the end.
    """
    t, v, noise, found, g = series.t, series.v, series.noise.sigma, series.found, series.g
    even = np.zeros(len(found), dtype=bool)
    if len(found) < 4:
        return even
    speed = found.speeds
    slower = np.fmin(speed[:-2], speed[2:])
    even[1:-1] = np.nan_to_num(speed[1:-1] * _SLOWER / slower, nan=0.0) >= 1.0
    off, count = excursions.centre_means(t, v, found)
    for kind in (True, False):  # most pass evenly; levels that are a little off move all centres alike
        same = (found.high == kind) & np.isfinite(off)
        if same.any():
            off[same] -= np.median(off[same])
    long = count >= 3
    with np.errstate(invalid="ignore", divide="ignore"):
        even &= ~long | (np.abs(off) <= _LEVEL + 5.0 * noise / np.sqrt(count))
    return even & reaches_end(v, noise, found, g)


def in_time(series: Series, even: Mask) -> Mask:
    """(K + 1,) whether each takes as long as its neighbours let expect, where these passed evenly.

    A mirror that turns suddenly before an end of a fringe, or beyond it, is back too early, or too late. Of
    neighbours out of time only the worst is: it makes the others look so.
    """
    found = series.found
    out = np.ones(len(found), dtype=bool)
    if len(found) < 5:
        return out
    rate = np.log(found.speeds[1:-1])
    off = np.zeros(len(found))
    off[2:-2] = np.abs(rate[1:-1] - 0.5 * (rate[:-2] + rate[2:]))
    off[1:-1][~(even[:-2] & even[2:])] = 0.0
    # the samples near a crossing give its phase
    dense = np.maximum(1.0, _CROSSING * found.sizes)
    limit = _LATE + 4.0 * 2.0 * series.noise.sigma / np.sqrt(dense) / found.half_width
    worst = np.ones(len(found), dtype=bool)
    worst[1:] &= off[1:] >= off[:-1]
    worst[:-1] &= off[:-1] >= off[1:]
    out[(off > limit) & worst] = False
    return out


def reaches_end(v: Array, noise: float, found: excursions.Excursions, g: float) -> Mask:
    """(K + 1,) whether the largest sample is as near to the end of the fringe as sampling lets it be."""
    step = np.nan_to_num(found.speeds * found.durations / np.maximum(found.sizes, 1), nan=0.0)
    off = np.minimum(0.6 * step, found.half_width)
    nearest = fringe(np.where(found.high, -np.cos(off), np.cos(off)), g)
    sign = np.where(found.high, 1.0, -1.0)
    margin = 0.04 + 4.0 * noise
    return np.asarray(sign * (excursions.extremes(v, found) - nearest) >= -margin)


def window_of(series: Series, k: int, even: Mask) -> slice:
    """Samples around excursion k: the next ones on both sides that passed for certain, else half of the next.

    At the ends of the series without the rests, and no further than the end of the next fringe.
    """
    t, found, rests = series.t, series.found, series.rests
    last = len(found) - 1
    own = float(np.nan_to_num(found.durations[k], nan=np.inf))
    most = _AROUND if 0 < k < last else 0
    low, high = rests[0].samples - 1, len(t) - rests[1].samples + 1
    if k > 0:
        plain = _plain(even[:k][::-1], most)
        start = found.times[k - 1 - plain] if plain else _half(found, k - 1, k - 1, -1.0, own)
        low = max(low, int(np.searchsorted(t, start)))
    if k < last:
        plain = _plain(even[k + 1 :], most)
        stop = found.times[k + plain] if plain else _half(found, k, k + 1, 1.0, own)
        high = min(high, int(np.searchsorted(t, stop)))
    return slice(low, max(high, low + 1))


def _plain(even: Mask, most: int) -> int:
    """How many excursions in a row, at most so many, passed for certain."""
    return int(np.cumprod(even[:most]).sum())


def _half(found: excursions.Excursions, crossing: int, k: int, sign: float, own: float) -> float:
    """Time in the middle of excursion k, a neighbour of one that takes ``own``; half of that where k is cut."""
    length = float(found.durations[k])
    return float(found.times[crossing]) + sign * 0.5 * (own if np.isnan(length) else length)


# -- From the samples of one move to how far the mirror went: fringes counted, phases at rest at both ends

_WEAK = 0.06  # noise of a sample, in fringes, beyond which nothing is read
_ROUGH = (0.05, 0.02)  # of a fringe: 1-sigma of levels from the range of the signal, and corrected once
_FEW = 0.001  # of a fringe: levels from few passages are no better
_AGAIN = 0.05  # of a fringe: changes of levels after which crossings are sought again
_NEAR = 0.4  # rad: nearer to the end of a fringe, the side of it is an error and no miscount


@dataclass(frozen=True)
class End:
    """Where the mirror rests: ``offset`` (rad, in walking direction) from the ``high`` or low end of a fringe.

    ``doubt``: the part of ``sigma`` that comes from not knowing on which side of that end it rests.
    """

    high: bool
    offset: float
    sigma: float
    doubt: float

    @property
    def mirrored(self) -> End:
        """The same for the other walking direction."""
        return replace(self, offset=-self.offset)


@dataclass(frozen=True)
class Count:
    """A move in phase of the round trip (rad); positive is the direction in which the move began.

    ``walked``: from the end of a fringe nearest to the start to the one nearest to the stop, a multiple of pi;
    ``turns``: turning points seen; ``levels`` and ``noise`` (of a sample, in fringes): how the signal was
    read; ``spikes``: samples replaced; ``faults``: why the count is not to be used, if so.
    """

    walked: float
    start: End
    stop: End
    turns: int
    levels: Levels
    noise: float
    spikes: int
    faults: tuple[excursions.Fault, ...]

    @property
    def phase(self) -> float:
        """By how much the round trip's phase changed, rad."""
        return self.walked + self.stop.offset - self.start.offset

    @property
    def sigma(self) -> float:
        """1-sigma of ``phase``, miscounts apart, rad."""
        return float(np.hypot(self.start.sigma, self.stop.sigma))


def count_fringes(
    t: Array, signal: Array, reflectivities: Reflectivities, levels: Levels | None = None
) -> Count:
    """Count one series: increasing times (n,) and samples (n,), both in any unit.

    ``levels`` serve where the move spans too few fringes to show its own. A signal that cannot be counted
    raises nothing: ``faults`` says why.
    """
    g = coupling(reflectivities)
    noise = noise_of(signal)
    signal, spikes = excursions.without_spikes(signal, noise.sigma)
    rough = rough_levels(signal)
    seen = rough.size > 0.0 and noise.sigma <= _WEAK * rough.size
    own = own_levels(t, signal, rough, g, noise) if seen else None
    used = own or levels or rough
    if noise.sigma > _WEAK * used.size or not used.size > 0.0 or not (seen or levels):
        nothing = End(False, 0.0, np.inf, 0.0)
        return Count(0.0, nothing, nothing, 0, used, np.inf, spikes, (excursions.Fault.WEAK,))
    series = normalised(t, signal, used, noise, g)
    found, faults = series.found, [] if own or levels else [excursions.Fault.LEVELS]
    tests = {
        excursions.Fault.FAST: excursions.too_fast(found),
        excursions.Fault.GAP: excursions.has_gap(t, found),
        excursions.Fault.JUMP: excursions.has_jump(t, series.v, series.noise.sigma, found),
    }
    faults += [fault for fault, raised in tests.items() if raised]
    judged = passages(series)
    odds = np.full(len(found), np.inf) if judged is None else judged[0]
    faults += [excursions.Fault.UNEVEN] if judged is None else []
    start, stop = (_end(found, series.rests[k], odds, -k, used, g) for k in (0, 1))
    faults += [excursions.Fault.TURN] if (np.abs(odds[1:-1]) < DECISIVE).any() else []
    faults += [excursions.Fault.SIDE] if max(start.doubt, stop.doubt) > _NEAR else []
    walked, direction = _walk(odds > 0.0)
    if direction < 0.0 or (len(found) == 1 and odds[0] < 0.0):
        stop = stop.mirrored
    turns = int((odds[1:-1] < 0.0).sum())
    return Count(walked, start.mirrored, stop, turns, used, series.noise.sigma, spikes, tuple(faults))


def own_levels(t: Array, signal: Array, rough: Levels, g: float, noise: Noise) -> Levels | None:
    """Levels that a series of times and samples (n,) itself shows; None when it spans too few fringes."""
    levels = rough
    found = excursions.find_excursions(t, levels.normalise(t, signal), noise.sigma / levels.size, g)
    for _ in range(2):
        fitted = fitted_levels(t, signal, found, g, noise.sigma, levels.size)
        if fitted is None:
            return _levels_of_few(t, signal, rough, g, noise)
        near, levels = not fitted.differs(levels, _AGAIN), fitted
        if near:
            break
        found = excursions.find_excursions(t, levels.normalise(t, signal), noise.sigma / levels.size, g)
    return levels


def _levels_of_few(t: Array, signal: Array, rough: Levels, g: float, noise: Noise) -> Levels | None:
    """Levels from passages judged one by one; None unless the mirror passed both ends of a fringe."""
    levels = rough
    for slack in _ROUGH:
        series = normalised(t, signal, levels, noise, g, slack)
        judged = passages(series, everyone=True)
        if judged is None:
            return None
        passed = [(k, verdict) for k, verdict in judged[1] if verdict.passed]
        if len({bool(series.found.high[k]) for k, _ in passed}) < 2:
            return None
        low, high = (
            _mean([verdict for k, verdict in passed if bool(series.found.high[k]) is kind])
            for kind in (False, True)
        )
        levels = levels.corrected(low[0], high[0], float(np.hypot(max(low[1], high[1]), _FEW)))
    return levels


def _mean(verdicts: list[Verdict]) -> tuple[float, float]:
    """Weighted mean of the levels that visits to one end of the fringe found, and its 1-sigma."""
    weights = np.array([1.0 / verdict.sigma**2 for verdict in verdicts])
    mean = np.average([verdict.level for verdict in verdicts], weights=weights)
    return float(mean), float(1.0 / np.sqrt(weights.sum()))


def _walk(passed: Mask) -> tuple[float, float]:
    """Phase from the first end of a fringe to the last one, rad, and the direction at the last one."""
    direction = np.concatenate([[1.0], np.cumprod(np.where(passed[1:-1], 1.0, -1.0))])
    # an excursion that turned is left in the direction it came from
    return float(np.pi * direction[: len(passed) - 1].sum()), float(direction[-1])


def _end(found: excursions.Excursions, rest: Rest, odds: Array, k: int, levels: Levels, g: float) -> End:
    """The rest at one side of the series, counted as beyond the end of its fringe where it passed.

    The nearer to that end, the less the signal tells on which side; then the mean of both is taken.
    """
    high = bool(found.high[k])
    sigma = float(np.hypot(rest.sigma, levels.sigma))
    phase = float(folded_phase(rest.level, g))
    distance = np.pi - phase if high else phase
    side = float(np.tanh(np.clip(odds[k], -1e3, 1e3) / 8.0))  # 4 instead of 2 in exp(-chi2 / 2): cautious
    doubt = distance * float(np.sqrt(1.0 - side**2))
    spread = float(phase_noise(rest.level, sigma, g))
    return End(high, side * distance, float(np.hypot(spread, doubt)), doubt)
