"""A joint's column of a file: its unit, an encoder's counts among them, and its readings in the joint's range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.recording.angle_range import beyond, fold, is_whole_turns, leaves_range_open
from truepose.identification.recording.table import Table
from truepose.models.file.limits import LARGEST
from truepose.models.units import COUNT_WORDS, UnitSystem, convert


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
