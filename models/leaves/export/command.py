"""``export``: a calibrated machine for programs that read other formats."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import JsonOption, MachineArg, check_file, finish, progress

OutputOption = Annotated[
    Path, typer.Option("-o", "--output", metavar="FILE", help="File to write (.urdf, .xml, .yaml or .csv).")
]
FormatOption = Annotated[
    str | None,
    typer.Option(
        "--format",
        help="Format; where not given, the file's suffix tells (.xml mjcf, .yaml ur-kinematics, .csv iso230).",
        metavar="urdf|mjcf|ur-kinematics|iso230",
    ),
]


def export(
    machine: MachineArg,
    output: OutputOption,
    format: FormatOption = None,
    as_json: JsonOption = False,
) -> None:
    """The calibrated machine as URDF, MuJoCo's MJCF, a UR kinematics file, or a volumetric table after ISO 230-1.

    Effects that are no constants fit in no description of links, and a table of axes holds none that couples them: what a
    format leaves out is noted, with how far that moves the tool.

    Example: truepose export fit/calibrated.yaml -o arm.urdf

    Example: truepose export fit/calibrated.yaml -o arm.xml
    """
    from truepose.models.leaves.export.write import export as write
    from truepose.models.leaves.export.write import format_of
    from truepose.models.load import load_machine

    check_file(output, machine)
    chosen = format_of(output, format)
    with progress("exporting"):
        loaded = load_machine(machine)
        done = write(loaded, output, chosen)
    summary = {
        "command": "export",
        "machine": loaded.name,
        "format": done.format,
        "left_out": {label: {"value": size, "unit": "mm"} for label, size in done.left_out.items()},
        "lost": {"value": done.lost, "unit": "mm"},
        "frozen": done.frozen,
        "files": [str(output)],
    }
    finish(summary, [str(output)], done.notes, as_json=as_json)


COMMANDS = (export,)
