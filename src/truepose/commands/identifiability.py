"""``identifiability``: what poses can and cannot tell about a machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import JsonOption, MachineArg, check_file, finish, progress
from truepose.files import atomic_write_text
from truepose.models.file.limits import POSES

PosesArg = Annotated[
    list[Path] | None,
    typer.Argument(
        metavar="[RECORDING...]",
        help="Recordings or files of poses; without any, poses are drawn over the joints' ranges.",
    ),
]
OutputOption = Annotated[
    Path | None,
    typer.Option("-o", "--output", metavar="FILE", help="File to write (.json)."),
]
NumberOption = Annotated[int, typer.Option("-n", "--poses", min=1, max=POSES, help="How many poses to draw.")]


def identifiability(
    machine: MachineArg,
    recordings: PosesArg = None,
    output: OutputOption = None,
    number: NumberOption = 100,
    as_json: JsonOption = False,
) -> None:
    """What these poses can and cannot tell, in words; readings are not needed.

    Rank, directions that no reading sees, directions seen worse than the tolerances say, and the 1-sigma to
    expect of every parameter.

    Example: truepose identifiability machine.yaml poses.csv
    """
    from truepose.identification.identifiability.analysis import identifiability as run
    from truepose.identification.recording.load import load_recording
    from truepose.identification.report.identifiability_words import (
        identifiability_document,
        identifiability_json,
    )
    from truepose.identification.report.json_text import json_text
    from truepose.models.load import load_machine
    from truepose.shown.text import LINES, first_screen

    if output is not None:
        check_file(output, machine, *(recordings or ()))
    with progress("looking at the poses"):
        loaded = load_machine(machine)
        rows = load_recording(loaded, recordings, need_observations=False) if recordings else None
        found = run(loaded, rows, poses=number)
        document = identifiability_json(found)
        if output is not None:
            atomic_write_text(output, json_text(document))
    files = [] if output is None else [str(output)]
    summary = {"command": "identifiability", **document, "files": files}
    lines = [*first_screen(identifiability_document(found), 2 * LINES), *files]
    finish(summary, lines, document["notes"], as_json=as_json)
