"""``import``: from what trackers, telescopes, spreadsheets and robots write to a recording."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from truepose.commands.common import FileOption, JsonOption, check_file, finish, options, pairs, progress
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_write_text, write_table

if TYPE_CHECKING:
    import pandas as pd

    from truepose.identification.recording.table import Table

FileArg = Annotated[Path, typer.Argument(metavar="FILE", help="What was measured: text, workbook, bag.")]


@options(
    form="--format auto|leica|spatialanalyzer|faro|tpoint|excel|bag|table: Of the file; auto: by its content.",
    joints="FILE: Table of the joints, a row a point: joined by its column name, point or target, else in order.",
    unit="UNIT: Of a point list's lengths, where it does not say.",
    topic="TOPIC: Of a bag's poses, or a frame parent->child.",
    joint="NAME: Joint of a bag or log that matters (all); repeatable.",
    prismatic="NAME: Joint of a bag that is read in metres; repeatable.",
    rename="OLD=NEW: Another name for a column; repeatable.",
    columns="NEW=NAME,...: What columns are, where no heading says it: x=TCPX,y=TCPY,z=TCPZ; without any heading by number, "
    "x=2,y=3,z=4.",
    log="FILE: The robot's log, by a clock of its own: time and joints, which every sample of FILE gets at its time.",
    offset="S: Added to FILE's times it is the log's. Left out: found from the motion.",
    every=("S: Least time between rows, with --log; 0: every sample.", {"min": 0.0}),
    model="MACHINE: Machine file that names the log's joints and tells the clocks to a fraction of a millisecond.",
    rotation="auto|vector|quaternion|rpy: Of FILE: rx ry rz, qx qy qz qw, or roll pitch yaw, also as rx ry rz. auto: by name, "
    "with --log.",
    machine="FILE: Also a machine file to start from, of TPOINT's mounts.",
)
def import_(
    file: FileArg,
    output: FileOption,
    form: str = "auto",
    joints: Path | None = None,
    unit: str | None = None,
    topic: str | None = None,
    joint: list[str] | None = None,
    prismatic: list[str] | None = None,
    rename: list[str] | None = None,
    columns: str | None = None,
    log: Path | None = None,
    offset: float | None = None,
    every: float = 0.0,
    model: Path | None = None,
    rotation: str = "auto",
    machine: Path | None = None,
    as_json: JsonOption = False,
) -> None:
    """Turn a tracker's point list, a probe's log, TPOINT's stars, a workbook or a ROS bag into a recording.

    A bag becomes one row for each stretch in which all joints stand still, with the average of what was seen.

    Example: truepose import points.txt --joints joints.csv -o recording.csv

    A mount's stars: truepose import stars.dat -o stars.csv --machine mount.yaml

    A logger's table: truepose import log.csv --columns x=TCPX,y=TCPY,z=TCPZ -o recording.csv

    A ROS bag: truepose import run.mcap --topic /tracker/pose -o recording.csv

    A probe and a robot with a clock each: truepose import probe.csv --log robot.csv --model cell.yaml -o recording.csv
    """
    check_file(output, file, joints, log, model)
    if log is None and (offset is not None or every or model is not None):
        raise InputError("--offset, --every, --model: found without --log, expected the robot's log")
    if log is not None and joints is not None:
        raise InputError("--log, --joints: found both, expected the joints from one of them")
    if machine is not None:
        check_file(machine)
        if machine.exists():
            raise InputError(f"{machine}: found a file that is there already, expected another name")
    names = pairs("--rename", rename or (), "OLD=NEW")
    with progress("importing"):
        from truepose.identification.leaves.readers import importing
        from truepose.identification.leaves.readers.turns import has_quaternion, with_rotation_vector
        from truepose.identification.recording.table import read_table

        read_as = "table" if log is not None and form == "auto" else form
        table = importing.read_foreign(
            file, read_as, unit=unit, topic=topic, joints=joint or (), columns=columns
        )
        # roll, pitch and yaw may be joints where nobody says that they are a rotation
        if log is not None or rotation != "auto" or has_quaternion(table):
            table = with_rotation_vector(table, rotation)
        if log is not None:
            logged = read_table(log)
            ours = {old: new for old, new in names.items() if old in logged}
            names = {old: new for old, new in names.items() if old not in ours}
            table = _paired(table, importing.renamed(logged, ours), joint or (), offset, every, model)
        if joints is not None:
            table = importing.with_joints(table, read_table(joints))
        table = importing.renamed(table, names)
        frame = importing.frame_of(table, prismatic or ())
        started = None if machine is None else importing.machine_of(file)
        _write(frame, table.notes, output, started, machine)
    _finish(frame, table.notes, output, machine, as_json=as_json)


def _paired(
    table: Table, log: Table, joints: Sequence[str], offset: float | None, every: float, model: Path | None
) -> Table:
    """Return the table's samples with the joints of a log at their times."""
    from truepose.identification.leaves.readers.probe import Clock, Pairing, clock_of, clock_words

    machine = None
    if model is not None:
        from truepose.models.load import load_machine

        machine = load_machine(model)
    pairing = Pairing.of(table, log, joints or (machine.mechanism.readings if machine else ()))
    if offset is not None:
        clock, told = Clock(offset), "as stated"
    elif machine is None:
        clock = clock_of(pairing)
        told = "by the motion; --model MACHINE tells it more exactly"
    else:
        from truepose.identification.leaves.readers.probe_clock import clock_by_model

        clock = clock_by_model(machine, pairing)
        told = f"by {model}"
    return pairing.rows(clock, every).with_note(clock_words(pairing, clock, told))


def _write(
    frame: pd.DataFrame, notes: Sequence[str], output: Path, started: str | None, machine: Path | None
) -> None:
    """Write the recording, and the text of a machine file that is started: in one step if both are in one folder."""
    if machine is None or started is None:
        write_table(output, frame, notes)
    elif machine.resolve().parent == output.resolve().parent:
        with atomic_directory(output.parent) as partial:
            write_table(partial / output.name, frame, notes)
            atomic_write_text(partial / machine.name, started)
    else:
        atomic_write_text(machine, started)
        write_table(output, frame, notes)


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


COMMANDS = (import_,)
