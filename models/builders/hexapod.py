"""Six-legged parallel machines: 6-PUS (legs of fixed length on rails) and 6-UPS (legs that change length).

Both are the general mechanism: a platform free to move, and one rod per leg that closes a loop. A leg's
universal and spherical joints leave it free to turn about itself, so only the distance of its ends counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.builders.driven import Driven
from truepose.models.file.fields import Gain, In, Length, LengthVector, Number, Section, Vector
from truepose.models.lie import exp_so3, unit_vector
from truepose.models.machine.assembly import SHAPE
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.kinematics import home_directions
from truepose.models.machine.mechanism import (
    BASE,
    Actuator,
    Direction,
    ElasticChain,
    Flexures,
    Joint,
    Limb,
    Mechanism,
    Parameter,
    Rod,
    Step,
)

Model = Literal["spherical", "linear", "beam", "stiffness", "elastic"]
SECTION = {"bending": "N*mm^2", "tension": "N", "torsion": "N*mm^2"}
"""Stiffness of a section, EI, EA and GJ, and its units, whatever units a file's lengths have."""
_LARGEST_SHAPE = 0.75


class Bar(Section):
    """A round section: EI (N mm^2), EA (N), GJ (N mm^2); the report's k1, k2, k3."""

    bending: Annotated[Number, In("N*mm^2")] = Field(gt=0.0)
    """Bending stiffness EI, whatever `units` says."""
    tension: Annotated[Number, In("N")] = Field(gt=0.0)
    """Tension stiffness EA."""
    torsion: Annotated[Number, In("N*mm^2")] = Field(gt=0.0)
    """Torsion stiffness GJ, whatever `units` says."""


class Flexure(Section):
    """Flexures in place of joints: their length, beta of their shift, and their section where it is known."""

    length: Length = Field(gt=0.0)
    """Length of each flexure."""
    beta: Number = Field(default=SHAPE, ge=0.0, lt=_LARGEST_SHAPE)
    """Shape factor: the tip runs on a circle of (1 - beta) of the length; 1/4 where the section is constant."""
    bending: Annotated[Number, In("N*mm^2")] | None = Field(default=None, gt=0.0)
    """Bending stiffness EI; needed by the models stiffness and elastic."""
    tension: Annotated[Number, In("N")] | None = Field(default=None, gt=0.0)
    """Tension stiffness EA; needed by the models stiffness and elastic."""
    torsion: Annotated[Number, In("N*mm^2")] | None = Field(default=None, gt=0.0)
    """Torsion stiffness GJ; needed by the models stiffness and elastic."""


def flexed(mechanism: Mechanism, hexapod: Pus, context: BuildContext) -> Mechanism:
    """The mechanism with ball joints as the chosen model has it. Raises InputError where a section is missing."""
    model, flexure = hexapod.model, hexapod.flexure
    mechanism = replace(mechanism, flexure_length=flexure.length if flexure else None)
    if model in ("spherical", "linear"):
        return replace(mechanism, loops="linear" if model == "linear" else "exact")
    if flexure is None:
        raise InputError(f"{context.where}.flexure: found none, expected one: model {model} bends flexures")
    lengths = []
    for k, leg in enumerate(hexapod.legs):
        own = flexure.length if leg.flexure is None else leg.flexure
        if not 0 < own < leg.length:
            raise InputError(
                f"{context.where}.legs: {leg.name}: found flexures of {own:g} mm in a leg of {leg.length:g} mm, "
                "expected them longer than 0 and shorter than the leg"
            )
        lengths.append(context.parameter(f"{leg.name}.flexure", "mm", own, ("legs", k, "flexure")))
    if model == "beam":
        return _bent(mechanism, hexapod.legs, lengths, flexure, context)
    mechanism = replace(mechanism, parameters=(*mechanism.parameters, *lengths))
    return _elastic(mechanism, hexapod, flexure, context)


