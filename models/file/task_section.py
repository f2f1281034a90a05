"""The field ``task`` of a machine file: which components of the tool's pose have to be met."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, WithJsonSchema

from truepose.models.file.fields import bad_value
from truepose.models.task import COMPONENTS, Task


def _task(value: object) -> Task:
    expected = f"a list of components, any of {', '.join(COMPONENTS)}"
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise bad_value(expected, value)
    try:
        return Task.of(value)
    except ValueError as exc:
        raise bad_value(str(exc), value) from None


TaskField = Annotated[
    Task,
    BeforeValidator(_task),
    WithJsonSchema(
        {"type": "array", "items": {"enum": list(COMPONENTS)}, "minItems": 1, "uniqueItems": True}
    ),
]
