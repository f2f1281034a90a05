"""``effects``: the catalogue of physics; ``schema``: the JSON Schema of truepose's files, for editors and checkers."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.commands.common import JsonOption, check_file, finish, tell

SlugArg = Annotated[str | None, typer.Argument(metavar="[SLUG]", help="One effect, in full.")]
_FIELDS = ("formula", "size", "look_alikes", "experiment", "source")
_WORDS = {"look_alikes": "looks like", "experiment": "told apart by"}


def effects(slug: SlugArg = None, as_json: JsonOption = False) -> None:
    """The catalogue of physics: formula, size, look-alikes, separating experiment, source.

    Example: truepose effects joint-compliance
    """
    from truepose.models.effects.base import effects as registry

    wanted = list(registry) if slug is None else [slug]
    entries = [_entry(name, registry.get(name, "effects")) for name in wanted]
    lines = _one(entries[0]) if slug is not None else _table(entries)
    finish({"command": "effects", "effects": entries}, lines, [], as_json=as_json)


def _entry(slug: str, kind: Any) -> dict[str, Any]:
    entry: dict[str, Any] = {"effect": slug, "title": kind.title}
    for field in _FIELDS:
        value = getattr(kind, field)
        entry[field] = list(value) if isinstance(value, tuple) else value
    return {**entry, "needs_load": kind.needs_load}


def _one(entry: dict[str, Any]) -> list[str]:
    lines = [f"{entry['effect']}: {entry['title']}"]
    for field in _FIELDS:
        value = entry[field]
        text = ", ".join(value) if isinstance(value, list) else value
        lines.append(f"  {_WORDS.get(field, field)}: {text or '-'}")
    return lines


def _table(entries: list[dict[str, Any]]) -> list[str]:
    width = max(len(entry["effect"]) for entry in entries)
    lines = [f"{entry['effect']:<{width}}  {entry['title']}: {entry['formula']}" for entry in entries]
    return [
        *lines,
        "",
        "truepose effects SLUG tells size, look-alikes, the experiment that separates them, and the source.",
    ]


class Kind(StrEnum):
    """Which file."""

    machine = "machine"
    recording = "recording"


KindArg = Annotated[
    Kind,
    typer.Argument(
        metavar="[machine|recording]", help="Of which file: the machine file, or a recording's row."
    ),
]
OutputOption = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="File to write instead of standard output."),
]


def schema(kind: KindArg = Kind.machine, output: OutputOption = None) -> None:
    """The JSON Schema (draft 2020-12) of the machine file or of a recording's row.

    Editors that know YAML complete and check a machine file by it.

    Example: truepose schema machine -o machine-1.json
    """
    from truepose.files import atomic_write_text
    from truepose.models.schemas import stored

    text = stored(kind.value)
    if output is None:
        tell(text, nl=False)
        return
    check_file(output)
    atomic_write_text(output, text)
    tell(f"wrote {output}")
