"""``schema``: the JSON Schema of truepose's files, for editors and checkers."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import PluginOption, check_file, tell


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


def schema(kind: KindArg = Kind.machine, output: OutputOption = None, plugin: PluginOption = None) -> None:
    """The JSON Schema (draft 2020-12) of the machine file or of a recording's row.

    Editors that know YAML complete and check a machine file by it. With --plugin it knows the plug-in's types, too.

    Example: truepose schema machine -o machine-1.json
    """
    from truepose.files import atomic_write_text

    text = _text(kind, made=bool(plugin))
    if output is None:
        tell(text, nl=False)
        return
    check_file(output)
    atomic_write_text(output, text)
    tell(f"wrote {output}")


def _text(kind: Kind, *, made: bool) -> str:
    """As shipped; made anew where plug-ins were loaded."""
    from truepose.models.schemas import stored

    if not made or kind is Kind.recording:
        return stored(kind.value)
    from truepose.models.schemas.machine import machine_schema, schema_text

    return schema_text(machine_schema())
