"""Joints that readings drive, and joints that those carry along: fields that the forms of mechanisms share."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from pydantic import Field

from truepose.errors import InputError
from truepose.models.file.fields import Number, Period, Pitch, Range, Ratio, Section, quantity
from truepose.models.file.formula import FUNCTIONS, Formula, Law
from truepose.models.file.limits import positive
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.mechanism import Actuator
from truepose.models.units import convert, counts_unit
from truepose.wording import close_matches


class Encoder(Section):
    """What a joint's column holds, where it is not simply the joint's own angle or length."""

    wrap: Period | None = None
    """The readings come modulo this (`360`, `1 m`), in the file's unit of the column: they are unfolded, see Encoders."""
    counts: Ratio | None = None
    """The column holds an encoder's counts: so many a turn, or a mm of a slide; negative if it counts backwards."""
    coupled: dict[str, Number] = Field(default_factory=dict)
    """The reading is the joint's own angle plus `k` times the other's reading, `{J2: 1}`, in the file's units, see Encoders."""


class Driven(Encoder):
    """A joint whose reading is recorded."""

    range: Range | None = None
    """Lowest and highest reading (a coupled joint: own motion). Beyond it by 5 % of the width is refused; plans stay in it."""
    gear_ratio: Ratio | None = None
    """Turns of the motor for one of the joint; errors that repeat with it are looked for."""
    screw_pitch: Pitch | None = None
    """Travel for one turn of the screw: errors that repeat with it are looked for."""

    def actuator(
        self,
        reading: str,
        drives: str,
        dimension: str,
        context: BuildContext,
        *,
        offset: str | None = None,
        gain: str | None = None,
        home: float | None = None,
    ) -> Actuator:
        """Return the actuator of this joint; ``dimension`` of its readings: ``length``, ``angle`` or ``joint``."""
        units = context.file.units
        unit = units.internal(dimension)
        limits = self.range and (
            units.to_internal(self.range[0], dimension),
            units.to_internal(self.range[1], dimension),
        )
        column = counts_unit(self.counts, unit) if self.counts else units.of(dimension)
        where = f"{context.where}: joint {reading!r}: wrap"
        return Actuator(
            reading,
            drives,
            "rad" if dimension == "angle" else "mm",
            unit,
            offset,
            gain,
            limits,
            self.gear_ratio,
            self.screw_pitch,
            home,
            counted=column if self.counts else None,
            wrap=None if self.wrap is None else _period(self.wrap, column, unit, where),
            plain_wrap=isinstance(self.wrap, float),
            coupled=dict(self.coupled),
        )


def _period(wrap: float | str, column: str, unit: str, where: str) -> float:
    """Return what readings come modulo, in ``unit``. Raises InputError for a text of another dimension."""
    if not isinstance(wrap, str):
        return abs(convert(wrap, column, unit))
    found = quantity(wrap, unit)
    if found is None or not positive(found):
        raise InputError(f"{where}: found {wrap!r}, expected a unit such as {unit}")
    return found


def with_encoders(
    rows: list[dict[str, Any]], encoders: Mapping[str, Mapping[str, Any]], where: str
) -> list[dict[str, Any]]:
    """Return the rows of joints, each with what ``encoders`` says of it by name. Raises InputError for other names."""
    names = [row["name"] for row in rows if row.get("actuated")]
    for name in encoders:
        if name not in names:
            raise InputError(
                f"{where}.encoders: found {name!r}, expected a joint that is read; {close_matches(name, names)}"
            )
    return [row | dict(encoders.get(row["name"], {})) for row in rows]


_OWN = ("x", "y", "z", "rx", "ry", "rz", "offset")
"""Parameters that every joint has."""


class Mimic(Section):
    """Another joint that carries this one along."""

    joint: str
    """A joint of the graph that is `actuated`."""
    ratio: Number = 1.0
    """Displacement of this joint for a unit of the other's, in the file's units (mm/deg of a slide that a turn moves)."""


def ratio_name(joint: str, other: str) -> str:
    """The parameter of how far ``joint`` moves for a unit of another."""
    return f"{joint}.ratio.{other}"


def ratio_unit(unit: str, other: str) -> str:
    """Unit of a ratio of displacements."""
    return "1" if unit == other else f"{unit}/{other}"


def check_lengths(names: Iterable[str], driven: Collection[str], where: str) -> None:
    """Raises InputError for a name that stands for something else in the formula, or among the joint's parameters."""
    for name in names:
        if name in driven or not name.isidentifier() or name in FUNCTIONS or name in _OWN:
            raise InputError(
                f"{where}.lengths: found {name!r}, expected a name of letters and digits that is no joint, function "
                "or parameter of the joint"
            )


def law_of(
    text: str,
    joint: str,
    dimension: str,
    driven: Mapping[str, str],
    lengths: Collection[str],
    context: BuildContext,
    where: str,
) -> Law:
    """What a joint's formula says; ``driven``: dimension of each joint with a reading.

    Raises InputError for names and functions that there are not.
    """
    units = context.file.units
    formula = Formula.read(text, (*driven, *lengths), units.to_internal(1.0, "angle"), f"{where}.computed")
    readings = [(name, units.to_internal(1.0, driven[name])) for name in formula.names if name in driven]
    named = [(name, f"{joint}.{name}", units.to_internal(1.0, "length")) for name in lengths]
    return Law(formula, units.to_internal(1.0, dimension), tuple(readings), tuple(named))
