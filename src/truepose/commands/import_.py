"""``import``: from what trackers, telescopes, spreadsheets and robots write to a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import FileOption, JsonOption, check_file, finish, progress, reported
from truepose.files import atomic_write_text, write_table

FileArg = Annotated[
    Path,
    typer.Argument(metavar="FILE", help="What was measured: text, workbook, bag.", show_default=False),
]
FormatOption = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="auto|leica|spatialanalyzer|faro|tpoint|excel|bag|table",
        help="Of the file; auto: by its content.",
    ),
]
JointsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="Table of the joints, a row a point: joined by its column name, point or target, else in order.",
    ),
]
UnitOption = Annotated[
    str | None, typer.Option(metavar="UNIT", help="Of a point list's lengths, where it does not say.")
]
TopicOption = Annotated[
    str | None, typer.Option(metavar="TOPIC", help="Of a bag's poses, or a frame parent->child.")
]
JointOption = Annotated[
    list[str] | None,
    typer.Option("--joint", metavar="NAME", help="Joint of a bag that matters (all); repeatable."),
]
PrismaticOption = Annotated[
    list[str] | None,
    typer.Option("--prismatic", metavar="NAME", help="Joint of a bag that is read in metres; repeatable."),
]
MachineOption = Annotated[
    Path | None,
    typer.Option(
        "--machine",
        metavar="FILE",
        help="Also a machine file to start from, of TPOINT's mounts.",
        show_default=False,
    ),
]
RenameOption = Annotated[
    list[str] | None,
    typer.Option("--rename", metavar="OLD=NEW", help="Another name for a column; repeatable."),
]


def import_(
    file: FileArg,
    output: FileOption,
    form: FormatOption = "auto",
    joints: JointsOption = None,
    unit: UnitOption = None,
    topic: TopicOption = None,
    joint: JointOption = None,
    prismatic: PrismaticOption = None,
    rename: RenameOption = None,
    machine: MachineOption = None,
    as_json: JsonOption = False,
) -> None:
    """Turn a tracker's point list, TPOINT's stars, a workbook or a ROS bag into a recording.

    A bag becomes one row for each stretch in which all joints stand still, with the average of what was seen.

    Example: truepose import points.txt --joints joints.csv -o recording.csv

    A mount's stars: truepose import stars.dat -o stars.csv --machine mount.yaml

    A ROS bag: truepose import run.mcap --topic /tracker/pose -o recording.csv
    """
    with reported():
        from truepose.errors import InputError
        from truepose.identification.recording import importing
        from truepose.identification.recording.table import read_table

        check_file(output)
        if machine is not None:
            check_file(machine)
            if machine.exists():
                raise InputError(f"{machine}: found a file that is there already, expected another name")
        names = {}
        for text in rename or ():
            old, sign, new = text.partition("=")
            if not sign or not old or not new:
                raise InputError(f"--rename: found {text!r}, expected OLD=NEW")
            names[old] = new
        with progress("importing"):
            table = importing.read_foreign(file, form, unit=unit, topic=topic, joints=joint or ())
            if joints is not None:
                table = importing.with_joints(table, read_table(joints))
            frame = importing.frame_of(importing.renamed(table, names), prismatic or ())
            started = None if machine is None else importing.machine_of(file)
            write_table(output, frame, table.notes)
            if machine is not None and started is not None:
                atomic_write_text(machine, started)
        columns = [str(name) for name in frame.columns]
        files = [str(path) for path in (output, machine) if path is not None]
        summary = {"command": "import", "rows": len(frame), "columns": columns, "files": files}
        lines = [f"{output}: {len(frame)} rows: {', '.join(columns)}"]
        if machine is not None:
            lines += [
                f"{machine}: a machine file to start from; the lines marked CHECK are yours to check",
                f"then: truepose diagnose {machine} {output} -o result",
            ]
        finish(summary, lines, table.notes, as_json=as_json)
