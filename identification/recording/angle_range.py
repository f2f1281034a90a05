"""Readings that come modulo a turn, 0 to 360 or -180 to 180 degrees, unfolded to where the joint was.

A joint that stands at -10 degrees and is logged as 350 seems to have turned by a whole turn: a gain, play or drag would be
taken for something else. A joint with a range of a turn or less stands in its range. Any other stands, in
this order: about its home where no step is then a quarter of a turn or more; from home on, likewise; where it came from by
the shorter way, if that is always shorter than a quarter; from home on if that is clearly the shorter arc; else about its home.
That depends on readings modulo a turn only, so that both ways of logging are read the same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array
from truepose.identification.recording.recording import Recording, frozen
from truepose.models.couplings import turns_freely
from truepose.models.home import home_readings
from truepose.models.machine import Machine
from truepose.models.units import convert

TURN = 2.0 * np.pi
WHOLE_ARC = 0.9
"""Share of the arc about home below which the arc from home on is the one that was travelled."""
STEADY = 0.25
"""Largest step, in turns, of joints that are logged on their way."""
_ROUNDING = 1e-9


def unfold_readings(machine: Machine, recording: Recording) -> Recording:
    """Return the recording with readings that come modulo a turn unfolded, and a note, where no range says where they are.

    ``wrap`` in the machine file says so, or readings do: from 0 to 360 degrees, or with jumps of nearly a turn.
    """
    q, told = recording.q.copy(), list[str]()
    homes, steps = home_readings(machine.mechanism), _neighbours(recording)
    for actuator, home in zip(machine.mechanism.actuators, homes.tolist(), strict=True):
        period = actuator.wrap or (TURN if turns_freely(machine.mechanism, actuator.reading) else np.inf)
        if np.isinf(period) or (
            actuator.reading_range and np.ptp(actuator.reading_range) <= period * (1.0 + _ROUNDING)
        ):
            continue
        column = recording.joints.index(actuator.reading)
        low, high = actuator.reading_range or (-np.inf, np.inf)
        found = (
            _unfolded(q[:, column] - home, period, (low - home, high - home), recording.order, steps) + home
        )
        stated = actuator.wrap is not None
        if not (
            stated or _wraps(q[:, column], period, found, steps, ranged=actuator.reading_range is not None)
        ):
            continue
        if np.max(np.abs(found - q[:, column]), initial=0.0) > 0.5 * period:
            unit = machine.column_unit(actuator.reading)
            ends = (convert(float(end), actuator.reading_unit, unit) for end in (found.min(), found.max()))
            told.append(f"{actuator.reading} ({' to '.join(f'{end:.6g}' for end in ends)} {unit})")
            q[:, column] = found
    if not told:
        return recording
    note = f"readings that wrap are unfolded: {', '.join(told)}; state a `range` for a joint that turns otherwise"
    return replace(recording, q=frozen(q), notes=(*recording.notes, note))


def fold(readings: Array, period: float, middle: float) -> Array:
    """Return readings (n,) brought by whole periods to within half a period of ``middle``, above its lower end."""
    return np.asarray(readings - period * np.ceil((readings - middle) / period - 0.5 - _ROUNDING))


def _unfolded(
    way: Array, period: float, limits: tuple[float, float], order: NDArray[np.int64], steps: NDArray[np.int64]
) -> Array:
    """Return readings (n,) from home where the joint was; ``steps`` (2, k) are rows that follow each other."""
    about, onward = fold(way, period, 0.0), fold(way, period, period / 2)

    def steady(values: Array) -> bool:
        return bool(len(steps.T)) and bool(np.all(np.abs(np.diff(values[steps], axis=0)) < STEADY * period))

    through = np.empty_like(about)
    through[order] = np.unwrap(about[order], period=period)
    for whole in (about, onward):
        if steady(whole):
            return whole
    if steady(through):
        middle = (through.max() + through.min()) / 2
        through -= period * np.ceil(middle / period - 0.5 - _ROUNDING)
        if limits[0] <= through.min() and through.max() <= limits[1]:
            return through
    return onward if np.ptp(onward) < WHOLE_ARC * np.ptp(about) else about


def _wraps(readings: Array, period: float, found: Array, steps: NDArray[np.int64], *, ranged: bool) -> bool:
    """Whether readings show that they come modulo a period: they fill 0 to 360 degrees, or jump where the joint did not."""
    if not len(readings):
        return False
    before, after = (np.abs(np.diff(values[steps], axis=0)) for values in (readings, found))
    jumps = bool(np.any(before > (1.0 - STEADY) * period)) and bool(np.all(after < STEADY * period))
    return jumps or (not ranged and readings.min() >= 0.0 and 0.5 * period < readings.max() <= period)


def _neighbours(recording: Recording) -> NDArray[np.int64]:
    """Return the rows (2, k) that follow each other in one session; none where rows are declared shuffled."""
    if recording.shuffled:
        return np.zeros((2, 0), dtype=np.int64)
    pairs = np.array([recording.order[:-1], recording.order[1:]])
    return np.asarray(pairs[:, recording.session[pairs[0]] == recording.session[pairs[1]]])


__all__ = ["TURN", "fold", "unfold_readings"]
