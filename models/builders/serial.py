"""Serial chains of one-degree-of-freedom joints, Khalil-Kleinfinger convention with Hayati's extra turn.

T(i-1, i) = RotY(beta) RotX(alpha) TransX(d) RotZ(theta) TransZ(r); the reading adds to theta (revolute)
or r (prismatic). Hayati's beta keeps the description continuous where neighbouring axes are parallel;
elsewhere it is redundant and the tolerances decide how it shares with theta and r. A ``flange`` turned by alpha about,
and shifted by d along, the last link's x axis is fixed to it; a row of kind ``fixed`` is a frame without a joint. Tables in
the conventions of data sheets become such rows (``truepose.models.builders.serial``).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any, Literal, Self

from pydantic import model_validator
from pydantic_core import PydanticCustomError

from truepose.errors import InputError
from truepose.models.builders.driven import Driven
from truepose.models.file.fields import Angle, Length, Section, bad_value
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.mechanism import BASE, Joint, Mechanism, Parameter, Step

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


_STEPS = (
    ("ry", "beta", "rad"),
    ("rx", "alpha", "rad"),
    ("tx", "d", "mm"),
    ("rz", "theta", "rad"),
    ("tz", "r", "mm"),
)
FLANGE = "flange"
_FLANGE_STEPS = (("rx", "alpha", "rad"), ("tx", "d", "mm"))
_WHAT_D_MEANS = (
    "unknown field; here `d` is the length of the link (a in standard tables) and `r` the offset along the joint's "
    "axis (d there); to write a table with a, alpha, d and theta as it stands, add `convention: standard` (or "
    "`modified`, Craig's) beside `joints`"
)


class SerialJoint(ChainJoint):
    """One row of the table of constants."""

    beta: Angle = 0.0
    """Hayati's extra turn about y, first of all; leave it out unless the drawing has one."""
    alpha: Angle = 0.0
    """Twist: turn about x from the axis before to this one."""
    d: Length = 0.0
    """Distance along x from the axis before to this one. It is not the `d` of the standard convention."""
    theta: Angle = 0.0
    """Turn about z at reading 0; a revolute joint's reading adds to it."""
    r: Length = 0.0
    """Shift along z at reading 0; a prismatic joint's reading adds to it."""

    @model_validator(mode="before")
    @classmethod
    def _no_other_convention(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and "a" in data:
            raise PydanticCustomError("unknown_field", _WHAT_D_MEANS, {"field": "a", "found": data["a"]})
        return data


class SerialFlange(Section):
    """The flange in the last link: RotX(alpha) TransX(d)."""

    alpha: Angle = 0.0
    """Turn about the last link's x axis."""
    d: Length = 0.0
    """Shift along the last link's x axis."""


class Serial(Section):
    """The section ``mechanism`` of a serial chain in the program's own convention."""

    type: Literal["serial"]
    """A chain of joints of one degree of freedom each."""
    convention: Literal["khalil"] = "khalil"
    """The program's own convention, that of Khalil and Kleinfinger."""
    joints: tuple[SerialJoint, ...]
    """The rows of the table of constants, from the base to the flange."""
    flange: SerialFlange | None = None
    """Where the flange sits on the last link; left out: at the last joint's frame."""


@builders.add("serial")
def serial(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """Mechanism of a serial chain; bodies ``link1 ... linkN``, flange ``linkN``, or ``flange`` where one is fixed to it."""
    convention = section.get("convention", "khalil")
    if convention not in CONVENTIONS:
        raise InputError(
            f"{context.where}.convention: found {convention!r}, expected one of {', '.join(CONVENTIONS)}"
        )
    if convention == "khalil":
        return _chain(context.parse(Serial, section), context)
    own = khalil_section(section, context)
    chain = _chain(context.parse(Serial, own), context)
    return replace(chain, expanded=own, table_frames=table_frames(section, context))


def _chain(chain: Serial, context: BuildContext) -> Mechanism:
    names = [joint.name for joint in chain.joints]
    if not names or len(set(names)) != len(names):
        raise InputError(
            f"{context.where}.joints: found {names}, expected at least one joint, each with a name of its own"
        )
    parameters: list[Parameter] = []
    joints, actuators = [], []
    for k, row in enumerate(chain.joints, start=1):
        values = row.model_dump()
        parameters += [
            context.parameter(f"{row.name}.{field}", unit, values[field], ("joints", k - 1, field))
            for _, field, unit in _STEPS
        ]
        placement = tuple(Step(kind, f"{row.name}.{field}") for kind, field, _ in _STEPS)
        parent = BASE if k == 1 else f"link{k - 1}"
        joints.append(Joint(row.name, row.kind, parent, f"link{k}", placement))
        if row.kind != "fixed":
            dimension = "angle" if row.kind == "revolute" else "length"
            actuators.append(row.actuator(row.name, row.name, dimension, context))
    if not actuators:
        raise InputError(
            f"{context.where}.joints: found fixed rows only, expected at least one joint that moves"
        )
    lengths, flange = _lengths(names), joints[-1].child
    if chain.flange is not None:
        parameters += _flange(chain.flange, names, context)
        placement = tuple(Step(kind, f"{FLANGE}.{field}") for kind, field, _ in _FLANGE_STEPS)
        joints.append(Joint(FLANGE, "fixed", flange, FLANGE, placement))
        lengths[flange] = (*lengths.get(flange, ()), f"{FLANGE}.d")
        flange = FLANGE
    return Mechanism(tuple(parameters), tuple(joints), tuple(actuators), flange, lengths=lengths)


def _flange(flange: SerialFlange, names: list[str], context: BuildContext) -> list[Parameter]:
    if FLANGE in names:
        raise InputError(
            f"{context.where}.joints: found a joint called {FLANGE!r}, expected another name beside the fixed flange"
        )
    values = flange.model_dump()
    return [
        context.parameter(f"{FLANGE}.{field}", unit, values[field], (FLANGE, field))
        for _, field, unit in _FLANGE_STEPS
    ]


def _lengths(names: list[str]) -> dict[str, tuple[str, ...]]:
    """What heats up together: r and d of the first joint with the base, then what lies between joints K and
    K+1 (link1: only d of joint 2)."""
    out: dict[str, tuple[str, ...]] = {BASE: (f"{names[0]}.r", f"{names[0]}.d")}
    for k, (here, after) in enumerate(pairwise(names), start=1):
        out[f"link{k}"] = (f"{after}.d",) if k == 1 else (f"{here}.r", f"{after}.d")
    if len(names) > 1:
        out[f"link{len(names)}"] = (f"{names[-1]}.r",)
    return out
