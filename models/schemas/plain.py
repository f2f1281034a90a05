"""What pydantic says of a `Section`, as a plain JSON Schema: no references, no titles, nothing that a default repeats."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from truepose.models.file.fields import Section

Schema = dict[str, Any]
_DEFS: Final = "#/$defs/"


def plain_schema(section: type[Section]) -> Schema:
    """The JSON Schema (draft 2020-12) of a section of a file, by the names that the file uses."""
    made = section.model_json_schema(by_alias=True, mode="validation")
    plain: Schema = _plain(made, made.get("$defs", {}))
    return plain


def _plain(schema: Any, known: Mapping[str, Any]) -> Any:
    if isinstance(schema, list):
        return [_plain(item, known) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        own = {key: value for key, value in schema.items() if key != "$ref"}
        return _plain({**known[schema["$ref"].removeprefix(_DEFS)], **own}, known)
    out = {key: _part(key, value, known) for key, value in schema.items() if key not in ("title", "$defs")}
    return _vector(_nullable(out))


def _part(key: str, value: Any, known: Mapping[str, Any]) -> Any:
    if key in ("properties", "patternProperties"):  # names of fields are no keywords
        return {name: _plain(item, known) for name, item in value.items()}
    return value if key in ("default", "const", "enum") else _plain(value, known)


def _nullable(schema: Schema) -> Schema:
    """``X or nothing`` as X that may be null; a default that is null, or that its own fields state, says nothing."""
    options = schema.get("anyOf", [])
    if isinstance(schema.get("default", ...), (dict, type(None))):
        schema = {key: value for key, value in schema.items() if key != "default"}
    others = [option for option in options if option != {"type": "null"}]
    if len(others) != 1 or len(options) != 2 or "type" not in others[0]:
        return schema
    rest = {key: value for key, value in schema.items() if key != "anyOf"}
    kind = others[0]["type"]
    return {**others[0], **rest, "type": [*([kind] if isinstance(kind, str) else kind), "null"]}


def _vector(schema: Schema) -> Schema:
    """A tuple of things of one kind as an array of a fixed length."""
    items = schema.get("prefixItems")
    if not items or any(item != items[0] for item in items):
        return schema
    return {**{key: value for key, value in schema.items() if key != "prefixItems"}, "items": items[0]}