def _bent(
    mechanism: Mechanism,
    legs: Sequence[PusLeg],
    lengths: Sequence[Parameter],
    flexure: Flexure,
    context: BuildContext,
) -> Mechanism:
    """Rods that grow as their flexures bend; flexures are straight in the assembly at home as drawn."""
    home = home_directions(mechanism, context.file)
    parameters, rods = list(mechanism.parameters), []
    for k, (leg, length, rod) in enumerate(zip(legs, lengths, mechanism.rods, strict=True)):
        shape = flexure.beta if leg.beta is None else leg.beta
        field = ("legs", k, "beta")
        beta = context.parameter(f"{leg.name}.beta", "1", shape, field, "shape", default=0.0)
        parameters += [length, beta]
        ends = home[f"{rod.name}.a"], home[f"{rod.name}.b"]
        rods.append(replace(rod, flexures=Flexures(length.name, beta.name, *ends)))
    return replace(mechanism, parameters=tuple(parameters), rods=tuple(rods))


def _elastic(mechanism: Mechanism, hexapod: Pus, flexure: Flexure, context: BuildContext) -> Mechanism:
    """Elastic rods: one flexure length a leg, sections that all legs share."""
    bar, model = hexapod.rod, hexapod.model
    missing = [name for name in SECTION if getattr(flexure, name) is None]
    if missing or bar is None or flexure.tension is None:
        field = f"flexure.{missing[0]}" if missing else "rod"
        raise InputError(
            f"{context.where}.{field}: found none, expected one: model {model} needs bending, "
            "tension and torsion (EI, EA, GJ) of flexure and rod"
        )
    sections = [
        context.parameter(f"{part}.{name}", unit, getattr(of, name), (part, name), "stiffness", default=0.0)
        for part, of in (("flexure", flexure), ("rod", bar))
        for name, unit in SECTION.items()
    ]
    bending, tension, torsion, *of_bar = (parameter.name for parameter in sections)
    rods = []
    for leg, rod in zip(hexapod.legs, mechanism.rods, strict=True):
        pull = 1.0 / (2 * flexure.length / flexure.tension + (leg.length - flexure.length) / bar.tension)
        joint, straight = (bending, tension, torsion), (of_bar[0], of_bar[1], of_bar[2])
        chain = ElasticChain(f"{leg.name}.flexure", joint, straight, pull, follows=model == "elastic")
        rods.append(replace(rod, elastic=chain))
    parameters = (*mechanism.parameters, *sections)
    return replace(mechanism, parameters=parameters, rods=tuple(rods), loops="elastic")


PLATFORM = "platform"
_POINT = ("x", "y", "z")
LEGS = 6


class _Leg(Driven):
    name: str
    """What the leg is called in parameters and places: `leg1`."""
    joint: str
    """Name of its actuator and of the recording's column of its readings."""
    a: LengthVector
    """Centre of the lower joint in the base frame; of a 6-PUS at reading 0 and offset 0."""
    b: LengthVector
    """Centre of the upper joint in the platform's frame."""
    offset: Length = 0.0
    """Added to gain * reading: the leg's length at reading 0 of a 6-UPS, the slider's zero of a 6-PUS."""
    gain: Gain = 1.0
    """Length for one unit of the reading; 1 unless `units.joint` says that readings are no lengths."""


class PusLeg(_Leg):
    """A leg of fixed ``length`` from a slider at a + (reading + offset) u to b on the platform."""

    u: Vector = (0.0, 0.0, 1.0)
    """Direction of the rail in the base frame; its length does not count."""
    length: Length
    """Length of the leg between the centres of its joints."""
    flexure: Length | None = None
    """Length of this leg's flexures, where it differs from `flexure.length` of all."""
    beta: Number | None = None
    """Shape factor of this leg's flexures, where it differs from `flexure.beta` of all."""


