"""Measured forces of a machine file, on what they push at, with the columns that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from truepose.errors import InputError
from truepose.models.file.driver import DeclaredDriver, Driver
from truepose.models.file.force_section import FORCE
from truepose.models.file.machine_file import MachineFile
from truepose.models.machine.machine import MeasuredForce, body_of
from truepose.models.machine.mechanism import Mechanism
from truepose.models.units import compatible
from truepose.wording import close_matches


def measured_forces(file: MachineFile, mechanism: Mechanism) -> tuple[MeasuredForce, ...]:
    """Checked against the mechanism. Raises InputError for an unknown frame, and for a column that is a joint's."""
    out = []
    for name, section in file.forces.items():
        where = f"{file.path}: forces.{name}"
        for column in section.columns:
            if column in mechanism.readings:
                raise InputError(
                    f"{where}.columns: found {column!r}, a joint, expected a column of a force sensor"
                )
        body = _frame(section.in_, f"{where}.in", file, mechanism)
        axes = body if section.axes is None else _frame(section.axes, f"{where}.axes", file, mechanism)
        out.append(MeasuredForce(name, section.columns, body, section.at, axes, float(section.sign)))
    return tuple(out)


def _frame(name: str, where: str, file: MachineFile, mechanism: Mechanism) -> str:
    further = [own for own, frame in file.frames.further.items() if frame.in_ != "world"]
    body = name if name in further else body_of(mechanism, name)
    if body is None:
        hint = close_matches(name, ("tool", "base", "flange", *further, *mechanism.bodies))
        raise InputError(f"{where}: found {name!r}, expected a body, or a frame that one carries; {hint}")
    if name in mechanism.table_frames:
        raise InputError(
            f"{where}: found {name!r}, a link of a standard table, expected `tool`, `base`, `flange` or a frame of `frames`"
        )
    return body


def with_columns(
    declared: Sequence[DeclaredDriver], forces: Sequence[MeasuredForce], file: MachineFile
) -> tuple[DeclaredDriver, ...]:
    """All declared drivers, and the columns of forces among them: N, and N m of moments, where nothing else is written.

    Raises InputError for a column that is declared in another unit.
    """
    out = {driver.name: driver for driver in declared}
    for force in forces:
        for k, column in enumerate(force.columns):
            unit = "N" if k < FORCE else "N*m"
            own = out.get(column)
            written = (own.written if own else Driver.of(column).unit({})) or unit
            if not compatible(written, unit):
                raise InputError(
                    f"{file.path}: forces.{force.name}.columns: found {column!r} in {written!r}, expected a unit of "
                    f"{'forces' if k < FORCE else 'moments'} such as {unit}"
                )
            known = own or DeclaredDriver(column, unit, written, "load")
            out[column] = replace(known, unit=unit, written=written, absent=0.0)
    return tuple(out.values())
