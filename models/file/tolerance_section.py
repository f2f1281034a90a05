"""The sections ``tolerances`` and ``bounds`` of a machine file: numbers in its own units, some with a unit of theirs."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from truepose.models.file.fields import (
    AngleTolerance,
    In,
    LengthTolerance,
    Section,
    as_number,
    bad_value,
    is_quantity,
    with_texts,
)
from truepose.models.file.limits import LARGEST


def _numbers(value: object) -> tuple[float | str, ...]:
    """Numbers in the file's units, and texts such as ``20um``, whose unit the parameter decides on."""
    items: list[Any] = value if isinstance(value, list) else [value]
    if not items or not all(_is_tolerance(item) for item in items):
        raise bad_value(f"a number >= 0 or .inf, at most {LARGEST:g}, or several for a vector", value)
    return tuple(item if isinstance(item, str) else float(item) for item in items)


def _is_tolerance(item: object) -> bool:
    if isinstance(item, str):
        return is_quantity(item) and not item.lstrip().startswith("-")
    number = as_number(item)
    return number is not None and (number == math.inf or 0.0 <= number <= LARGEST)


def _interval(value: object) -> tuple[float, float]:
    items = value if isinstance(value, list) else []
    numbers = [number for number in map(as_number, items) if number is not None]
    if len(items) != 2 or len(numbers) != 2 or not numbers[0] < numbers[1]:
        raise bad_value("[low, high], two numbers with low < high (-.inf and .inf leave a side open)", value)
    return numbers[0], numbers[1]


_NOT_NEGATIVE = {"type": "number", "minimum": 0}
_STATED = WithJsonSchema(
    with_texts(
        {"anyOf": [_NOT_NEGATIVE, {"type": "array", "items": _NOT_NEGATIVE, "minItems": 1, "maxItems": 6}]}
    )
)
Override = Annotated[tuple[float | str, ...], BeforeValidator(_numbers), _STATED]
Interval = Annotated[tuple[float, float], BeforeValidator(_interval), In("the parameter's")]


class DefaultTolerances(Section):
    """What the section ``tolerances`` says of every parameter that nothing else states a tolerance of."""

    length: LengthTolerance = 0.0
    """1-sigma of every length of the mechanism (all `d` and `r`, all `a` and `b` ...)."""
    angle: AngleTolerance = 0.0
    """1-sigma of every angle and direction of the mechanism (all `alpha`, all `theta`, all `u` ...)."""
