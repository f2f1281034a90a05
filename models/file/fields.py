"""Fields of machine files: numbers with a dimension, converted while pydantic validates a `Section`.

A number may be written with a unit of its own, as a text: ``20um``, ``0.5 deg``.

Give `context={"units": UnitSystem(...)}`: the annotated types (`Length`, `AngleVector`, ...) turn what a file states
into the units of the program. They also say their unit in the JSON Schema (``In``).

Every field of a `Section` is described by the text below it; `docs/reference/machine-file.md` and the JSON Schema are made from
these texts (`python docs/reference_tables.py`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetJsonSchemaHandler,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, PydanticCustomError

from truepose.errors import InputError
from truepose.models.file.limits import LARGEST, LATEST, SMALLEST, positive, within
from truepose.models.units import UnitSystem, convert, is_unit
from truepose.wording import close_matches, cut

_EXPECTED = {
    "missing": "missing field",
    "string_type": "expected a text",
    "string_too_short": "expected a text that is not empty",
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "expected a mapping of fields"),
    **dict.fromkeys(("list_type", "tuple_type"), "expected a list"),
    "bool_type": "expected true or false",
    **dict.fromkeys(("int_type", "int_from_float", "int_parsing"), "expected a whole number"),
}

_BOUNDS = {"greater_than": ("gt", ">"), "greater_than_equal": ("ge", ">="), "less_than": ("lt", "<")}


def input_error(exc: ValidationError, path: Path | str, prefix: str = "") -> InputError:
    """The first thing a section's validation found, as ``file: field: expected ..., found ...``.

    `prefix` is the section's own field (``mechanism``, ``sensor[1]``), empty for the whole document.
    """
    errors = exc.errors(include_url=False)
    first = errors[0]
    context: dict[str, Any] = first.get("ctx") or {}
    location = list(first["loc"])
    if "field" in context:
        location.append(str(context["field"]))
    field = _join(prefix, location)
    message = f"{path}: {field}: {_message(first['type'], first['msg'], context)}"
    if first["type"] != "missing":
        message += f", found {_short(context.get('found', first['input']))}"
    if len(errors) > 1:
        message += f" (and {len(errors) - 1} more to mend)"
    return InputError(message)


def _join(prefix: str, location: list[int | str]) -> str:
    field = prefix
    for part in (cut(p) if isinstance(p, str) else p for p in location):
        field += f"[{part}]" if isinstance(part, int) else f".{part}" if field else str(part)
    return field or "document"


def _message(kind: str, text: str, context: dict[str, Any]) -> str:
    if kind in _EXPECTED:
        return _EXPECTED[kind]
    if kind in _BOUNDS:
        key, sign = _BOUNDS[kind]
        return f"expected a number {sign} {context[key]:g}"
    if kind == "literal_error":
        return f"expected {context['expected']}"
    if kind == "value_error":
        return text.removeprefix("Value error, ")
    return text[:1].lower() + text[1:]


def _short(value: object) -> str:
    if value is None:
        return "nothing"
    return cut(repr(value))


def _units(info: ValidationInfo) -> UnitSystem:
    context = info.context
    if isinstance(context, Mapping) and isinstance(context.get("units"), UnitSystem):
        return cast("UnitSystem", context["units"])
    return UnitSystem()


def bad_value(expected: str, found: object) -> PydanticCustomError:
    """The error an annotated type raises: what was expected and what was found."""
    return PydanticCustomError("bad_value", "expected {expected}", {"expected": expected, "found": found})


_QUANTITY = re.compile(
    r"\s*(?P<value>[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|\.?inf))\s*(?P<unit>[^\d\s.+-].*?)\s*",
    re.IGNORECASE,
)


STATED = r"^\s*[-+]?((\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|\.?inf)\s*[^\d\s.+-].*$"
"""The same for a JSON Schema."""


def quantity(text: object, unit: str) -> float | None:
    """The number of a text such as ``20um`` in ``unit``; None for what is no number with a unit of the same dimension."""
    found = _QUANTITY.fullmatch(text) if isinstance(text, str) else None
    if found is None:
        return None
    try:
        return convert(float(found["value"].lower().replace(".inf", "inf")), found["unit"], unit)
    except InputError:
        return None


def is_quantity(text: str) -> bool:
    """Whether a text is a number with a unit."""
    found = _QUANTITY.fullmatch(text)
    return found is not None and is_unit(found["unit"])


def with_texts(schema: JsonSchemaValue) -> JsonSchemaValue:
    """A JSON Schema whose numbers may be texts with a unit as well: ``20um``."""
    out = dict(schema)
    if out.get("type") == "number":
        out |= {"type": ["number", "string"], "pattern": STATED}
    for key in ("items", "prefixItems", "anyOf"):
        if key in out:
            inner = out[key]
            out[key] = [with_texts(one) for one in inner] if isinstance(inner, list) else with_texts(inner)
    return out


@dataclass(frozen=True)
class In:
    """In an ``Annotated`` type: what the field is measured in, for its JSON Schema.

    ``unit`` is a unit, or ``length``, ``angle``, ``gain`` (the file's unit of it), ``reading`` (that of the joint).
    ``stated``: numbers may be texts with a unit of their own.
    """

    unit: str
    stated: bool = False

    def __get_pydantic_json_schema__(
        self, core: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        """The schema of the type, with the keyword ``unit``."""
        schema = handler(core)
        return {**(with_texts(schema) if self.stated else schema), "unit": self.unit}


@dataclass(frozen=True)
class _Numbers:
    """Which numbers a field takes, and the words for them around "number"."""

    kind: str
    limits: str
    fits: Callable[[float], bool]
    largest: float = LARGEST

    def words(self, unit: str, count: int = 1) -> str:
        number = f"a {self.kind}number" if count == 1 else f"{count} {self.kind}numbers"
        return f"{number}{self.limits} ({unit})"

    def read(self, value: object, dimension: str, units: UnitSystem, expected: str) -> float:
        """A field's number in internal units."""
        internal = units.internal(dimension)
        own = None if dimension == "number" else quantity(value, internal)
        if own is None:
            stated = as_number(value)
            if stated is None or not (self.fits(stated) or self.may_be(stated)):
                raise bad_value(expected, value)
            own = units.to_internal(stated, dimension)
        if not self.fits(own):
            sized = self.may_be(own)
            unit = "" if internal == "1" else f" in {internal}"
            raise bad_value(f"{expected}, {self.sized}{unit}" if sized else expected, value)
        return own

    def may_be(self, value: float) -> bool:
        """Whether a number would do if sizes did not count: then the message says which ones do."""
        return math.isfinite(value) and (value > 0.0 or not self.limits)

    @property
    def sized(self) -> str:
        """Which sizes do."""
        return (
            f"at most {self.largest:g} by size"
            if not self.limits
            else f"between {SMALLEST:g} and {LARGEST:g}"
        )


def as_number(value: object) -> float | None:
    """A number of a document; None for all else, and for whole numbers that no float can hold."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        return float(value)
    except OverflowError:
        return None


_FINITE = _Numbers("finite ", "", within)
_PLAIN = _Numbers("finite ", "", lambda value: within(value, LATEST), LATEST)
"""In units of any kind: a rod's stiffness times its length is large."""
_TOLERANCE = _Numbers("", " >= 0 or .inf", lambda value: value in {0.0, math.inf} or positive(value))
_SIGMA = _Numbers("finite ", " > 0", positive)
_ANY_TOLERANCE = _Numbers("", " >= 0 or .inf", lambda value: value == math.inf or 0.0 <= value <= LARGEST)
"""Of constants in units of any kind, which may be as small as they like."""
_DIVISOR = _Numbers("finite ", " that is not 0", lambda value: positive(abs(value)))


def _scalar(dimension: str, numbers: _Numbers = _FINITE) -> BeforeValidator:
    def validate(value: object, info: ValidationInfo) -> float:
        units = _units(info)
        return numbers.read(value, dimension, units, numbers.words(units.of(dimension)))

    return BeforeValidator(validate)


def _vector(dimension: str, numbers: _Numbers = _FINITE) -> BeforeValidator:
    def validate(value: object, info: ValidationInfo) -> tuple[float, ...]:
        units = _units(info)
        expected = numbers.words(units.of(dimension), 3)
        if numbers is _TOLERANCE and not isinstance(value, (list, tuple)):
            value = [value] * 3  # one tolerance for the three components
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise bad_value(expected, value)
        return tuple(numbers.read(item, dimension, units, expected) for item in value)

    return BeforeValidator(validate)


def _period(value: object) -> float | str:
    """Return a number, or a number with a unit as it stands: what dimension it has is the joint's affair."""
    if isinstance(value, str) and is_quantity(value):
        return value
    return _SIGMA.read(value, "number", UnitSystem(), _SIGMA.words("1"))


def _ascending(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] >= value[1]:
        raise bad_value("[low, high] with low < high", list(value))
    return value


_LENGTH, _ANGLE = In("length", stated=True), In("angle", stated=True)
_TOLERANCE_SCHEMA = {"type": "number", "minimum": 0}
_SIGMA_SCHEMA = WithJsonSchema({"type": "number", "exclusiveMinimum": 0})
_ONE = WithJsonSchema(_TOLERANCE_SCHEMA)
_ONE_OR_THREE = WithJsonSchema(
    {
        "anyOf": [
            _TOLERANCE_SCHEMA,
            {"type": "array", "items": _TOLERANCE_SCHEMA, "minItems": 3, "maxItems": 3},
        ]
    }
)

Triple = tuple[float, float, float]
Ratio = Annotated[float, _scalar("number", _DIVISOR)]
Pitch = Annotated[float, _scalar("length", _DIVISOR), _LENGTH]
Number = Annotated[float, _scalar("number", _PLAIN)]
Period = Annotated[float | str, BeforeValidator(_period), _SIGMA_SCHEMA, In("reading", stated=True)]
Mass = Annotated[float, _scalar("mass"), In("kg", stated=True)]
Length = Annotated[float, _scalar("length"), _LENGTH]
Angle = Annotated[float, _scalar("angle"), _ANGLE]
Force = Annotated[float, _scalar("force"), In("N", stated=True)]
Stiffness = Annotated[float, _scalar("stiffness"), In("N/mm", stated=True)]
Gain = Annotated[float, _scalar("gain", _DIVISOR), In("gain", stated=True)]
Ascending = Annotated[tuple[Number, Number], AfterValidator(_ascending)]
Range = Annotated[Ascending, In("reading")]
Vector = Annotated[Triple, _vector("number")]
LengthVector = Annotated[Triple, _vector("length"), _LENGTH]
AngleVector = Annotated[Triple, _vector("angle"), _ANGLE]
LengthSigma = Annotated[float, _scalar("length", _SIGMA), _SIGMA_SCHEMA, _LENGTH]
AngleSigma = Annotated[float, _scalar("angle", _SIGMA), _SIGMA_SCHEMA, _ANGLE]
NumberTolerance = Annotated[float, _scalar("number", _ANY_TOLERANCE), _ONE]
LengthTolerance = Annotated[float, _scalar("length", _TOLERANCE), _ONE, _LENGTH]
MassTolerance = Annotated[float, _scalar("mass", _TOLERANCE), _ONE, In("kg", stated=True)]
ForceTolerance = Annotated[float, _scalar("force", _TOLERANCE), _ONE, In("N", stated=True)]
StiffnessTolerance = Annotated[float, _scalar("stiffness", _TOLERANCE), _ONE, In("N/mm", stated=True)]
AngleTolerance = Annotated[float, _scalar("angle", _TOLERANCE), _ONE, _ANGLE]
LengthToleranceVector = Annotated[Triple, _vector("length", _TOLERANCE), _ONE_OR_THREE, _LENGTH]
AngleToleranceVector = Annotated[Triple, _vector("angle", _TOLERANCE), _ONE_OR_THREE, _ANGLE]


class FilePart(BaseModel):
    """A part of a file that users write: frozen, and every field it does not know is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=False, use_attribute_docstrings=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_fields(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or cls.model_config.get("extra") == "allow":
            return data
        known = [field.alias or name for name, field in cls.model_fields.items()]
        for key in data:
            if key not in known:
                hint = close_matches(str(key), known)
                context = {"field": str(key), "hint": hint, "found": data[key]}
                raise PydanticCustomError("unknown_field", "unknown field; {hint}", context)
        return data


class Section(FilePart):
    """A part of the machine file."""
