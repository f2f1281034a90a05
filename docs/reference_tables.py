"""The tables of keys in ``docs/reference/``, and the shipped JSON Schemas, made from the code.

A page marks where a table belongs: ``<!-- keys: sensor.pose -->`` ... ``<!-- end -->``, or ``<!-- columns: ORDER -->``.
What stands between the marks is replaced. Run it after a field or column was added or described anew:

    python docs/reference_tables.py
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import recording_columns as columns
from machine_schema import allowed, machine_schema, schema_text
from recording_columns import row_schema
from truepose.models.schemas import FILES, MACHINE, RECORDING

ROOT: Final = Path(__file__).resolve().parent.parent
PAGES: Final = (ROOT / "docs/reference/machine-file.md", ROOT / "docs/reference/recording.md")
SCHEMAS: Final = {ROOT / "models/schemas" / FILES[kind]: kind for kind in (MACHINE, RECORDING)}
Schema = dict[str, Any]
_MARK: Final = re.compile(r"(<!-- (keys|columns): (\S+) -->\n).*?(<!-- end -->)", re.DOTALL)
_UNITS: Final = {
    "length": "mm",
    "angle": "deg",
    "reading": "mm or deg",
    "reading/s": "mm/s or deg/s",
    "gain": "1",
    "length, angle": "mm, deg",
}
"""How the pages print units that a file may choose."""
_WORDS: Final = {
    "number": "number",
    "time": "number or time",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "object": "mapping",
}
_MACHINE: Final = machine_schema()
_AS_IN: Final = {
    "sensor.pose": "sensor.position",
    "sensor.targets": "sensor.position",
    "sensor.distance": "sensor.position",
    "sensor.ballbar": "sensor.position",
    "sensor.socket": "sensor.position",
    "sensor.irradiance": "sensor.distance",
    "mechanism.6-ups": "mechanism.6-pus",
    "mechanism.graph": "mechanism.serial",
}
"""Parts many of whose keys are those of another: what both have stands once, with the other."""
_TWINS: Final = {"frames.tool.": "frames.base.", "frames.NAME.": "frames.base."}
"""Keys of one part that mean the same, the first as the second."""


def keys(name: str) -> str:
    """The table of a part of the machine file: ``document``, a key of it, ``mechanism.TYPE`` or ``sensor.TYPE``.

    A type that is written in several ways has a table for each.
    """
    others = [other for other in _MACHINE["$defs"] if other.startswith(f"{name}.")]
    own = _rows(_part(name), shallow=name == "document")
    texts = _table(own, like=_AS_IN.get(name, ""))
    for other in others:
        texts += ["", _part(other)["description"].replace("``", "`"), ""]
        texts += _table(_rows(_part(other)), like=name)
    return "\n".join(texts)


def _rows(schema: Schema, *, shallow: bool = False) -> dict[str, str]:
    """The row of every key."""
    return {key: _row(key, field, needed) for key, field, needed in _fields(schema, shallow=shallow)}


def _table(rows: dict[str, str], like: str = "") -> list[str]:
    """Lines of a table, without the rows that stand in that of the part ``like``: their keys are named below it."""
    others = _rows(_part(like)) if like else {}
    shared = [key for key, row in rows.items() if row == others.get(key)]
    twins = {
        key: other + key.removeprefix(one) for one, other in _TWINS.items() for key in rows if one in key
    }
    same = [key for key, twin in twins.items() if rows[key].replace(key, twin) == rows[twin]]
    lines = ["| key | value | meaning |", "|---|---|---|"]
    lines += [row for key, row in rows.items() if key not in (*shared, *same)]
    named = ", ".join(f"`{key}`" for key in (*shared, *same))
    where = like.partition(".")[2] or next((twins[key].rpartition(".")[0] for key in same), "")
    return [*lines, "", f"As in `{where}`: {named}."] if named else lines


def recorded(group: str) -> str:
    """The table of a group of ``recording_columns``."""
    known: Sequence[columns.KnownColumn] = getattr(columns, group)
    sensors = group == "READINGS"
    head = ["column", "value", "sensor" if sensors else "left out", "meaning"]
    rows = []
    for column in known:
        value = ", ".join(str(v) for v in column.values) or _WORDS.get(column.holds, "label")
        unit = _UNITS.get(column.unit, column.unit)
        third = ", ".join(f"`{s}`" for s in column.sensor) if sensors else column.default
        needed = "**needed**" if column in columns.JOINTS else ""
        if not sensors and column.sensor:
            needed = f"**needed** by {' and '.join(f'`{s}`' for s in column.sensor)}"
        rows.append(
            f"| `{column.name}` | {', '.join(filter(None, (value, unit)))} | {needed or third} | {column.text} |"
        )
    return "\n".join([f"| {' | '.join(head)} |", "|---|---|---|---|", *rows])


def rendered(page: str) -> str:
    """A page with its tables made anew."""
    makers: dict[str, Callable[[str], str]] = {"keys": keys, "columns": recorded}
    return _MARK.sub(lambda m: f"{m[1]}{makers[m[2]](m[3])}\n{m[4]}", page)


def marks(page: str) -> list[str]:
    """Names of the tables that a page asks for."""
    return [found[3] for found in _MARK.finditer(page)]


def schema_of(kind: str) -> str:
    """The text of a schema, made now."""
    return schema_text(_MACHINE if kind == MACHINE else row_schema())


def parts() -> list[str]:
    """Names of all tables of the machine file that pages must show."""
    nested = [key for key, field in _MACHINE["properties"].items() if _inner(field)]
    return ["document", *nested, *(name for name in _MACHINE["$defs"] if name.count(".") == 1)]


def _part(name: str) -> Schema:
    if name == "document":
        return _MACHINE
    if name in _MACHINE["$defs"]:
        part: Schema = _MACHINE["$defs"][name]
        return part
    return {"properties": {name: _MACHINE["properties"][name]}, "heading": True}


def _inner(field: Schema) -> list[tuple[str, Schema]]:
    """Fields below a field, with what opens their names."""
    if "oneOf" in field or "$ref" in field:
        return []
    out = [("", field)] if field.get("properties") else []
    lists, named = field.get("items"), field.get("additionalProperties")
    if isinstance(lists, dict):
        out += [(f"[]{opening}", inner) for opening, inner in _inner(lists)]
    if isinstance(named, dict):
        out += [(f".NAME{opening}", inner) for opening, inner in _inner(named)]
    for option in field.get("anyOf", ()):
        out += _inner(option)
    return out


def _fields(schema: Schema, *, shallow: bool, before: str = "") -> Iterator[tuple[str, Schema, bool]]:
    """Every key with its schema and whether it must be there, those below a key after it."""
    required = schema.get("required", ())
    for key, field in sorted(
        schema["properties"].items(), key=lambda item: (item[0] != "type", item[0] not in required)
    ):
        name = f"{before}{key}"
        if not schema.get("heading"):
            yield name, field, key in required
        if not shallow:
            for opening, inner in _inner(field):
                yield from _fields(inner, shallow=False, before=f"{name}{opening}.")


def _row(key: str, field: Schema, needed: bool) -> str:
    unit = field.get("unit", "")
    default = _default(field)
    without = "**needed**" if needed else default and f"default {default}"
    value = ", ".join(filter(None, (_value(field), _UNITS.get(unit, unit), without)))
    return f"| `{key}` | {value} | {field.get('description', '')} |"


def _value(field: Schema) -> str:
    if allowed(field):
        shown = [f"`{value}`" for value in allowed(field)]
        return "a slug" if len(shown) > 9 else ", ".join(shown)
    if "anyOf" in field:
        told = " or ".join(dict.fromkeys(_value(option) for option in field["anyOf"]))
        return re.sub(r"^number( >= 0)? or 3 numbers\1$", r"1 or 3 numbers\1", told)
    kinds = field.get("type", "object")
    kind = next(k for k in ([kinds] if isinstance(kinds, str) else kinds) if k != "null")
    if kind == "array":
        return _list(field)
    return _limited(_WORDS[kind], field)


def _list(field: Schema) -> str:
    items = field.get("items", {})
    word = "mapping" if "oneOf" in items else _value(items)
    if field.get("minItems") == field.get("maxItems") and "maxItems" in field:
        several = re.sub("^(number|text)", r"\1s", word)
        return f"{field['maxItems']} {several}"
    return f"list of {word}s" if word in _WORDS.values() else f"list of {word}"


def _limited(word: str, field: Schema) -> str:
    low, above = field.get("minimum"), field.get("exclusiveMinimum")
    if above == 0 and field.get("exclusiveMaximum") == 1:
        return f"{word} in (0, 1)"
    if low is not None:
        return f"{word} >= {low:g}"
    return f"{word} > {above:g}" if above is not None else word


def _default(field: Schema) -> str:
    value = field.get("default", ...)
    if value is ... or value in ([], {}):
        return ""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        if not any(value):
            return "0"
        return f"[{', '.join(item if isinstance(item, str) else f'{item:g}' for item in value)}]"
    return f"{value:g}" if isinstance(value, float) else f"`{value}`"


def main() -> None:
    """Renew pages and schemas; exit with the lines to write where a part has no table yet."""
    told = {mark for path in PAGES if path.is_file() for mark in marks(path.read_text(encoding="utf-8"))}
    if missing := [f"<!-- keys: {name} -->\n<!-- end -->" for name in parts() if name not in told]:
        sys.exit(f"{PAGES[0].name} needs a heading and these lines:\n" + "\n".join(missing))
    for path in PAGES:
        if path.is_file():
            path.write_text(rendered(path.read_text(encoding="utf-8")), encoding="utf-8")
            sys.stdout.write(
                f"{path.relative_to(ROOT)}: {len(marks(path.read_text(encoding='utf-8')))} tables\n"
            )
    for path, kind in SCHEMAS.items():
        path.write_text(schema_of(kind), encoding="utf-8")
        sys.stdout.write(f"{path.relative_to(ROOT)}\n")


if __name__ == "__main__":
    main()
