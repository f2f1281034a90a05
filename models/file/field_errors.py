"""From pydantic's validation errors to one clear line about a field of a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from truepose.errors import InputError
from truepose.wording import cut

_EXPECTED = {
    "missing": "missing field",
    "string_type": "expected a text",
    "string_too_short": "expected a text that is not empty",
    **dict.fromkeys(("model_type", "model_attributes_type", "dict_type"), "expected a mapping of fields"),
    **dict.fromkeys(("list_type", "tuple_type"), "expected a list"),
    "bool_type": "expected true or false",
    **dict.fromkeys(("int_type", "int_from_float", "int_parsing"), "expected a whole number"),
}


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
    if kind == "literal_error":
        return f"expected {context['expected']}"
    if kind == "value_error":
        return text.removeprefix("Value error, ")
    return text[:1].lower() + text[1:]


def _short(value: object) -> str:
    if value is None:
        return "nothing"
    return cut(repr(value))
