"""From a machine file to a Machine: builders, sensors and effects found by name, tolerances resolved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from truepose.errors import InputError
from truepose.models.builders.base import builders
from truepose.models.context import BuildContext
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine import FRAMES, Machine, Mass, body_of
from truepose.models.machine_file import EffectSpec, MachineFile, read_machine
from truepose.models.parameters import Parameter
from truepose.models.sensors.base import Sensor, sensors

_XYZ = ("x", "y", "z")


def load_machine(path: Path | str) -> Machine:
    """Read, check and build the machine of a YAML file. Raises InputError naming file and field."""
    return build_machine(read_machine(Path(path)))


def build_machine(file: MachineFile) -> Machine:
    """The machine that a validated file describes."""
    context = BuildContext(file, ("mechanism",))
    mechanism = builders.get(file.mechanism.get("type"), f"{context.where}.type")(file.mechanism, context)
    machine = Machine(
        name=file.name,
        mechanism=mechanism,
        frames=_frames(file),
        sensors=_sensors(file),
        gravity=file.gravity,
        masses=tuple(Mass(m.name, m.kg, m.com, body_of(mechanism, m.in_)) for m in file.masses),
        drivers=file.drivers,
        file=file,
    )
    _check_names(machine, file)
    return replace(machine, effects=tuple(place_effect(machine, spec, f"{file.path}: effects[{k}]") for k, spec in enumerate(file.effects)))


def place_effect(machine: Machine, spec: EffectSpec, where: str) -> PlacedEffect:
    """Bind a machine file's effect entry to its place, with values in the effect's own units."""
    effect = effects.get(spec.effect, where)()
    place = resolve_place(machine, spec.place)
    known = [tuple(p) for p in effect.places(machine)]
    if place not in known and not all((name,) in known for name in place):
        raise InputError(f"{where}.place: found {list(spec.place)}, expected one of {[list(p) for p in known[:20]]}")
    settings = dict(spec.settings)
    coefficients = effect.coefficients(machine, place, settings)
    names = {c.name: c.unit for c in coefficients}
    unknown = [name for name in spec.parameters if name not in names]
    if unknown:
        raise InputError(f"{where}.parameters: found {unknown[0]!r}, expected among {', '.join(names)}")
    values = {name: spec.value(name, unit) for name, unit in names.items() if name in spec.parameters}
    return PlacedEffect.at(effect, machine, place, settings, values)


def resolve_place(machine: Machine, place: tuple[str, ...]) -> tuple[str, ...]:
    """A place as the catalogue names it; a limb and its actuator understand each other's name."""
    return tuple(place)


def _frames(file: MachineFile) -> tuple[Parameter, ...]:
    out = []
    for frame in FRAMES:
        spec = getattr(file.frames, frame)
        for k, axis in enumerate(_XYZ):
            out.append(Parameter(f"{frame}.{axis}", "mm", spec.xyz[k], spec.tolerance.xyz[k], "frame", ("frames", frame, "xyz", k)))
        for k, axis in enumerate(_XYZ):
            out.append(Parameter(f"{frame}.r{axis}", "rad", spec.rpy[k], spec.tolerance.rpy[k], "frame", ("frames", frame, "rpy", k)))
    return tuple(out)


def _sensors(file: MachineFile) -> tuple[Sensor, ...]:
    several = isinstance(file.raw.get("sensor"), list)
    out = []
    for k, section in enumerate(file.sensors):
        context = BuildContext(file, ("sensor", k) if several else ("sensor",))
        out.append(sensors.get(section.get("type"), f"{context.where}.type").build(section, context))
    return tuple(out)


def _check_names(machine: Machine, file: MachineFile) -> None:
    names = [p.name for p in machine.parameters]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"{file.path}: found parameter {twice[0]!r} twice, expected every joint, leg and target to have its own name")
