"""Entries of the machine file's ``effects:`` list: physics beyond ideal geometry, with its values."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, GetJsonSchemaHandler, ValidationError, WithJsonSchema
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema

from truepose.errors import InputError
from truepose.models.file.fields import Number, NumberTolerance, Section, as_number, input_error
from truepose.models.file.limits import LATEST, within
from truepose.models.units import convert, parse_unit
from truepose.wording import close_matches, cut


@dataclass(frozen=True)
class EffectSpec:
    """One effect at its place.

    `parameters` are (value, unit) as written, `std` their 1-sigma in the same unit where the file has
    one; `settings` are the entry's other fields. `where` opens messages: file and field.
    """

    effect: str
    place: tuple[str, ...]
    parameters: Mapping[str, tuple[float, str]]
    std: Mapping[str, float] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    where: str = ""

    def value(self, name: str, unit: str) -> float:
        """A parameter in the unit its effect expects. Raises InputError for a missing one or a bad unit."""
        if name not in self.parameters:
            hint = close_matches(name, self.parameters)
            raise InputError(f"{self.where}.parameters: missing {name!r} ({unit}); {hint}".rstrip("; "))
        value, own = self.parameters[name]
        return convert(value, own, unit, f"{self.where}.parameters.{name}")

    def std_of(self, name: str, unit: str) -> float | None:
        """The 1-sigma of a parameter in `unit`, None where the file states none."""
        if name not in self.std:
            return None
        own = self.parameters[name][1]
        return convert(self.std[name], own, unit, f"{self.where}.parameters.{name}")


def _as_list(value: object) -> object:
    items = value if isinstance(value, list) else [value]
    # places of row effects are row numbers
    return [str(item) if isinstance(item, int) and not isinstance(item, bool) else item for item in items]


_NAME = {"type": ["string", "integer"]}
_PLACE = WithJsonSchema({"anyOf": [_NAME, {"type": "array", "items": _NAME}]})


@dataclass(frozen=True)
class _OrNumber:
    """In an ``Annotated`` type: a plain number will do as well."""

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {"anyOf": [{"type": "number"}, handler(core)]}


_NUMBER_TOO = _OrNumber()


def _as_quantity(value: object) -> object:
    return value if isinstance(value, dict) else {"value": value}


class _Quantity(Section):
    value: Number
    """The coefficient's value."""
    unit: str = "1"
    """Unit of `value` and `std`; `truepose effects SLUG` says which one to expect."""
    std: NumberTolerance | None = None
    """1-sigma of the value, where a fit has found it."""


class EffectEntry(Section):
    """One entry of ``effects``; what it has beside these fields are settings of that effect."""

    effect: str = Field(min_length=1)
    """Slug in the catalogue (`truepose effects`)."""
    place: Annotated[tuple[str, ...], BeforeValidator(_as_list), _PLACE]
    """Where it acts: a joint, leg, link, frame, sensor ... or several that share one cause."""
    parameters: dict[str, Annotated[_Quantity, BeforeValidator(_as_quantity), _NUMBER_TOO]] = Field(
        default_factory=dict
    )
    """Coefficients by name: a plain number, or value, unit and std."""


_FIELDS = ("effect", "place", "parameters")


def read_effects(entries: list[dict[str, Any]], path: Path) -> tuple[EffectSpec, ...]:
    """The entries of ``effects:``, checked. Raises InputError naming file and field."""
    return tuple(_read_effect(entry, path, f"effects[{index}]") for index, entry in enumerate(entries))


def _setting(value: object, where: str) -> float:
    """What tells a form of an effect from another: always a number, which stays whole where it is."""
    if isinstance(value, dict):
        raise InputError(
            f"{where}: found {cut(repr(value))}, expected a number: a setting stands beside effect and place, "
            "coefficients stand in parameters"
        )
    number = float(value) if isinstance(value, bool) else as_number(value)
    if number is None or not within(number, LATEST):
        raise InputError(
            f"{where}: found {cut(repr(value))}, expected a number of at most {LATEST:g} by size"
        )
    return value if isinstance(value, int) and not isinstance(value, bool) else number


def _read_effect(entry: dict[str, Any], path: Path, prefix: str) -> EffectSpec:
    where = f"{path}: {prefix}"
    for key in entry:
        near = difflib.get_close_matches(key, _FIELDS, n=1, cutoff=0.8)
        if key not in _FIELDS and near:  # a setting would not be called nearly like a field
            raise InputError(f"{where}.{key}: unknown field; did you mean {near[0]!r}?")
    try:
        parsed = EffectEntry.model_validate({key: entry[key] for key in _FIELDS if key in entry})
    except ValidationError as exc:
        raise input_error(exc, path, prefix) from None
    quantities = parsed.parameters
    return EffectSpec(
        effect=parsed.effect,
        place=parsed.place,
        parameters={
            name: (item.value, parse_unit(item.unit, "any", f"{where}.parameters.{name}.unit"))
            for name, item in quantities.items()
        },
        std={name: item.std for name, item in quantities.items() if item.std is not None},
        settings={k: _setting(v, f"{where}.{k}") for k, v in entry.items() if k not in _FIELDS},
        where=where,
    )
