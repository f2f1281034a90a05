"""A path to follow as a table: nominal joint values, or poses of the tool that nominal joints are solved for.

Poses stand in the nominal frame of the base, as in the generated C: columns x y z and the rotation vector rx ry rz, or the
same behind ``pose.``.

A corrected path as text: a million rows in a second.

Read a file of commands back before it is published: it must hold the joints that were solved for.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.csv as pacsv  # type: ignore[import-untyped]

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.compiled import NotCompiledError
from truepose.errors import InputError, ReadBackError
from truepose.identification.compensation.compensate import (
    BLOCK,
    COMPILED_FROM,
    Compensation,
    ideal_constants,
    twists_between,
)
from truepose.identification.compensation.inverse import (
    MET,
    CompiledKinematics,
    Inverse,
    PoseSolver,
    Reach,
    base_frame,
    shared_out,
)
from truepose.identification.recording.angle_range import unfold_readings
from truepose.identification.recording.joint_column import JointColumn, column_unit
from truepose.identification.recording.load import joint_columns
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table, read_table
from truepose.models import lie
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS as POSE
from truepose.models.units import convert
from truepose.wording import close_matches

MARKS = 500
"""Rows along a long path that are solved here, for the C to start from."""


def load_path(machine: Machine, path: Path | str) -> tuple[Table, Recording]:
    """The path's table with a column for every joint, and its rows.

    Raises InputError naming file, row and column: neither joints nor poses, a pose out of the nominal machine's
    reach, a joint out of its range.
    """
    table, joints = read_table(path), machine.mechanism.readings
    poses = _pose_columns(table, joints)
    notes: tuple[str, ...] = ()
    if poses:
        table, notes = _with_joints(machine, table, poses)
    for name in joints:
        if name not in table:
            raise InputError(
                f"{path}: missing column {name!r}, expected the joints {', '.join(joints)}, or the tool's poses in "
                f"{', '.join(POSE)}; {close_matches(name, table.names)}"
            )
    rows = read_recording([table], joint_columns(machine), poses, machine.units, need_observations=False)
    if any(actuator.wrap for actuator in machine.mechanism.actuators):
        rows = unfold_readings(machine, rows)
    return table, replace(rows, notes=(*rows.notes, *notes))


def _pose_columns(table: Table, joints: Sequence[str]) -> Mapping[str, str]:
    """Return the columns of a table of poses with their units inside, none of them for a table of joints.

    They are called ``pose.x`` ... where a joint is called as one of them. Raises InputError where both could be meant.
    """
    whole = all(name in table for name in POSE)
    if whole and set(joints) < set(POSE):
        raise InputError(
            f"{table.file}: found the columns {', '.join(POSE)}, poses or the joints {', '.join(joints)}, expected the joints "
            f"alone, or poses in {', '.join(f'pose.{name}' for name in POSE)}"
        )
    opened = {f"pose.{name}": unit for name, unit in POSE.items()}
    if any(name in table for name in joints):
        return {}
    return POSE if whole else opened if all(name in table for name in opened) else {}


def commands(table: Table, machine: Machine, found: Compensation) -> pd.DataFrame:
    """The table with the joints' columns corrected, each in its own unit."""
    corrected = {}
    for k, joint in enumerate(joint_columns(machine)):
        unit = column_unit(table, joint, machine.units)
        commanded = convert(table.numbers(joint.name), unit, joint.unit)
        turns = whole_turns(joint, commanded - found.nominal[:, k])
        corrected[joint.name] = convert(found.command[:, k] + turns, joint.unit, unit)
    headers = {c.name: c.name if c.unit is None else f"{c.name} [{c.unit}]" for c in table.columns}
    cells = {n: corrected[n] if n in corrected else list(table.cells[n]) for n in headers}
    return pd.DataFrame({header: cells[name] for name, header in headers.items()})


def whole_turns(joint: JointColumn, apart: Array) -> Array:
    """Return of differences (n,) of a joint's readings what is whole turns, or what its readings come modulo."""
    period = joint.wrap or joint.turn
    return period * np.round(apart / period) if period else np.zeros_like(apart)


def _with_joints(machine: Machine, table: Table, columns: Mapping[str, str]) -> tuple[Table, tuple[str, ...]]:
    """The table with nominal joints for its poses, and what they do not meet of these."""
    units = machine.units
    own = {name: table.unit(name, units.written(unit), unit) for name, unit in columns.items()}
    parts = [convert(table.numbers(name), own[name], unit) for name, unit in columns.items()]
    poses = lie.pose_of(lie.exp_so3(np.column_stack(parts[3:])), np.column_stack(parts[:3]))
    solver = PoseSolver(machine, ideal_constants(machine, symbolic_model(machine, machine.effects)))
    q = _nominal_joints(solver, table, poses)
    columns_of = enumerate(joint_columns(machine))
    joints = {j.name: convert(q[:, k], j.unit, j.written_in(units)) for k, j in columns_of}
    return table.with_numbers(joints), _not_met(solver, table, poses, q)


