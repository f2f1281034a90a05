"""A path to follow as a table: nominal joint values, or poses of the tool that nominal joints are solved for.

Poses stand in the nominal frame of the base, as in the generated C: columns x y z and the rotation vector rx ry rz.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.compensation import Compensation, ideal_constants
from truepose.identification.inverse import Inverse, PoseSolver, Reach
from truepose.identification.recording import Recording, read_recording
from truepose.identification.recording_file import JointColumn, joint_unit
from truepose.identification.table import Column, Table, read_table
from truepose.models import lie
from truepose.models.kinematics import symbolic_model
from truepose.models.machine import Machine
from truepose.models.units import UnitSystem, close_matches, convert

Array = NDArray[np.float64]
POSE = {"x": "mm", "y": "mm", "z": "mm", "rx": "rad", "ry": "rad", "rz": "rad"}


def load_path(machine: Machine, path: Path | str) -> tuple[Table, Recording]:
    """The path's table with a column for every joint, and its rows.

    Raises InputError naming file, row and column: neither joints nor poses, a pose out of the nominal machine's
    reach, a joint out of its range.
    """
    table, joints = read_table(path), machine.mechanism.readings
    poses = not any(name in table for name in joints) and all(name in table for name in POSE)
    if poses:
        table = _with_joints(machine, table)
    for name in joints:
        if name not in table:
            raise InputError(
                f"{path}: missing column {name!r}, expected the joints {', '.join(joints)}, or the tool's poses in "
                f"{', '.join(POSE)}; {close_matches(name, table.names)}"
            )
    used = POSE if poses else {}
    return table, read_recording([table], _columns(machine), used, _units(machine), need_readings=False)


def commands(table: Table, machine: Machine, found: Compensation) -> pd.DataFrame:
    """The table with the joints' columns corrected, each in its own unit."""
    corrected = {}
    for k, joint in enumerate(_columns(machine)):
        unit = table.unit(joint.name, joint_unit(joint, _units(machine)), joint.unit)
        corrected[joint.name] = convert(found.command[:, k], joint.unit, unit)
    headers = {c.name: c.name if c.unit is None else f"{c.name} [{c.unit}]" for c in table.columns}
    return pd.DataFrame({header: corrected.get(name, table.cells[name]) for name, header in headers.items()})


def _with_joints(machine: Machine, table: Table) -> Table:
    """The table with nominal joints for its poses."""
    units = _units(machine)
    parts = []
    for name, internal in POSE.items():
        own = {"mm": units.length, "rad": units.angle}[internal]
        parts.append(convert(table.numbers(name), table.unit(name, own, internal), internal))
    poses = np.broadcast_to(np.eye(4), (table.n_rows, 4, 4)).copy()
    poses[:, :3, 3] = np.column_stack(parts[:3])
    poses[:, :3, :3] = lie.exp_so3(np.column_stack(parts[3:]))
    ideal = ideal_constants(machine, symbolic_model(machine, machine.effects))
    found = PoseSolver(machine, ideal).inverse(_base(machine) @ poses)
    _check_reach(table, found)
    columns, cells = list(table.columns), dict(table.cells)
    for k, joint in enumerate(_columns(machine)):
        columns.append(Column(joint.name))
        cells[joint.name] = convert(found.q[:, k], joint.unit, joint_unit(joint, units)).tolist()
    return Table(table.file, tuple(columns), cells, table.n_rows)


def _check_reach(table: Table, found: Inverse) -> None:
    if found.solved.all():
        return
    row = int(np.argmin(found.solved))
    if found.status[row] == Reach.JOINT_RANGE:
        why = f"{', '.join(found.saturated(row))} would have to leave the range"
    else:
        why = f"{found.position[row]:.3g} mm and {found.rotation[row]:.3g} rad are left"
    raise InputError(
        f"{table.file}: row {row + 1}: found a pose that the nominal machine cannot take ({why}), "
        "expected one within reach"
    )


def _base(machine: Machine) -> Array:
    """(4, 4) nominal frame of the base in the sensor's frame, as calibrated."""
    value = {parameter.name: parameter.nominal for parameter in machine.frames}
    out = np.eye(4)
    out[:3, :3] = lie.rpy_matrix(np.array([value[f"base.r{axis}"] for axis in "xyz"]))
    out[:3, 3] = [value[f"base.{axis}"] for axis in "xyz"]
    return out


def _columns(machine: Machine) -> list[JointColumn]:
    return [JointColumn(a.reading, a.reading_unit, a.range) for a in machine.mechanism.actuators]


def _units(machine: Machine) -> UnitSystem:
    return machine.file.units if machine.file else UnitSystem()


__all__ = ["POSE", "commands", "load_path"]
