"""A machine as it is shown: its mechanism, joints, sensors and constants, in the units of its file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from functools import partial

import numpy as np
import pandas as pd

from truepose.arrays import Array
from truepose.errors import TrueposeError
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator, element_of
from truepose.models.machine.skeleton import Kind, at_home
from truepose.models.units import convert
from truepose.shown.chart import Axis, Chart, Line, Tone
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame
from truepose.wording import joined, shortened

MOST = 8
_TURN, _RISE = np.radians(-35.0), np.radians(20.0)
_SHOWN: dict[str, tuple[Tone, tuple[Kind, ...]]] = {
    "links": ("ink", ("link", "plate", "rail")),
    "legs": ("after", ("leg",)),
    "tool": ("before", ("tool",)),
}
HEIGHT, PLOT = 300.0, (320.0, 240.0)
"""Of the chart, and of what its axes leave, about, in pixels: a millimetre is as long upwards as across."""


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
        charts=partial(sketch, machine),
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


def sketch(machine: Machine) -> list[Chart]:
    """Links, legs and tool; nothing where the machine cannot be assembled at home."""
    try:
        ends = segments(machine)
    except TrueposeError:
        return []
    seen = {name: _seen(found) for name, found in ends.items() if len(found)}
    if not seen:
        return []
    every = np.concatenate(list(seen.values())).reshape(-1, 2)
    low, high = every.min(axis=0), every.max(axis=0)
    scale = max(float(np.max((high - low) / PLOT)), 1e-9)
    (x, y), (wide, tall) = 0.5 * (low + high), (0.55 * scale * size for size in PLOT)
    layers = []
    for name, lines in seen.items():
        broken = np.insert(lines, 2, np.nan, axis=1).reshape(-1, 2)
        layers.append(Line(broken[:, 0], broken[:, 1], _SHOWN[name][0], name))
    axes = Axis("across [mm]", x - wide, x + wide), Axis("up [mm]", y - tall, y + tall)
    return [Chart(f"{machine.name} at home", *axes, layers, height=HEIGHT)]


def segments(machine: Machine) -> dict[str, Array]:
    """Ends (k, 2, 3), mm, in the base's frame, of ``links``, ``legs`` and the ``tool`` at the machine's home."""
    found = at_home(machine)
    out = {}
    for name, (_, kinds) in _SHOWN.items():
        pairs = [pair for kind in kinds for line in found.get(kind, []) for pair in _pairs(kind, line)]
        out[name] = np.array(pairs).reshape(-1, 2, 3)
    return out


def _pairs(kind: Kind, line: Array) -> list[Array]:
    """The segments of a line, each once, without those of no length."""
    closed = np.vstack([line, line[:1]]) if kind == "plate" else line
    return [pair for pair in np.stack([closed[:-1], closed[1:]], axis=1) if np.ptp(pair, axis=0).any()]


def _seen(points: Array) -> Array:
    """(k, 2, 2) points as they are seen."""
    x, y, z = np.moveaxis(points, -1, 0)
    across, away = x * np.cos(_TURN) - y * np.sin(_TURN), x * np.sin(_TURN) + y * np.cos(_TURN)
    return np.stack([across, z * np.cos(_RISE) + away * np.sin(_RISE)], axis=-1)
