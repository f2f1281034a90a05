"""``identifiability``: what poses can and cannot tell about a machine."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from truepose.commands.common import (
    JsonOption,
    MachineArg,
    check_directory,
    check_file,
    finish,
    progress,
    written,
)
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
    typer.Option(
        "-o", "--output", metavar="FILE|DIR", help="A .json file, or a directory for identifiability.json."
    ),
]
NumberOption = Annotated[int, typer.Option("-n", "--poses", min=1, max=POSES, help="How many poses to draw.")]
EveryOption = Annotated[bool, typer.Option("--all", help="Every direction and parameter, however many.")]


def identifiability(
    machine: MachineArg,
    recordings: PosesArg = None,
    output: OutputOption = None,
    number: NumberOption = 100,
    every: EveryOption = False,
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
    from truepose.models.load import load_machine
    from truepose.shown.text import LINES, first_screen

    single = output is not None and output.suffix.lower() == ".json"
    if output is not None:
        (check_file if single else check_directory)(output)
    with progress("looking at the poses"):
        loaded = load_machine(machine)
        rows = load_recording(loaded, recordings, need_observations=False) if recordings else None
        found = run(loaded, rows, poses=number)
        document = identifiability_json(found)
        files = [] if output is None else _write(document, output, single)
    summary = {"command": "identifiability", **document, "files": files}
    told = identifiability_document(found, every)
    lines = [*first_screen(told, 10_000 if every else 2 * LINES), *files]
    finish(summary, lines, document["notes"], as_json=as_json)


def _write(document: dict[str, Any], output: Path, single: bool) -> list[str]:
    """The JSON as the file ``output``, or into the directory of that name."""
    from truepose.files import atomic_directory, atomic_write_text
    from truepose.identification.report.json_text import json_text

    if single:
        atomic_write_text(output, json_text(document))
        return [str(output)]
    with atomic_directory(output) as partial:
        atomic_write_text(partial / "identifiability.json", json_text(document))
    return written(output, ["identifiability.json"])
