"""What a 6-PUS has in place of ball joints: flexures as beam theory bends them, or legs as elastic chains.

``mechanism.model`` chooses: ``spherical`` (the default) and ``linear`` have ball joints, ``beam`` needs ``flexure``,
``stiffness`` needs ``flexure`` and ``rod`` with their sections (Gayral and Daney 2012, INRIA RR-8096, sections 4 and 5).
``elastic`` is ``stiffness`` with legs that stretch along the direction they have, where the report keeps that of home.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Literal, Protocol

from pydantic import model_validator

from truepose.errors import InputError
from truepose.models.file.fields import In, Length, Number, Section, bad_value
from truepose.models.machine.context import BuildContext
from truepose.models.machine.flexure import SHAPE
from truepose.models.machine.home_directions import home_directions
from truepose.models.machine.mechanism import ElasticChain, Flexures, Mechanism
from truepose.models.machine.parameters import Parameter

Model = Literal["spherical", "linear", "beam", "stiffness", "elastic"]
SECTION = {"bending": "N*mm^2", "tension": "N", "torsion": "N*mm^2"}
"""Stiffness of a section, EI, EA and GJ, and its units, whatever units a file's lengths have."""
_LARGEST_SHAPE = 0.75


class Bar(Section):
    """A round section: EI (N mm^2), EA (N), GJ (N mm^2); the report's k1, k2, k3."""

    bending: Annotated[Number, In("N*mm^2")]
    """Bending stiffness EI, whatever `units` says."""
    tension: Annotated[Number, In("N")]
    """Tension stiffness EA."""
    torsion: Annotated[Number, In("N*mm^2")]
    """Torsion stiffness GJ, whatever `units` says."""

    @model_validator(mode="after")
    def _positive(self) -> Bar:
        for name, unit in SECTION.items():
            if getattr(self, name) <= 0:
                raise bad_value(f"{name} > 0 ({unit})", getattr(self, name))
        return self


class Flexure(Section):
    """Flexures in place of joints: their length, beta of their shift, and their section where it is known."""

    length: Length
    """Length of each flexure."""
    beta: Number = SHAPE
    """Shape factor: the tip runs on a circle of (1 - beta) of the length; 1/4 where the section is constant."""
    bending: Annotated[Number, In("N*mm^2")] | None = None
    """Bending stiffness EI; needed by the models stiffness and elastic."""
    tension: Annotated[Number, In("N")] | None = None
    """Tension stiffness EA; needed by the models stiffness and elastic."""
    torsion: Annotated[Number, In("N*mm^2")] | None = None
    """Torsion stiffness GJ; needed by the models stiffness and elastic."""

    @model_validator(mode="after")
    def _possible(self) -> Flexure:
        if self.length <= 0:
            raise bad_value("length > 0", self.length)
        if not 0 <= self.beta < _LARGEST_SHAPE:
            raise bad_value(f"0 <= beta < {_LARGEST_SHAPE}", self.beta)
        for name, unit in SECTION.items():
            value = getattr(self, name)
            if value is not None and value <= 0:
                raise bad_value(f"{name} > 0 ({unit})", value)
        return self


class FlexedLeg(Protocol):
    """A leg's entry: ``flexure`` and ``beta`` say its own, where they differ from those of all."""

    @property
    def name(self) -> str: ...
    @property
    def length(self) -> float: ...
    @property
    def flexure(self) -> float | None: ...
    @property
    def beta(self) -> float | None: ...


def flexed(
    mechanism: Mechanism,
    model: Model,
    legs: Sequence[FlexedLeg],
    flexure: Flexure | None,
    rod: Bar | None,
    context: BuildContext,
) -> Mechanism:
    """The mechanism with ball joints as the chosen model has it. Raises InputError where a section is missing."""
    mechanism = replace(mechanism, flexure_length=flexure.length if flexure else None)
    if model == "spherical":
        return mechanism
    if model == "linear":
        return replace(mechanism, loops="linear")
    if flexure is None:
        raise InputError(f"{context.where}.flexure: found none, expected one: model {model} bends flexures")
    _check_lengths(legs, flexure, context)
    if model == "beam":
        return _bent(mechanism, legs, flexure, context)
    return _elastic(mechanism, model, legs, flexure, rod, context)


