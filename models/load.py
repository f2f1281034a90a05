"""From a machine file to a Machine: builders, sensors and effects found by name, tolerances resolved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from truepose.errors import InputError
from truepose.files import mixture_notes
from truepose.models.file.effect_entry import EffectSpec
from truepose.models.file.machine_file import MachineFile, read_machine
from truepose.models.file.names import check_text
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.columns import check_column_names, declared_drivers, driver_names
from truepose.models.machine.effect import effects
from truepose.models.machine.kinematics import home_directions
from truepose.models.machine.loads import (
    equipment,
    measured_forces,
    springs,
    weights,
    with_columns,
    with_recordings,
)
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import Mechanism, resolve_couplings
from truepose.models.machine.mounts import frame_parameters, mounts
from truepose.models.machine.placed import Place, PlacedEffect, check_settings
from truepose.models.machine.sensor import Sensor, sensors

DIAGNOSIS = "diagnosis.json"
"""Result beside an ``improved.yaml``, which it knows by its digest."""


def load_machine(path: Path | str) -> Machine:
    """Read, check and build the machine of a YAML file. Raises InputError naming file and field."""
    machine = build_machine(read_machine(Path(path)))
    mixed = mixture_notes(Path(path).with_name(DIAGNOSIS), Path(path).name)
    return replace(machine, notes=(*machine.notes, *mixed)) if mixed else machine


def build_machine(file: MachineFile) -> Machine:
    """The machine that a validated file describes."""
    context = BuildContext(file, ("mechanism",))
    mechanism = builders.get(file.mechanism.get("type"), f"{context.where}.type")(file.mechanism, context)
    mechanism = resolve_couplings(mechanism, file)
    mechanism = replace(mechanism, home_directions=home_directions(mechanism, file))
    masses, gravity, notes = weights(file, mechanism)
    read = _sensors(file, mechanism)
    own = equipment(file, mechanism, read)
    forces, declared = measured_forces(file, mechanism), declared_drivers(file, mechanism)
    machine = Machine(
        name=file.name,
        mechanism=mechanism,
        frames=frame_parameters(file, mechanism),
        sensors=read,
        gravity=gravity,
        masses=masses,
        mounts=mounts(file, mechanism),
        springs=springs(file, mechanism),
        forces=forces,
        equipment=own,
        drivers=driver_names(file, declared),
        file=file,
        notes=notes,
        set_up=tuple(name for name in FRAMES if getattr(file.frames, name).per),
        declared_drivers=with_recordings(with_columns(declared, forces, file), own, masses),
    )
    _check_names(machine, file)
    check_column_names(mechanism.readings, read, machine.declared_drivers, str(file.path))
    _check_task(machine, file)
    placed = [place_effect(machine, e, f"{file.path}: effects[{k}]") for k, e in enumerate(file.effects)]
    _check_once(placed, str(file.path))
    return replace(machine, effects=tuple(placed), notes=(*machine.notes, *_wrong_signs(placed)))


def _check_task(machine: Machine, file: MachineFile) -> None:
    """Refuse a task of more conditions than there are joints that are read."""
    joints = machine.mechanism.readings
    if file.task and len(file.task.rows) > len(joints):
        raise InputError(
            f"{file.path}: task: found {len(file.task.rows)} conditions ({', '.join(file.task.components)}), expected at most "
            f"{len(joints)}, one for each of the joints {', '.join(joints)}"
        )


def _check_once(placed: Sequence[PlacedEffect], path: str) -> None:
    """Raises InputError for an effect that stands twice at one place with the same settings: its names would, too."""
    labels = [e.label for e in placed]
    for k, label in enumerate(labels):
        if label in labels[:k]:
            raise InputError(
                f"{path}: effects[{k}]: found {label}, which is effects[{labels.index(label)}], expected each effect once at "
                "a place"
            )


def _wrong_signs(placed: Sequence[PlacedEffect]) -> list[str]:
    """Notes on what cannot be negative and is: a fit may have found it so by chance, a hand has made a slip."""
    found = [(e, c) for e in placed for c in e.coefficients if c.lower == 0.0 and e.values[c.name] < 0.0]
    return [
        f"{e.label}: {c.name} = {e.values[c.name]:g} {c.unit}, where nothing is below 0" for e, c in found
    ]


def place_effect(machine: Machine, spec: EffectSpec, where: str) -> PlacedEffect:
    """Bind a machine file's effect entry to its place, with values in the effect's own units."""
    effect = effects.get(spec.effect, where)()
    known = [tuple(place) for place in effect.places(machine)]
    place = resolve_place(machine, spec.place, known) if known else tuple(spec.place)
    if known and not _fits(place, known):
        listed = ", ".join(str(list(p)) for p in known[:20])
        raise InputError(f"{where}.place: found {list(spec.place)}, expected one of {listed}")
    settings = dict(spec.settings)
    if effect.setting_ranges is not None:
        check_settings(spec.effect, effect.setting_ranges, settings, where)
    coefficients = effect.coefficients(machine, place, settings)
    names = {c.name: c.unit for c in coefficients}
    unknown = [name for name in spec.parameters if name not in names]
    if unknown:
        raise InputError(f"{where}.parameters: found {unknown[0]!r}, expected among {', '.join(names)}")
    values = {name: spec.value(name, unit) for name, unit in names.items() if name in spec.parameters}
    return PlacedEffect.at(effect, machine, place, settings, values)


def resolve_place(machine: Machine, place: Place, known: Sequence[Place]) -> Place:
    """A place as the catalogue's ``known`` places name it.

    A limb may be called by its actuator's name or ``legN``, an actuator by its limb's; an unknown name stays as it is.
    """
    limbs = machine.mechanism.limbs
    called = {f"leg{k}": limb for k, limb in enumerate(limbs, start=1)}
    called |= {name: limb for limb in limbs for name in (limb.name, limb.reading)}
    names = {name for each in known for name in each}

    def meant(name: str) -> str:
        if name in names or name not in called:
            return name
        limb = called[name]
        return next((alias for alias in (limb.name, limb.reading) if alias in names), name)

    return tuple(meant(name) for name in place)


def _fits(place: Place, known: Sequence[Place]) -> bool:
    """Whether a place is known, or some of the places that a known one joins by one common cause."""
    if place in known:
        return True
    alone = all((name,) in known for name in place)
    return bool(place) and alone and any(set(place) <= set(each) for each in known)


def _sensors(file: MachineFile, mechanism: Mechanism) -> tuple[Sensor, ...]:
    several = isinstance(file.raw.get("sensor"), list)
    out = []
    for k, section in enumerate(file.sensors):
        context = BuildContext(file, ("sensor", k) if several else ("sensor",), mechanism)
        sensor = sensors.get(section.get("type"), f"{context.where}.type").build(section, context)
        _check_points(sensor, context.where)
        for channel in sensor.channels:  # a plug-in may not have checked its own
            if not 0.0 < channel.sigma < math.inf:
                raise InputError(
                    f"{context.where}: found a sigma of {channel.sigma} of {channel.name!r}, "
                    "expected a finite number > 0"
                )
        out.append(sensor)
    return tuple(out)


def _check_points(sensor: Sensor, where: str) -> None:
    """Raise InputError unless channels of kind ``position`` are x, y and z of points: fits take them by three."""
    seen = [channel.point for channel in sensor.channels if channel.kind == "position"]
    for point in dict.fromkeys(seen):
        if seen.count(point) != 3:
            raise InputError(
                f"{where}: found {seen.count(point)} of the three channels of kind position of the point {point!r}, "
                "expected x, y and z; a single length is of kind distance"
            )


def _check_names(machine: Machine, file: MachineFile) -> None:
    names = [p.name for p in machine.parameters]
    for name in (*names, *machine.mechanism.readings, *machine.mechanism.bodies):  # a URDF has its own
        check_text(name, str(file.path))
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(
            f"{file.path}: found parameter {twice[0]!r} twice, "
            "expected every joint, leg and target to have its own name"
        )
    file.tolerances.check(names)
