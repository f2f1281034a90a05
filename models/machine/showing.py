"""A machine as it is shown: its mechanism, joints, sensors and constants, in the units of its file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence

import pandas as pd

from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator, element_of
from truepose.models.units import convert
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame
from truepose.wording import joined, shortened

MOST = 8


@document.register
def _document(machine: Machine) -> Document:
    """What it is, what measures it, how many constants are free, what else acts on it."""
    parameters = machine.parameters
    free = [p for p in parameters if p.free]
    kind = str(machine.file.mechanism.get("type", "")) if machine.file else ""
    actuators = machine.mechanism.actuators
    seen = joined([sensor.type for sensor in machine.sensors]) or "no sensor"
    facts = [
        *_sensor_facts(machine),
        f"free: {_grouped([p.name for p in free]) or 'nothing'}",
        *_physics_facts(machine),
        *([f"file: {machine.file.path}"] if machine.file else []),
    ]
    rows = [_joint_row(machine, actuator) for actuator in actuators]
    return Document(
        f"Machine {machine.name}",
        f"Machine {machine.name}: {kind or 'mechanism'} with {len(actuators)} joints, sensor {seen}; "
        f"{len(parameters)} constants, {len(free)} of them free",
        summary=[Items(facts), Table(["joint", "kind", "range", "unit"], rows)],
        more="to_frame() has every constant",
    )


@frame.register
def _frame(machine: Machine) -> pd.DataFrame:
    """Constants, one a row (see ``Machine.to_frame``)."""
    drawing = machine.file.nominal if machine.file else {}
    rows = [
        (p.name, p.nominal, drawing.get(p.name, p.nominal), p.unit, p.tolerance, p.free)
        for p in machine.parameters
    ]
    for effect in machine.effects:
        rows += [
            (name, value, math.nan, c.unit, math.nan, True)
            for name, value, c in zip(
                effect.parameter_names, effect.amplitudes, effect.coefficients, strict=True
            )
        ]
    return pd.DataFrame(rows, columns=["parameter", "value", "nominal", "unit", "tolerance", "free"])


def _sensor_facts(machine: Machine) -> list[str]:
    out = []
    for sensor in machine.sensors:
        sigmas = {
            f"{channel.kind} {_number(channel.sigma, channel.unit, machine)}" for channel in sensor.channels
        }
        columns = shortened([*sensor.columns, *sensor.label_columns], MOST)
        out.append(f"{sensor.type} reads {columns or 'nothing'}; 1-sigma of {joined(sorted(sigmas))}")
    return out


def _physics_facts(machine: Machine) -> list[str]:
    out = []
    if machine.gravity is None:
        out.append("gravity: not stated, so that nothing bends under weight")
    else:
        masses = [f"{mass.name} {mass.kg:g} kg" for mass in machine.masses]
        weighed = f"; masses: {shortened(masses, MOST)}" if masses else "; no masses stated"
        out.append(f"gravity: {joined([f'{g:g}' for g in machine.gravity])} m/s^2{weighed}")
    labels = [effect.label for effect in machine.effects]
    out.append(f"effects: {shortened(labels, MOST) or 'none'}")
    if machine.file and machine.file.nominal:
        out.append("the file is a calibrated one: it holds the drawing beside its constants")
    return out


def _joint_row(machine: Machine, actuator: Actuator) -> tuple[str, ...]:
    kinds = {joint.name: joint.kind for joint in machine.mechanism.joints}
    unit = machine.column_unit(actuator.reading)

    def written(value: float) -> str:
        return f"{convert(value, actuator.reading_unit, unit):.6g}"

    ends = "" if actuator.range is None else " .. ".join(written(end) for end in actuator.range)
    return actuator.reading, kinds.get(actuator.drives, "leg"), ends, unit


def _grouped(names: Sequence[str]) -> str:
    """How many of each part: ``leg1 7, leg2 7, base 6``."""
    counts = Counter(element_of(name) for name in names)
    return shortened([f"{part} {count}" for part, count in counts.items()], 2 * MOST)


def _number(value: float, unit: str, machine: Machine) -> str:
    written = machine.units.written(unit)
    return f"{convert(value, unit, written):.3g} {written}"
