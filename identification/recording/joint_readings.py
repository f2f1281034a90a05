"""A joint's column of a file: its unit, an encoder's counts among them, and its readings in the joint's range.

Readings that come modulo a turn, 0 to 360 or -180 to 180 degrees, unfolded to where the joint was.

A joint that stands at -10 degrees and is logged as 350 seems to have turned by a whole turn: a gain, play or drag would be
taken for something else. A joint with a range of a turn or less stands in its range. For any other:

* It goes the shorter way from row to row, if that is always shorter than a quarter of a turn. As a whole the path stands in the
  joint's range and, where that leaves a choice, about its home, or from home on where that needs no jump.
* Where steps are longer, a joint that turns freely stands from home on, if that is clearly the shorter arc, else about home.
  Another joint stands where its range leaves one place for each row.

That depends on readings modulo a turn only, so that both ways of logging are read the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.recording.recording import Recording, frozen
from truepose.identification.recording.table import Table
from truepose.models.file.limits import LARGEST
from truepose.models.machine.closure import home_readings
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator, turns_freely
from truepose.models.units import COUNT_WORDS, UnitSystem, convert

Limits: TypeAlias = tuple[float, float]
TURN = 2.0 * np.pi
WHOLE_ARC = 0.9
"""Share of the arc about home below which the arc from home on is the one that was travelled."""
STEADY = 0.25
"""Largest step, in turns, of joints that are logged on their way."""
SLACK: Final = 0.05
"""Share of a range's width that readings may be beyond it: commands overshoot a little."""
_ROUNDING = 1e-9
_STATED = 1e-6
_ANYWHERE = (-np.inf, np.inf)


def unfold_readings(machine: Machine, recording: Recording) -> Recording:
    """Return the recording with readings that come modulo a turn unfolded, and a note, where no range says where they are.

    ``wrap`` in the machine file says so, or readings do: from 0 to 360 degrees, or with jumps of nearly a turn. Raises
    InputError where a stated ``wrap`` leaves a row several places in the joint's range, or none.
    """
    q, told = recording.q.copy(), list[str]()
    homes, steps = home_readings(machine.mechanism), _neighbours(recording)
    for actuator, home in zip(machine.mechanism.actuators, homes.tolist(), strict=True):
        free = turns_freely(machine.mechanism, actuator.reading)
        period = actuator.wrap or (TURN if free else np.inf)
        if np.isinf(period) or not leaves_range_open(actuator.reading_range, period):
            continue
        column = recording.joints.index(actuator.reading)
        limits, free = actuator.reading_range or _ANYWHERE, free and is_whole_turns(period)
        found = _unfolded(q[:, column], home, period, limits, recording, free=free)
        if actuator.wrap is None:
            if not _wraps(q[:, column], period, found, steps, ranged=actuator.reading_range is not None):
                continue
        elif not np.isfinite(found).all() or beyond(found, limits).any():
            raise _lost(machine, recording, actuator)
        if np.max(np.abs(found - q[:, column]), initial=0.0) > 0.5 * period:
            unit = machine.column_unit(actuator.reading)
            ends = (convert(float(end), actuator.reading_unit, unit) for end in (found.min(), found.max()))
            told.append(f"{actuator.reading} ({' to '.join(f'{end:.6g}' for end in ends)} {unit})")
            q[:, column] = found
    if not told:
        return recording
    note = f"readings that wrap are unfolded: {', '.join(told)}; state a `range` for a joint that turns otherwise"
    return replace(recording, q=frozen(q), notes=(*recording.notes, note))


def is_whole_turns(period: float) -> bool:
    """Return True if a period is whole turns, to the digits that files state."""
    return period > TURN / 2 and abs(period / TURN - round(period / TURN)) < _STATED


def leaves_range_open(limits: Limits | None, period: float) -> bool:
    """Return True if readings modulo ``period`` may have several places in the joint's range."""
    return limits is None or bool(np.ptp(limits) > period * (1.0 + _ROUNDING))


def beyond(readings: Array, limits: Limits, share: float = SLACK) -> Mask:
    """Return which readings (n,) are out of a range by more than a share of its width: commands overshoot a little."""
    slack = share * (limits[1] - limits[0]) if np.isfinite(limits).all() else 0.0
    return np.asarray((readings < limits[0] - slack) | (readings > limits[1] + slack))


