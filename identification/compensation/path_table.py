"""A path to follow as a table: nominal joint values, or poses of the tool that nominal joints are solved for.

Poses stand in the nominal frame of the base, as in the generated C: columns x y z and the rotation vector rx ry rz, or the
same behind ``pose.``.

What is written is read back before it is published: it must hold the joints that were solved for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from truepose.arrays import Array, Index
from truepose.errors import InputError, ReadBackError
from truepose.identification.compensation.compensate import (
    BLOCK,
    Compensation,
    ideal_constants,
    twists_between,
)
from truepose.identification.compensation.inverse import (
    Inverse,
    PoseSolver,
    Reach,
    base_frame,
)
from truepose.identification.recording.joint_readings import JointColumn, column_unit, unfold_readings
from truepose.identification.recording.load import joint_columns
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import Table
from truepose.models import lie
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXIS_UNITS as POSE
from truepose.models.units import convert
from truepose.wording import close_matches


def path_rows(machine: Machine, table: Table) -> tuple[Table, Recording]:
    """A path's table with a column for every joint, and its rows.

    Raises InputError naming file, row and column: neither joints nor poses, a pose out of the nominal machine's
    reach, a joint out of its range.
    """
    joints = machine.mechanism.readings
    poses = _pose_columns(table, joints)
    notes: tuple[str, ...] = ()
    if poses:
        table, notes = _with_joints(machine, table, poses)
    for name in joints:
        if name not in table:
            raise InputError(
                f"{table.file}: missing column {name!r}, expected the joints {', '.join(joints)}, or the tool's poses in "
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
    headers = {c.name: c.header for c in table.columns}
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
    """(n, nq) readings of the machine with nominal links at poses (n, 4, 4) in the nominal frame of the base."""
    q = np.zeros((len(poses), len(solver.machine.mechanism.readings)))
    for start in range(0, len(poses), BLOCK):
        part = np.arange(start, min(start + BLOCK, len(poses)))
        found = solver.inverse(base_frame(solver.machine) @ poses[part])
        _check_reach(table, part, found)
        q[part] = found.q
    return q


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


ROUNDING = 1e-12
"""Largest difference of a reading, as a share of it: a file has all digits of a double, and degrees are converted and back."""


def check_commands(table: Table, machine: Machine, command: Array, name: str) -> None:
    """Raise ReadBackError, which ``name`` opens, unless a table holds the readings ``command`` (n, nq), mm and rad."""
    try:
        found = path_rows(machine, table)[1].q.copy()
    except InputError as exc:
        told = str(exc).replace(f"{table.file}: ", "")
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
