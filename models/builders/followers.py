"""Joints that others move: by ratios, or by a formula of driven joints and lengths."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping

from truepose.errors import InputError
from truepose.models.file.fields import Number, Section
from truepose.models.file.formula import FUNCTIONS, Formula, Law
from truepose.models.machine.context import BuildContext

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
