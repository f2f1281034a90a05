"""Tables of Denavit and Hartenberg as data sheets print them, as rows of the program's own convention, exactly.

``convention: standard`` (Denavit-Hartenberg, Paul): T(i-1, i) = RotZ(theta) TransZ(d) TransX(a) RotX(alpha).
``convention: modified`` (Craig): T(i-1, i) = RotX(alpha) TransX(a) RotZ(theta) TransZ(d), a and alpha those of i - 1.
The joint's variable adds to theta, or to d of a prismatic joint. As RotX and TransX commute, a modified row is a row of
Khalil and Kleinfinger with d = a and r = d. A standard row gives its theta and d to its own joint and its a and alpha to
the next one; those of the last row come after its motion: they are the fixed ``flange``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import model_validator

from truepose.models.builders.driven import Driven
from truepose.models.file.fields import Angle, Length, Section, bad_value
from truepose.models.machine.context import BuildContext

CONVENTIONS = ("khalil", "modified", "standard")
_KEPT = tuple(Driven.model_fields)
"""Fields of a joint that are no constants of the table."""


class ChainJoint(Driven):
    """What a row of a table says of its joint beside the constants."""

    name: str
    """Name of the joint and of the recording's column of its readings."""
    kind: Literal["revolute", "prismatic", "fixed"]
    """Whether it turns about its z axis or slides along it; `fixed`: a row without a joint, such as a flange's."""

    @model_validator(mode="after")
    def _moving(self) -> Self:
        if self.kind == "fixed" and self.model_fields_set & set(Driven.model_fields):
            raise bad_value("fields of a joint's reading on a joint that moves", self.kind)
        return self


class DhJoint(ChainJoint):
    """One row of a standard or modified table."""

    a: Length = 0.0
    """Link length: distance along x. In a standard table it follows the joint, in a modified one it comes before."""
    alpha: Angle = 0.0
    """Twist: turn about x, beside `a`."""
    d: Length = 0.0
    """Shift along z at reading 0; a prismatic joint's reading adds to it."""
    theta: Angle = 0.0
    """Turn about z at reading 0; a revolute joint's reading adds to it."""


class DhTable(Section):
    """The section ``mechanism`` of a serial chain as a data sheet has it."""

    type: Literal["serial"]
    """A chain of joints of one degree of freedom each, as a data sheet tables it."""
    convention: Literal["modified", "standard"]
    """`modified`: RotX(alpha) TransX(a) RotZ(theta) TransZ(d); `standard`: RotZ(theta) TransZ(d) TransX(a) RotX(alpha)."""
    joints: tuple[DhJoint, ...]
    """The rows of the table as they stand, from the base to the flange."""


def khalil_section(section: Mapping[str, Any], context: BuildContext) -> dict[str, Any]:
    """The same chain in the program's own convention, in the file's units. Raises InputError naming file and field."""
    table = context.parse(DhTable, section)
    joints, a, alpha = [], 0.0, 0.0
    for row in section["joints"]:
        if table.convention == "modified":
            a, alpha = row.get("a", 0.0), row.get("alpha", 0.0)
        constants = {"alpha": alpha, "d": a, "theta": row.get("theta", 0.0), "r": row.get("d", 0.0)}
        kept = {key: row[key] for key in _KEPT if row.get(key) is not None}
        joints.append({"name": row["name"], "kind": row["kind"], "beta": 0.0, **constants, **kept})
        a, alpha = row.get("a", 0.0), row.get("alpha", 0.0)
    out: dict[str, Any] = {"type": "serial", "joints": joints}
    if table.convention == "standard" and (a or alpha):
        out["flange"] = {"alpha": alpha, "d": a}
    return out


def table_frames(section: Mapping[str, Any], context: BuildContext) -> dict[str, tuple[float, float]]:
    """Of each link ``linkK`` of a standard table: a (mm) and alpha (rad) from the link's frame to the table's frame K."""
    table = context.parse(DhTable, section)
    if table.convention != "standard":
        return {}
    return {
        f"link{k}": (row.a, row.alpha) for k, row in enumerate(table.joints, start=1) if row.a or row.alpha
    }


__all__ = ["CONVENTIONS", "ChainJoint", "DhTable", "khalil_section", "table_frames"]