def fold(readings: Array, period: float, middle: float) -> Array:
    """Return readings (n,) brought by whole periods to within half a period of ``middle``, above its lower end."""
    return np.asarray(readings - period * np.ceil((readings - middle) / period - 0.5 - _ROUNDING))


def _unfolded(
    q: Array, home: float, period: float, limits: Limits, recording: Recording, *, free: bool
) -> Array:
    """Return readings (n,) where the joint was, NaN where nothing tells; ``free``: a period leaves the machine where it is."""
    about, onward = fold(q, period, home), fold(q, period, home + period / 2)
    steps = _neighbours(recording)

    def steady(values: Array) -> bool:
        return bool(steps.size) and bool(np.all(np.abs(np.diff(values[steps], axis=0)) < STEADY * period))

    through = np.empty_like(about)
    through[recording.order] = np.unwrap(about[recording.order], period=period)
    if steady(through):
        for arc in (about, onward):
            if steady(arc) and not beyond(arc, limits, 0.0).any():
                return arc
        through -= period * np.ceil(((through.max() + through.min()) / 2 - home) / period - 0.5 - _ROUNDING)
        for rows in (slice(None), *(recording.session == one for one in np.unique(recording.session))):
            through[rows] += _shift_into(limits, through[rows].min(), through[rows].max(), period)
        if not (free and beyond(through, limits).any()):
            return through
    nearest = onward if np.ptp(onward) < WHOLE_ARC * np.ptp(about) else about
    placed = np.asarray(nearest + _shift_into(limits, nearest, nearest, period))
    several = (placed + period <= limits[1]) | (placed - period >= limits[0])
    unknown = np.isfinite(limits).all() and not free and several.any()
    return np.full_like(placed, np.nan) if unknown else placed


def _shift_into(limits: Limits, lowest: Array | float, highest: Array | float, period: float) -> Array:
    """Return the least shift by whole periods of arcs that takes them into a range, or nearest to it."""
    least = np.ceil((limits[0] - np.asarray(lowest)) / period - _ROUNDING)
    most = np.floor((limits[1] - np.asarray(highest)) / period + _ROUNDING)
    between = np.round((least + most) / 2) if np.isfinite(limits).all() else 0.0
    return np.asarray(period * np.where(least <= most, np.clip(0.0, least, most), between))


def _lost(machine: Machine, recording: Recording, actuator: Actuator) -> InputError:
    """Return the error of a joint whose readings may have several places in its range, or have none."""
    period, steps = actuator.wrap or np.inf, _neighbours(recording)
    q = recording.q[:, recording.joints.index(actuator.reading)]
    apart = np.abs(fold(np.diff(q[steps], axis=0)[0], period, 0.0))
    unit = machine.column_unit(actuator.reading)
    sizes = (period, STEADY * period, apart.max(initial=0.0))
    turn, steady, step = (f"{abs(convert(float(v), actuator.reading_unit, unit)):.6g} {unit}" for v in sizes)
    ends = sorted(convert(float(v), actuator.reading_unit, unit) for v in actuator.reading_range or ())
    where = f"its range [{', '.join(f'{end:.6g}' for end in ends)}] {unit}"
    if not len(apart):
        found = "rows in no order"
    elif apart.max() < STEADY * period:
        found = "a path that does not fit into it"
    else:
        found = f"a step of {step} up to row {recording.source_row[steps[1, apart.argmax()]]}"
    return InputError(
        f"{recording.files[0]}: column {actuator.reading!r}: readings modulo {turn} do not tell where in {where} the joint is: "
        f"found {found}, expected steps below {steady}, or a range of at most {turn}"
    )


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


__all__ = ["SLACK", "TURN", "beyond", "fold", "is_whole_turns", "leaves_range_open", "unfold_readings"]