def _bent(
    mechanism: Mechanism, legs: Sequence[FlexedLeg], flexure: Flexure, context: BuildContext
) -> Mechanism:
    """Rods that grow as their flexures bend; flexures are straight in the assembly at home as drawn."""
    found = home_directions(mechanism, context.file)
    home = [(found[f"{rod.name}.a"], found[f"{rod.name}.b"]) for rod in mechanism.rods]
    parameters, rods = list(mechanism.parameters), []
    for k, (leg, rod, (axis_a, axis_b)) in enumerate(zip(legs, mechanism.rods, home, strict=True)):
        shape = flexure.beta if leg.beta is None else leg.beta
        parameters += [
            _length(k, leg, flexure, context),
            context.parameter(f"{leg.name}.beta", "1", shape, ("legs", k, "beta"), "shape", default=0.0),
        ]
        rods.append(
            replace(rod, flexures=Flexures(f"{leg.name}.flexure", f"{leg.name}.beta", axis_a, axis_b))
        )
    return replace(mechanism, parameters=tuple(parameters), rods=tuple(rods))


def _elastic(
    mechanism: Mechanism,
    model: Model,
    legs: Sequence[FlexedLeg],
    flexure: Flexure,
    rod: Bar | None,
    context: BuildContext,
) -> Mechanism:
    """Elastic rods: one flexure length a leg, sections that all legs share."""
    missing = [name for name in SECTION if getattr(flexure, name) is None]
    if missing or rod is None:
        field = f"flexure.{missing[0]}" if missing else "rod"
        raise InputError(
            f"{context.where}.{field}: found none, expected one: model {model} needs bending, "
            "tension and torsion (EI, EA, GJ) of flexure and rod"
        )
    parts = {"flexure": flexure, "rod": rod}
    sections = [
        context.parameter(f"{part}.{name}", unit, getattr(of, name), (part, name), "stiffness", default=0.0)
        for part, of in parts.items()
        for name, unit in SECTION.items()
    ]
    names = [parameter.name for parameter in sections]
    joint, bar = (names[0], names[1], names[2]), (names[3], names[4], names[5])
    lengths = [_length(k, leg, flexure, context) for k, leg in enumerate(legs)]
    rods = [
        replace(
            r,
            elastic=ElasticChain(
                f"{leg.name}.flexure", joint, bar, _pull(leg, flexure, rod), follows=model == "elastic"
            ),
        )
        for leg, r in zip(legs, mechanism.rods, strict=True)
    ]
    return replace(
        mechanism, parameters=(*mechanism.parameters, *lengths, *sections), rods=tuple(rods), loops="elastic"
    )


def _pull(leg: FlexedLeg, flexure: Flexure, rod: Bar) -> float:
    """Stiffness of a leg in tension, N/mm."""
    assert flexure.tension is not None
    return 1.0 / (2 * flexure.length / flexure.tension + (leg.length - flexure.length) / rod.tension)


def _length(place: int, leg: FlexedLeg, flexure: Flexure, context: BuildContext) -> Parameter:
    own = flexure.length if leg.flexure is None else leg.flexure
    return context.parameter(f"{leg.name}.flexure", "mm", own, ("legs", place, "flexure"))


def _check_lengths(legs: Sequence[FlexedLeg], flexure: Flexure, context: BuildContext) -> None:
    for leg in legs:
        own = flexure.length if leg.flexure is None else leg.flexure
        if not 0 < own < leg.length:
            raise InputError(
                f"{context.where}.legs: {leg.name}: found flexures of {own:g} mm in a leg of {leg.length:g} mm, "
                "expected them longer than 0 and shorter than the leg"
            )
