"""A joint's column of a file: its unit, an encoder's counts among them, and its readings in the joint's range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.identification.recording.angle_range import fold
from truepose.identification.recording.table import Table
from truepose.models.limits import LARGEST
from truepose.models.units import COUNT_WORDS, UnitSystem, convert

SLACK: Final = 0.05
"""Share of a range's width that readings may be beyond it: commands overshoot a little."""


@dataclass(frozen=True)
class JointColumn:
    """A joint's column: `unit` "mm" or "rad" (readings are converted to it), or another such as "turn"
    (kept as recorded); `range` in that unit, None for any value.

    written: the unit of the column unless its header names one, that of the machine file where it is empty; counted: it holds
    an encoder's counts. wrap: what readings are stated to come modulo; turn: what makes no difference to the machine.
    """

    name: str
    unit: str
    range: tuple[float, float] | None = None
    written: str = ""
    counted: bool = False
    wrap: float | None = None
    turn: float | None = None

    def written_in(self, units: UnitSystem) -> str:
        """Return the unit of the column where its header names none."""
        return self.written or units.of_joint(self.unit)


def joint_readings(table: Table, joint: JointColumn, unit: str) -> Array:
    """Return the readings (n,) of a joint in its unit, in its range. Raises InputError for those that are not."""
    recorded = table.numbers(joint.name)
    readings = sized(table, joint.name, convert(recorded, unit, joint.unit), recorded)
    if joint.range is None:
        return readings
    low, high = joint.range
    readings = _folded(readings, joint, low, high)
    ends = (convert(end, joint.unit, unit) for end in (low, high))
    expected = f"a value in the joint's range [{', '.join(f'{end:.6g}' for end in ends)}] {unit}"
    beyond = _beyond(readings, low, high)
    table.refuse(joint.name, beyond, lambda row: f"{recorded[row]:.6g} {unit}", expected)
    return readings


def _folded(readings: Array, joint: JointColumn, low: float, high: float) -> Array:
    """Readings (n,) brought into a range of a turn or less, where they are stated or seen to come modulo a turn."""
    period = joint.wrap or joint.turn
    if period is None or high - low > period * (1.0 + 1e-9):
        return readings
    folded = fold(readings, period, (low + high) / 2)
    logged = np.all((readings >= 0.0) & (readings <= period)) and not _beyond(folded, low, high).any()
    outside = bool(_beyond(readings, low, high).any())
    return folded if joint.wrap or (outside and logged) else readings


def turned_notes(
    table: Table, joints: Sequence[JointColumn], q: Mapping[str, Array], said: Mapping[str, str]
) -> list[str]:
    """A note on joints whose readings were brought into their ranges."""
    recorded = {j.name: convert(table.numbers(j.name), said[j.name], j.unit) for j in joints}
    moved = [n for n, values in q.items() if np.any(np.abs(values - recorded[n]) > 1e-6 * np.ptp(values))]
    what = "are brought into the joint's range by whole turns"
    return [f"{table.file}: {', '.join(moved)}: readings {what}"] if moved else []


def _beyond(readings: Array, low: float, high: float) -> Mask:
    slack = SLACK * (high - low)
    return np.asarray((readings < low - slack) | (readings > high + slack))


def column_unit(table: Table, joint: JointColumn, units: UnitSystem) -> str:
    """The unit that a joint's column is in. Raises InputError for counts where the machine file states none."""
    stated = table.stated_units[joint.name]
    if isinstance(stated, str) and stated.lower() in COUNT_WORDS:
        if joint.counted:
            return joint.written
        raise InputError(
            f"{table.where(joint.name)}: found the unit {stated!r}, an encoder's counts, expected `counts: N` (N a turn, or a "
            f"mm) of joint {joint.name!r} in the machine file"
        )
    return table.unit(joint.name, joint.written_in(units), joint.unit)


def sized(
    table: Table, name: str, values: Array, recorded: Array | None = None, largest: float = LARGEST
) -> Array:
    """The values of a column, none of them so large that no instrument reads it; in messages as they are ``recorded``."""
    shown = values if recorded is None else recorded
    expected = f"at most {largest:g} by size in the program's units"
    table.refuse(name, np.abs(values) > largest, lambda row: f"{shown[row]:g}", expected)
    return values
