"""``import``: from what trackers, telescopes, spreadsheets and robots write to a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import FileOption, JsonOption, check_file, finish, progress, reported
from truepose.files import atomic_write_text, write_table

if TYPE_CHECKING:
    import pandas as pd

    from truepose.identification.recording.table import Table

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
    typer.Option("--joint", metavar="NAME", help="Joint of a bag or log that matters (all); repeatable."),
]
LogOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="The robot's log, by a clock of its own: time and joints, which every sample of FILE gets at its time.",
    ),
]
OffsetOption = Annotated[
    float | None,
    typer.Option(metavar="S", help="Added to FILE's times it is the log's. Left out: found from the motion."),
]
EveryOption = Annotated[
    float, typer.Option(metavar="S", min=0.0, help="Least time between rows, with --log; 0: every sample.")
]
ModelOption = Annotated[
    Path | None,
    typer.Option(
        metavar="MACHINE",
        help="Machine file that names the log's joints and tells the clocks to a fraction of a millisecond.",
    ),
]
RotationOption = Annotated[
    str,
    typer.Option(
        metavar="auto|vector|quaternion|rpy",
        help="Of FILE: rx ry rz, qx qy qz qw, or roll pitch yaw, also as rx ry rz. auto: by name, with --log.",
    ),
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
    log: LogOption = None,
    offset: OffsetOption = None,
    every: EveryOption = 0.0,
    model: ModelOption = None,
    rotation: RotationOption = "auto",
    machine: MachineOption = None,
    as_json: JsonOption = False,
) -> None:
    """Turn a tracker's point list, a probe's log, TPOINT's stars, a workbook or a ROS bag into a recording.

    A bag becomes one row for each stretch in which all joints stand still, with the average of what was seen.

    Example: truepose import points.txt --joints joints.csv -o recording.csv

    A mount's stars: truepose import stars.dat -o stars.csv --machine mount.yaml

    A ROS bag: truepose import run.mcap --topic /tracker/pose -o recording.csv

    A probe and a robot with a clock each: truepose import probe.csv --log robot.csv --model cell.yaml -o recording.csv
    """
    with reported():
        from truepose.identification.recording import importing
        from truepose.identification.recording.table import read_table
        from truepose.identification.recording.turns import with_rotation_vector

        check_file(output)
        _refuse(log, joints, machine, log_needed=offset is not None or bool(every) or model is not None)
        names = _new_names(rename or ())
        with progress("importing"):
            form = "table" if log is not None and form == "auto" else form
            table = importing.read_foreign(file, form, unit=unit, topic=topic, joints=joint or ())
            if log is not None or rotation != "auto":
                table = with_rotation_vector(table, rotation)
            if log is not None:
                of_log = read_table(log)
                ours = {old: new for old, new in names.items() if old in of_log}
                names = {old: new for old, new in names.items() if old not in ours}
                table = _paired(table, importing.renamed(of_log, ours), joint or (), offset, every, model)
            if joints is not None:
                table = importing.with_joints(table, read_table(joints))
            frame = importing.frame_of(importing.renamed(table, names), prismatic or ())
            started = None if machine is None else importing.machine_of(file)
            write_table(output, frame, table.notes)
            if machine is not None and started is not None:
                atomic_write_text(machine, started)
        _finish(frame, table.notes, output, machine, as_json=as_json)


def _refuse(log: Path | None, joints: Path | None, machine: Path | None, *, log_needed: bool) -> None:
    """Raise InputError for options that do not go together, and for a machine file that is there already."""
    from truepose.errors import InputError

    if log is None and log_needed:
        raise InputError("--offset, --every, --model: found without --log, expected the robot's log")
    if log is not None and joints is not None:
        raise InputError("--log, --joints: found both, expected the joints from one of them")
    if machine is not None:
        check_file(machine)
        if machine.exists():
            raise InputError(f"{machine}: found a file that is there already, expected another name")


def _new_names(rename: Sequence[str]) -> dict[str, str]:
    """New names of columns by their old ones. Raises InputError for what is no OLD=NEW."""
    from truepose.errors import InputError

    names = {}
    for text in rename:
        old, sign, new = text.partition("=")
        if not sign or not old or not new:
            raise InputError(f"--rename: found {text!r}, expected OLD=NEW")
        names[old] = new
    return names


def _finish(
    frame: pd.DataFrame, notes: Sequence[str], output: Path, machine: Path | None, *, as_json: bool
) -> None:
    columns = [str(name) for name in frame.columns]
    files = [str(path) for path in (output, machine) if path is not None]
    summary = {"command": "import", "rows": len(frame), "columns": columns, "files": files}
    lines = [f"{output}: {len(frame)} rows: {', '.join(columns)}"]
    if machine is not None:
        lines += [
            f"{machine}: a machine file to start from; the lines marked CHECK are yours to check",
            f"then: truepose diagnose {machine} {output} -o result",
        ]
    finish(summary, lines, notes, as_json=as_json)


def _paired(
    table: Table, log: Table, joints: Sequence[str], offset: float | None, every: float, model: Path | None
) -> Table:
    """The table's samples with the joints of a log at their times."""
    from truepose.identification.recording.clock_offset import Clock, clock_of
    from truepose.identification.recording.probe import Pairing, clock_words

    machine = None
    if model is not None:
        from truepose.models.load import load_machine

        machine = load_machine(model)
    pairing = Pairing.of(table, log, joints or (machine.mechanism.readings if machine else ()))
    clock = Clock(offset) if offset is not None else clock_of(pairing.motion, pairing.files)
    told = "as stated" if offset is not None else "by the motion; --model MACHINE tells it more exactly"
    if machine is not None and offset is None:
        from truepose.identification.fit.probe_clock import clock_by_model

        clock, told = clock_by_model(machine, pairing, clock), f"by {model}"
    return pairing.rows(clock, every).with_note(clock_words(pairing, clock, told))
