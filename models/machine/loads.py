"""What pulls at a machine, as its file states it: masses, springs, measured forces, and what single recordings carry."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca

from truepose.errors import InputError
from truepose.models import lie
from truepose.models.file.driver import PAYLOAD, DeclaredDriver, Driver
from truepose.models.file.machine_file import MachineFile
from truepose.models.file.sections import FORCE, MassSection
from truepose.models.machine.builder import BuildContext
from truepose.models.machine.machine import Equipment, Machine, Mass, MeasuredForce, Spring, body_of
from truepose.models.machine.mechanism import Mechanism
from truepose.models.machine.sensor import TOOL_POSE, Sensor
from truepose.models.units import compatible
from truepose.wording import close_matches

Triple = tuple[float, float, float]


def weights(
    file: MachineFile, mechanism: Mechanism
) -> tuple[tuple[Mass, ...], Triple | None, tuple[str, ...]]:
    """Masses, gravity (m/s^2, base frame) and notes on what did not come from the file.

    What the file states wins: any mass but the payload, or an empty ``masses:``, stands in place of all inertials, and
    ``gravity:`` in place of the description's. Raises InputError for a mass on an unknown body.
    """
    stated = tuple(mass_of(mechanism, n, mass, file, ("masses", n)) for n, mass in file.masses.items())
    own = "masses" in file.raw and (not stated or any(mass.name != PAYLOAD for mass in stated))
    if own or not mechanism.inertials:
        return stated, file.gravity, ()
    read = tuple(
        Mass(f"{i.body}_link" if i.body == PAYLOAD else i.body, i.kg, i.com, i.body)
        for i in mechanism.inertials
    )
    gravity = file.gravity if "gravity" in file.raw else mechanism.gravity
    of_file = (_note(file, read, gravity),) if "file" in file.mechanism else ()
    return (*read, *stated), gravity, (*of_file, *mechanism.notes)


def _note(file: MachineFile, read: tuple[Mass, ...], gravity: Triple | None) -> str:
    total = math.fsum(mass.kg for mass in read)
    source = file.mechanism.get("file", "the mechanism's description")
    text = f"{file.path}: {len(read)} masses, {total:.4g} kg together, were read from {source}"
    if "gravity" in file.raw or gravity is None:
        return text
    values = ", ".join(f"{value + 0.0:.6g}" for value in gravity)
    return f"{text}; gravity [{values}] is that of its root link standing upright: state `gravity:` if it does not"


def mass_of(
    mechanism: Mechanism, name: str, mass: MassSection, file: MachineFile, field: tuple[str | int, ...]
) -> Mass:
    """A mass that the file states in ``field``. Raises InputError for an unknown body."""
    context = BuildContext(file, field)
    body, com = _point(mass.in_, mass.com, context.where, file, mechanism)
    if mass.is_known:
        return Mass(name, mass.kg, com, body)
    known = mass.tolerance
    if mass.in_ in mechanism.table_frames and any(known.com):
        raise InputError(
            f"{context.where}.tolerance.com: found one of a mass on a link of a standard table, expected "
            "the table in the modified convention, whose links have the frames of their joints"
        )
    weight = context.parameter(f"{name}.kg", "kg", mass.kg, ("kg",), "mass", known.kg)
    centre = context.vector(name, com, ("com",), "centre", known.com)
    return Mass(name, mass.kg, com, body, (weight, *centre))


def _point(name: str, at: Triple, where: str, file: MachineFile, mechanism: Mechanism) -> tuple[str, Triple]:
    """The body or further frame that ``name`` means, and a point in its own frame, mm. Raises InputError for an unknown one."""
    body = name if name in file.frames.further else body_of(mechanism, name)
    if body is None:
        hint = close_matches(name, (*mechanism.bodies, "flange", "tool", *file.frames.further))
        raise InputError(f"{where}.in: found {name!r}, expected a body; {hint}")
    if body not in mechanism.table_frames:
        return body, at
    a, alpha = mechanism.table_frames[body]
    x, y, z = at
    c, s = math.cos(alpha), math.sin(alpha)
    return body, (a + x, c * y - s * z, s * y + c * z)


_UNITS = {"force": "N", "stiffness": "N/mm", "free_length": "mm"}


def springs(file: MachineFile, mechanism: Mechanism) -> tuple[Spring, ...]:
    """Checked against the mechanism. Raises InputError for an unknown body, and for two ends on one."""
    out = []
    for name, section in file.loads.items():
        context = BuildContext(file, ("loads", name))
        first, second = (
            _point(end.in_, end.at, f"{context.where}.{key}", file, mechanism)
            for key, end in (("from", section.from_), ("to", section.to))
        )
        if first[0] == second[0]:
            raise InputError(
                f"{context.where}: found both ends in {first[0]!r}, expected two bodies that move against each other"
            )
        constants = {key: float(getattr(section, key)) for key in _UNITS}
        stated = {key: float(getattr(section.tolerance, key)) for key in _UNITS}
        parameters = [
            context.parameter(f"{name}.{key}", unit, constants[key], (key,), "spring", stated[key])
            for key, unit in (_UNITS.items() if any(stated.values()) else ())
        ]
        out.append(Spring(name, (first, second), constants, tuple(parameters)))
    return tuple(out)


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


def seconds_since_1970(moment: datetime.datetime) -> float:
    """Return a date in s; one without a zone is taken as UTC, whatever the zone of this computer."""
    zone = moment.tzinfo or datetime.UTC
    return moment.replace(tzinfo=zone).timestamp()


_NAME = re.compile(r"[A-Za-z_][\w-]*")


def equipment(file: MachineFile, mechanism: Mechanism, sensors: tuple[Sensor, ...]) -> tuple[Equipment, ...]:
    """Of every entry. Raises InputError for a bad name, an unknown body, and a sensor that no tool moves."""
    out = []
    for name, section in file.recordings.items():
        where = f"{file.path}: recordings.{name}"
        if not _NAME.fullmatch(name):
            raise InputError(f"{where}: found a name {name!r}, expected one of letters, digits, - and _")
        if section.tool and any(set(TOOL_POSE) & set(sensor.reads) for sensor in sensors):
            raise InputError(
                f"{where}.tool: found one beside a sensor on the flange, expected none: no tool moves what it reads"
            )
        own, payload, field = section.tool, section.payload, ("recordings", name, PAYLOAD)
        out.append(
            Equipment(
                name=name,
                files=section.files,
                sessions=section.sessions,
                tool=None if own is None else (*own.xyz, *own.rpy),
                on_tool=own is not None and own.in_ == "tool",
                mass=mass_of(mechanism, f"{name}.{PAYLOAD}", payload, file, field) if payload else None,
                date=None if section.date is None else seconds_since_1970(section.date),
            )
        )
    return tuple(out)


def with_recordings(
    declared: Sequence[DeclaredDriver], own: Sequence[Equipment], masses: Sequence[Mass]
) -> tuple[DeclaredDriver, ...]:
    """All declared drivers, and those that tell recordings apart.

    Beside payloads of their own a column `payload` is that of the other files: those without it carry the file's.
    """
    out = {driver.name: driver for driver in declared}
    for each in own:
        out[each.driver] = DeclaredDriver(each.driver, "1", "1", "session", absent=0.0)
    nominal = next((mass.kg for mass in masses if mass.name == PAYLOAD), 0.0)
    if any(each.mass is not None for each in own):
        known = out.get(PAYLOAD, DeclaredDriver(PAYLOAD, "kg", "kg", "load"))
        out[PAYLOAD] = replace(known, absent=nominal)
    return tuple(out.values())


def with_own_tools(machine: Machine, values: Mapping[str, ca.SX], z: Mapping[str, ca.SX]) -> dict[str, ca.SX]:
    """Values of parameters and ports by name, those of the tool's frame as the row's recording has them.

    A tool that stands in another's frame moves along the axes of ``frames.tool``, wherever those turn out to be.
    """
    out = dict(values)
    axes = lie.rpy_transform([ca.SX(0)] * 3, [values[name] for name in TOOL_POSE[3:]])[:3, :3]
    for own in machine.equipment:
        if own.tool is None:
            continue
        here = z[own.driver]
        if own.on_tool:
            moved = ca.vertsplit(axes @ ca.DM(own.tool[:3]))
            out |= {name: out[name] + here * move for name, move in zip(TOOL_POSE[:3], moved, strict=True)}
        else:
            away = zip(TOOL_POSE, own.tool, strict=True)
            out |= {name: out[name] + here * (stands - values[name]) for name, stands in away}
    return out
