"""The JSON Schema of the machine file: what its sections say of themselves, mechanisms and sensors told apart by ``type``.

It knows the types and effects of the program; ``models/schemas`` ships it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, Final

from truepose.models.file.effect_entry import EffectEntry
from truepose.models.file.fields import Section
from truepose.models.file.machine_file import MachineDocument
from truepose.models.file.names import MACHINE_SCHEMA
from truepose.models.file.sections import DefaultTolerances
from truepose.models.machine.builder import builders
from truepose.models.machine.effect import effects
from truepose.models.machine.sensor import sensors
from truepose.models.registry import Registry

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


DIALECT: Final = "https://json-schema.org/draft/2020-12/schema"


def machine_schema() -> Schema:
    """The schema of a machine file. Lengths, angles and readings have the keyword ``unit`` with that word."""
    document = plain_schema(MachineDocument)
    fields = document["properties"]
    mechanisms, instruments = _by_type(builders), _by_type(sensors)
    _replace(fields["mechanism"], _one_of("mechanism", mechanisms))
    one = _one_of("sensor", instruments)
    _replace(fields["sensor"], {"anyOf": [{"type": "array", "items": one}, one]})
    defaults = plain_schema(DefaultTolerances)["properties"]
    fields["tolerances"]["properties"] = defaults
    fields["effects"]["items"] = _effect()
    own = {f"mechanism.{name}": schema for name, schema in mechanisms.items()}
    own |= {f"sensor.{name}": schema for name, schema in instruments.items()}
    head = {"$schema": DIALECT, "$id": MACHINE_SCHEMA, "title": "truepose machine file"}
    return {**head, **document, "$defs": own}


def schema_text(schema: Schema) -> str:
    """A schema as the text of a file: keys in order, one line a value."""
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _effect() -> Schema:
    """An entry of ``effects``: whatever is no field of every entry is a setting of its effect."""
    entry = plain_schema(EffectEntry)
    entry["properties"]["effect"]["enum"] = list(effects)
    return {**entry, "additionalProperties": True}


def _replace(field: Schema, by: Schema) -> None:
    """Give a field another schema, with the description it has."""
    text = field["description"]
    field.clear()
    field.update(by, description=text)


def _one_of(kind: str, known: Mapping[str, Schema]) -> Schema:
    """Any of the sections; first the words that ``type`` may say, for a clear message."""
    names = dict.fromkeys(name for schema in known.values() for name in allowed(schema["properties"]["type"]))
    return {
        "type": "object",
        "required": ["type"],
        "properties": {"type": {"enum": list(names)}},
        "oneOf": [{"$ref": f"#/$defs/{kind}.{name}"} for name in known],
    }


def _by_type(registry: Registry[Any]) -> dict[str, Schema]:
    """Schemas of the sections whose ``type`` is registered. A plug-in that has no section may hold anything.

    Where a type has several, the one that is called like it comes first, and the others are named ``type.class``.
    """
    names = list(registry)  # which imports the modules with their sections
    sections = _below(Section)
    out: dict[str, Schema] = {}
    for name in names:
        anything: Schema = {"type": "object", "properties": {"type": {"const": name}}, "required": ["type"]}
        found = sorted(
            (section for section in sections if _type(section) == name),
            key=lambda section: (section.__name__.lower() != name, section.__name__),
        )
        out |= {name if k == 0 else f"{name}.{s.__name__}": plain_schema(s) for k, s in enumerate(found)}
        out.setdefault(name, anything)
    return out


def allowed(schema: Schema) -> list[Any]:
    """The values that a schema names; none where it names none."""
    return [schema["const"]] if "const" in schema else list(schema.get("enum", ()))


def _below(section: type[Section]) -> list[type[Section]]:
    return [kind for child in section.__subclasses__() for kind in (child, *_below(child))]


def _type(section: type[Section]) -> str | None:
    """What a section's ``type`` must say; None for a section without one."""
    field = section.model_fields.get("type")
    return None if field is None else str(*getattr(field.annotation, "__args__", ()))
