"""``schema``: the JSON Schema of truepose's files, for editors and checkers."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import check_file, tell


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
