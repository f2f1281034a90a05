"""``effects``: the catalogue of physics."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from truepose.commands.common import JsonOption, finish

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
