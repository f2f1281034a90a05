"""What recordings were measured with, where the machine file's section ``recordings`` says so: their own tool and payload.

A driver ``recording.NAME`` is 1 in their rows and 0 in all others, so that one model holds all tools and payloads.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import casadi as ca

from truepose.errors import InputError
from truepose.models import lie
from truepose.models.file.driver import PAYLOAD, DeclaredDriver
from truepose.models.file.machine_file import MachineFile, MassSpec
from truepose.models.file.recording_section import OwnPayload
from truepose.models.machine.machine import Equipment, Machine, Mass
from truepose.models.machine.mechanism import Mechanism
from truepose.models.machine.moments import seconds_since_1970
from truepose.models.machine.sensor import TOOL, Sensor
from truepose.models.machine.weights import mass_of

_NAME = re.compile(r"[A-Za-z_][\w-]*")


def equipment(file: MachineFile, mechanism: Mechanism, sensors: tuple[Sensor, ...]) -> tuple[Equipment, ...]:
    """Of every entry. Raises InputError for a bad name, an unknown body, and a sensor that no tool moves."""
    out = []
    for name, section in file.recordings.items():
        where = f"{file.path}: recordings.{name}"
        if not _NAME.fullmatch(name):
            raise InputError(f"{where}: found a name {name!r}, expected one of letters, digits, - and _")
        if section.tool and any(set(TOOL) & set(sensor.reads) for sensor in sensors):
            raise InputError(
                f"{where}.tool: found one beside a sensor on the flange, expected none: no tool moves what it reads"
            )
        own = section.tool
        mass = None if section.payload is None else _payload(name, section.payload, mechanism, file)
        out.append(
            Equipment(
                name=name,
                files=section.files,
                sessions=section.sessions,
                tool=None if own is None else (*own.xyz, *own.rpy),
                on_tool=own is not None and own.in_ == "tool",
                mass=mass,
                date=None if section.date is None else seconds_since_1970(section.date),
            )
        )
    return tuple(out)


def _payload(name: str, stated: OwnPayload, mechanism: Mechanism, file: MachineFile) -> Mass:
    known = stated.tolerance
    spec = MassSpec(f"{name}.{PAYLOAD}", stated.kg, stated.com, stated.in_, known.kg, known.com)
    return mass_of(mechanism, spec, file, ("recordings", name, PAYLOAD))


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
    axes = lie.rpy_transform([ca.SX(0)] * 3, [values[name] for name in TOOL[3:]])[:3, :3]
    for own in machine.equipment:
        if own.tool is None:
            continue
        here = z[own.driver]
        if own.on_tool:
            moved = ca.vertsplit(axes @ ca.DM(own.tool[:3]))
            out |= {name: out[name] + here * move for name, move in zip(TOOL[:3], moved, strict=True)}
        else:
            away = zip(TOOL, own.tool, strict=True)
            out |= {name: out[name] + here * (stands - values[name]) for name, stands in away}
    return out