@dataclass(frozen=True)
class JointColumn:
    """A joint's column: `unit` "mm" or "rad" (readings are converted to it), or another such as "turn"
    (kept as recorded); `range` in that unit, None for any value.

    written: the unit of the column unless its header names one, that of the machine file where it is empty; counted: it holds
    an encoder's counts. wrap: what readings are stated to come modulo, without a unit if plain_wrap; turn: what makes no
    difference to the machine.
    """

    name: str
    unit: str
    range: tuple[float, float] | None = None
    written: str = ""
    counted: bool = False
    wrap: float | None = None
    plain_wrap: bool = False
    turn: float | None = None

    def written_in(self, units: UnitSystem) -> str:
        """Return the unit of the column where its header names none."""
        return self.written or units.of_joint(self.unit)


def joint_readings(table: Table, joint: JointColumn, unit: str) -> Array:
    """Return the readings (n,) of a joint in its unit, in its range. Raises InputError for those that are not.

    A range that is wider than what readings come modulo holds only for readings that are unfolded (``unfold_readings``).
    """
    recorded = table.numbers(joint.name)
    readings = sized(table, joint.name, convert(recorded, unit, joint.unit), recorded)
    if joint.range is None or (joint.wrap and leaves_range_open(joint.range, joint.wrap)):
        return readings
    readings = _folded(readings, joint, joint.range)
    ends = (convert(end, joint.unit, unit) for end in joint.range)
    expected = f"a value in the joint's range [{', '.join(f'{end:.6g}' for end in ends)}] {unit}"
    table.refuse(
        joint.name, beyond(readings, joint.range), lambda row: f"{recorded[row]:.6g} {unit}", expected
    )
    return readings


def _folded(readings: Array, joint: JointColumn, limits: tuple[float, float]) -> Array:
    """Readings (n,) brought into a range of a turn or less, where they are stated or seen to come modulo a turn."""
    period = joint.wrap or joint.turn
    if period is None or leaves_range_open(limits, period):
        return readings
    folded = fold(readings, period, sum(limits) / 2)
    logged = np.all((readings >= 0.0) & (readings <= period)) and not beyond(folded, limits).any()
    outside = bool(beyond(readings, limits).any())
    return folded if joint.wrap or (outside and logged) else readings


def turned_notes(
    table: Table, joints: Sequence[JointColumn], q: Mapping[str, Array], said: Mapping[str, str]
) -> list[str]:
    """A note on joints whose readings were brought into their ranges."""
    recorded = {j.name: convert(table.numbers(j.name), said[j.name], j.unit) for j in joints}
    moved = [n for n, values in q.items() if np.any(np.abs(values - recorded[n]) > 1e-6 * np.ptp(values))]
    what = "are brought into the joint's range by whole turns"
    return [f"{table.file}: {', '.join(moved)}: readings {what}"] if moved else []


def column_unit(table: Table, joint: JointColumn, units: UnitSystem) -> str:
    """Return the unit that a joint's column is in.

    Raises InputError for counts where the machine file states none, and for a unit that a plain ``wrap`` may not be meant in.
    """
    stated = table.stated_units[joint.name]
    if isinstance(stated, str) and stated.lower() in COUNT_WORDS:
        if joint.counted:
            return joint.written
        raise InputError(
            f"{table.where(joint.name)}: found the unit {stated!r}, an encoder's counts, expected `counts: N` (N a turn, or a "
            f"mm) of joint {joint.name!r} in the machine file"
        )
    written = joint.written_in(units)
    unit = table.unit(joint.name, written, joint.unit)
    if joint.wrap and joint.plain_wrap and unit != written and not is_whole_turns(joint.wrap):
        number = f"{convert(joint.wrap, joint.unit, written):.9g}"
        raise InputError(
            f"{table.where(joint.name)}: found a column in {unit} and `wrap: {number}` without a unit, expected its unit in "
            f"the machine file, such as `wrap: {number} {unit}`"
        )
    return unit


def sized(
    table: Table, name: str, values: Array, recorded: Array | None = None, largest: float = LARGEST
) -> Array:
    """The values of a column, none of them so large that no instrument reads it; in messages as they are ``recorded``."""
    shown = values if recorded is None else recorded
    expected = f"at most {largest:g} by size in the program's units"
    table.refuse(name, np.abs(values) > largest, lambda row: f"{shown[row]:g}", expected)
    return values
