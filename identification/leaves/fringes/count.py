"""From the samples of one move to how far the mirror went: fringes counted, phases at rest at both ends.

The phase is walked from end to end of the fringes: every excursion of the signal moves the mirror past one end
of a fringe, or turns it back. Only the two ends of the series need a phase inside a fringe, and there the
mirror rests, so that many samples are averaged. Nothing loops over samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.leaves.fringes.excursions import (
    Excursions,
    Fault,
    find_excursions,
    has_gap,
    has_jump,
    too_fast,
    without_spikes,
)
from truepose.identification.leaves.fringes.levels import (
    Levels,
    Noise,
    Rest,
    fitted_levels,
    noise_of,
    rough_levels,
    tracked_levels,
)
from truepose.identification.leaves.fringes.passages import normalised, passages
from truepose.identification.leaves.fringes.turns import DECISIVE, Verdict
from truepose.models.machine.fabry_perot import Reflectivities, coupling, folded_phase, phase_noise

_WEAK = 0.06  # noise of a sample, in fringes, beyond which nothing is read
_ROUGH = (0.05, 0.02)  # of a fringe: 1-sigma of levels from the range of the signal, and corrected once
_FEW = 0.001  # of a fringe: levels from few passages are no better
_TRACKED = 24  # excursions from which on levels that drift are followed
_TRACKED_BY, _AGAIN = 0.1, 0.05  # of a fringe: changes of levels after which crossings are sought again
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
    faults: tuple[Fault, ...]

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
    signal, spikes = without_spikes(signal, noise.sigma)
    rough = rough_levels(signal)
    seen = rough.size > 0.0 and noise.sigma <= _WEAK * rough.size
    own = own_levels(t, signal, rough, g, noise) if seen else None
    used = own or levels or rough
    if noise.sigma > _WEAK * used.size or not used.size > 0.0 or not (seen or levels):
        nothing = End(False, 0.0, np.inf, 0.0)
        return Count(0.0, nothing, nothing, 0, used, np.inf, spikes, (Fault.WEAK,))
    series = normalised(t, signal, used, noise, g)
    found, faults = series.found, [] if own or levels else [Fault.LEVELS]
    tests = {
        Fault.FAST: too_fast(found),
        Fault.GAP: has_gap(t, found),
        Fault.JUMP: has_jump(t, series.v, series.noise.sigma, found),
    }
    faults += [fault for fault, raised in tests.items() if raised]
    judged = passages(series)
    odds = np.full(len(found), np.inf) if judged is None else judged[0]
    faults += [Fault.UNEVEN] if judged is None else []
    start, stop = (_end(found, series.rests[k], odds, -k, used, g) for k in (0, 1))
    faults += [Fault.TURN] if (np.abs(odds[1:-1]) < DECISIVE).any() else []
    faults += [Fault.SIDE] if max(start.doubt, stop.doubt) > _NEAR else []
    walked, direction = _walk(odds > 0.0)
    if direction < 0.0 or (len(found) == 1 and odds[0] < 0.0):
        stop = stop.mirrored
    turns = int((odds[1:-1] < 0.0).sum())
    return Count(walked, start.mirrored, stop, turns, used, series.noise.sigma, spikes, tuple(faults))


def own_levels(t: Array, signal: Array, rough: Levels, g: float, noise: Noise) -> Levels | None:
    """Levels that a series of times and samples (n,) itself shows; None when it spans too few fringes."""
    levels = rough
    found = find_excursions(t, levels.normalise(t, signal), noise.sigma / levels.size, g)
    if len(found) > _TRACKED:
        tracked = tracked_levels(signal, levels, found)
        if tracked.differs(levels, _TRACKED_BY):
            levels = tracked
            found = find_excursions(t, levels.normalise(t, signal), noise.sigma / levels.size, g)
    for _ in range(2):
        fitted = fitted_levels(t, signal, found, g, noise.sigma, levels.size)
        if fitted is None:
            return _levels_of_few(t, signal, rough, g, noise)
        near, levels = not fitted.differs(levels, _AGAIN), fitted
        if near:
            break
        found = find_excursions(t, levels.normalise(t, signal), noise.sigma / levels.size, g)
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


def _end(found: Excursions, rest: Rest, odds: Array, k: int, levels: Levels, g: float) -> End:
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