class Pus(Section):
    """The section ``mechanism`` of a 6-PUS."""

    type: Literal["6-pus"]
    """Six legs of fixed length between sliders on the base and the platform."""
    legs: tuple[PusLeg, ...]
    """The six legs."""
    model: Model = "spherical"
    """Ball joints (`spherical`; `linear`: to first order about home), bent flexures (`beam`), or elastic legs (the others)."""
    flexure: Flexure | None = None
    """Flexures in place of the universal and spherical joints; needed by the models beam, stiffness and elastic."""
    rod: Bar | None = None
    """Section of the legs' bars; needed by the models stiffness and elastic."""
    home: Annotated[tuple[Number, Number, Number, Number, Number, Number], In("length, angle")]
    """Where the forward solution starts, near readings of 0: x y z and the rotation vector of the platform."""


class Ups(Section):
    """The section ``mechanism`` of a 6-UPS."""

    type: Literal["6-ups"]
    """A Gough-Stewart platform: six legs of changing length, offset + gain * reading."""
    legs: tuple[_Leg, ...]
    """The six legs."""
    home: Annotated[tuple[Number, Number, Number, Number, Number, Number], In("length, angle")]
    """Where the forward solution starts: x y z and the rotation vector of the platform."""


@builders.add("6-pus")
def pus(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """Lower joint centre a + (rho + offset) u, upper b, distance ``length`` (telescope report, eq. 5).

    ``model`` says what stands for the joints: see ``truepose.models.builders.hexapod``.
    """
    hexapod = context.parse(Pus, section)
    sliders, parameters, rods, limbs = [], list[Parameter](), [], []
    for k, leg in enumerate(hexapod.legs):
        own, axis = _rail(k, leg, context)
        parameters += _points(k, leg, context) + own
        a, b, slider, length = *_ends(leg), f"{leg.name}.slider", f"{leg.name}.length"
        placement = tuple(Step(f"t{c}", name) for c, name in zip(_POINT, a, strict=True))
        sliders.append(Joint(leg.joint, "prismatic", BASE, slider, placement, axis))
        rods.append(Rod(leg.name, slider, None, PLATFORM, b, length, leg.length))
        limbs.append(Limb(leg.name, leg.joint, a, b, length))
    actuators = [_actuator(leg, leg.joint, context) for leg in hexapod.legs]
    return flexed(_mechanism(hexapod, parameters, sliders, rods, actuators, limbs, context), hexapod, context)


@builders.add("6-ups")
def ups(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
    """Leg length = offset + gain * reading, between a on the base and b on the platform."""
    hexapod = context.parse(Ups, section)
    parameters, rods, actuators, limbs = list[Parameter](), [], [], []
    for k, leg in enumerate(hexapod.legs):
        home = None if leg.range else (_home_length(leg, hexapod.home, context) - leg.offset) / leg.gain
        actuators.append(_actuator(leg, leg.name, context, home))
        parameters += _points(k, leg, context) + _scale(k, leg, context)
        a, b = _ends(leg)
        rods.append(Rod(leg.name, BASE, a, PLATFORM, b, None, leg.offset))
        limbs.append(Limb(leg.name, leg.joint, a, b, actuators[-1].displacement))
    return _mechanism(hexapod, parameters, [], rods, actuators, limbs, context)


def _mechanism(
    hexapod: Pus | Ups,
    parameters: Sequence[Parameter],
    sliders: Sequence[Joint],
    rods: Sequence[Rod],
    actuators: Sequence[Actuator],
    limbs: Sequence[Limb],
    context: BuildContext,
) -> Mechanism:
    """Put the legs of a hexapod together. Raises InputError unless there are six, each with its own name and joint."""
    names = [leg.name for leg in hexapod.legs]
    if (
        any(len(set(own)) != LEGS for own in (names, [leg.joint for leg in hexapod.legs]))
        or len(names) != LEGS
    ):
        raise InputError(
            f"{context.where}.legs: found {len(names)} legs {names}, expected {LEGS}, "
            "each with its own name and joint"
        )
    lengths = {BASE: tuple(p for limb in limbs for p in limb.base_point)}
    lengths[PLATFORM] = tuple(p for limb in limbs for p in limb.platform_point)
    lengths |= {limb.name: (limb.length,) for limb in limbs}
    joints = (_platform(hexapod.home, context), *sliders)
    parts = (tuple(parameters), joints, tuple(actuators), PLATFORM, tuple(rods), tuple(limbs))
    return Mechanism(*parts, lengths, PLATFORM)


def _rail(place: int, leg: PusLeg, context: BuildContext) -> tuple[list[Parameter], Direction]:
    """Length, offset and gain of a leg, and its rail: the two smallest components of u are parameters."""
    u = unit_vector(leg.u)
    if not np.any(u):
        raise InputError(f"{context.where}.legs: {leg.name}: found u = {leg.u}, expected a direction")
    third = int(np.argmax(np.abs(u)))
    components = [None if k == third else f"{leg.name}.u.{_POINT[k]}" for k in range(3)]
    own = [
        context.parameter(name, "1", float(u[k]), ("legs", place, "u", k), "angle")
        for k, name in enumerate(components)
        if name is not None
    ]
    own.append(context.parameter(f"{leg.name}.length", "mm", leg.length, ("legs", place, "length")))
    axis = Direction(
        (components[0], components[1], components[2]),
        float(np.sign(u[third])),
        (*context.path, "legs", place, "u", third),
    )
    return own + _scale(place, leg, context), axis


def _scale(place: int, leg: _Leg, context: BuildContext) -> list[Parameter]:
    unit = context.file.units.internal("gain")
    return [
        context.parameter(f"{leg.name}.offset", "mm", leg.offset, ("legs", place, "offset")),
        context.parameter(f"{leg.name}.gain", unit, leg.gain, ("legs", place, "gain"), "gain", default=0.0),
    ]


def _points(place: int, leg: _Leg, context: BuildContext) -> list[Parameter]:
    return [
        *context.vector(f"{leg.name}.a", leg.a, ("legs", place, "a")),
        *context.vector(f"{leg.name}.b", leg.b, ("legs", place, "b")),
    ]


def _ends(leg: _Leg) -> list[tuple[str, str, str]]:
    """Return the names of the coordinates of a leg's lower and upper joint."""
    return [(f"{leg.name}.{end}.x", f"{leg.name}.{end}.y", f"{leg.name}.{end}.z") for end in "ab"]


def _actuator(leg: _Leg, drives: str, context: BuildContext, home: float | None = None) -> Actuator:
    offset, gain = f"{leg.name}.offset", f"{leg.name}.gain"
    return leg.actuator(leg.joint, drives, "joint", context, offset=offset, gain=gain, home=home)


def _placed(home: tuple[float, ...], context: BuildContext) -> tuple[Array, Array]:
    """Return the position and the rotation vector (3,) of the platform at home, which is in the file's units."""
    units = context.file.units
    position, turn = (
        units.to_internal(np.array(v), k) for v, k in ((home[:3], "length"), (home[3:], "angle"))
    )
    return position, turn


def _home_length(leg: _Leg, home: tuple[float, ...], context: BuildContext) -> float:
    """Return the distance of a leg's ends at home."""
    position, turn = _placed(home, context)
    return float(np.linalg.norm(position + exp_so3(turn) @ np.array(leg.b) - np.array(leg.a)))


def _platform(home: tuple[float, ...], context: BuildContext) -> Joint:
    """The platform's free joint."""
    position, turn = _placed(home, context)
    angle = float(np.linalg.norm(turn))
    mrp = turn * (np.tan(angle / 4) / angle if angle else 0.0)
    return Joint(f"{PLATFORM}.pose", "free", BASE, PLATFORM, home=(*position.tolist(), *mrp.tolist()))