def _not_met(solver: PoseSolver, table: Table, poses: Array, q: Array) -> tuple[str, ...]:
    """What readings (n, nq) leave of poses (n, 4, 4) in the nominal frame of the base, where a task asks for a part of them."""
    if solver.task.is_whole:
        return ()
    base = base_frame(solver.machine)
    twists = twists_between(base @ poses, solver.forward(q)[0])
    rest = twists - solver.task.counted(twists, base @ poses, base[:3, :3])
    position, turn = (float(np.max(np.linalg.norm(part, axis=1))) for part in (rest[:, :3], rest[:, 3:]))
    return (
        f"{table.file}: of the poses, nominal joints meet {solver.task.words}; the rest is off by up to {position:.4g} mm and "
        f"{np.degrees(turn):.4g} deg",
    )


def _nominal_joints(solver: PoseSolver, table: Table, poses: Array) -> Array:
    """(n, nq) readings of the machine with nominal links at poses (n, 4, 4) in the nominal frame of the base.

    Many rows are solved by the generated C, each from the last row before it that is solved here: where a pose has
    several solutions, those in between take the same one.
    """
    machine, rows = solver.machine, np.arange(len(poses))
    q, solved = np.zeros((len(poses), len(machine.mechanism.readings))), np.zeros(len(poses), dtype=bool)
    if len(poses) >= COMPILED_FROM:
        with contextlib.suppress(NotCompiledError):
            q, solved = _by_compiled(machine, solver, poses)
    left = rows[~solved]
    for start in range(0, len(left), BLOCK):
        part = left[start : start + BLOCK]
        found = solver.inverse(base_frame(machine) @ poses[part])
        _check_reach(table, part, found)
        q[part] = found.q
    return q


def _by_compiled(machine: Machine, solver: PoseSolver, poses: Array) -> tuple[Array, Mask]:
    """Readings (n, nq) by the generated C, and which rows it solved. Raises NotCompiledError."""
    kinematics = CompiledKinematics(machine, solver.task)
    marks = np.arange(0, len(poses), -(-len(poses) // MARKS))
    known = solver.inverse(base_frame(machine) @ poses[marks])
    guess = np.where(known.solved[:, None], known.q, solver.model.q_home)
    q, good = np.repeat(guess, np.diff([*marks, len(poses)]), axis=0), np.zeros(len(poses), dtype=bool)

    def part(rows: slice) -> None:
        wanted = poses[rows, :3]
        q[rows], solved = kinematics.ik(wanted, q[rows], p=solver.p)
        again, assembled = kinematics.fk(q[rows], p=solver.p)
        left = solver.task.counted(twists_between(wanted, again), wanted, np.eye(3))
        apart = np.abs(left) / np.repeat([solver.size, 1.0], 3)
        good[rows] = solved & assembled & (np.max(apart, axis=1) <= MET)

    shared_out(part, len(poses), BLOCK)
    return q, good


def _check_reach(table: Table, rows: Index, found: Inverse) -> None:
    if found.solved.all():
        return
    row = int(np.argmin(found.solved))
    if found.status[row] == Reach.JOINT_RANGE:
        why = f"{', '.join(found.saturated(row))} would have to leave the range"
    else:
        why = f"{found.position[row]:.3g} mm and {found.rotation[row]:.3g} rad are left"
    raise InputError(
        f"{table.file}: row {rows[row] + 1}: found a pose that the nominal machine cannot take ({why}), "
        "expected one within reach"
    )


MANY = 10_000
"""Rows from which a table is written by columns."""


def csv_text(frame: pd.DataFrame) -> str:
    """A table as CSV, floats at full precision; what is long, by columns."""
    if len(frame) >= MANY and all(_is_plain(frame[name]) for name in frame):
        stream = io.BytesIO()
        header = frame.head(0).to_csv(index=False, lineterminator="\n")
        try:
            table = pa.Table.from_pandas(frame, preserve_index=False)
            pacsv.write_csv(table, stream, pacsv.WriteOptions(include_header=False, quoting_style="none"))
            return header + stream.getvalue().decode()
        except pa.ArrowException:
            pass  # a text with a comma in it, or cells of several kinds
    return str(frame.to_csv(index=False, lineterminator="\n"))


def _is_plain(column: pd.Series[Any]) -> bool:
    return column.dtype in (np.float64, np.int64, np.object_) or isinstance(column.dtype, pd.StringDtype)


ROUNDING = 1e-12
"""Largest difference of a reading, as a share of it: a file has all digits of a double, and degrees are converted and back."""


def check_commands(file: Path, machine: Machine, command: Array, name: str) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a path's file holds the readings ``command`` (n, nq), mm and rad."""
    try:
        found = load_path(machine, file)[1].q.copy()
    except InputError as exc:
        told = str(exc).replace(f"{file}: ", "")
        raise ReadBackError(f"{name}: what was to be written cannot be read: {told}") from exc
    if found.shape != command.shape:
        raise ReadBackError(f"{name}: what was to be written has {len(found)} rows, expected {len(command)}")
    for k, joint in enumerate(joint_columns(machine)):
        found[:, k] += whole_turns(joint, command[:, k] - found[:, k])
    same = np.isclose(found, command, rtol=ROUNDING, atol=ROUNDING)
    if not same.all():
        row, k = np.argwhere(~same)[0]
        raise ReadBackError(
            f"{name}: what was to be written reads as another path: row {row + 1}: {machine.mechanism.readings[k]} is "
            f"{float(found[row, k])!r}, expected {float(command[row, k])!r} (mm, rad)"
        )
