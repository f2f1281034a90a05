"""The forms without a name that a recording could speak of: the effect ``empirical`` wherever something was varied."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.driver import TIME, Driver
from truepose.models.effects.base import PlacedEffect, Settings
from truepose.models.effects.common import sensor_names
from truepose.models.effects.empirical import (
    CURVE,
    FROM,
    LINE,
    LOAD,
    LOAD_CURVE,
    MOUNT_CURVE,
    TURNS,
    WIDTH,
    Empirical,
    seen_over,
)
from truepose.models.effects.sights import XYZ, point_names
from truepose.models.machine import FRAMES, PAYLOAD, Machine

Array = NDArray[np.float64]
SAME = 1e-6
"""Share of a load (N, N m) below which its changes are rounding."""


def empirical_forms(machine: Machine, recording: Recording) -> tuple[PlacedEffect, ...]:
    """Every form over the ranges that the calibration rows saw, all coefficients 0.

    Each joint as a line and as a curve in each source (joints, payload, time, thermometers) and as a product of two
    joints; each mount as a curve in each source that is no joint (in a joint, six motions would be a black box for anything);
    each joint and mount as a curve in the load that it carries (a joint's line has a name), where the file states weights; each
    sensor of points with a volume that bends.
    """
    seen = _seen(machine, recording)
    joints = [name for name in seen if name in machine.mechanism.readings]
    others = [name for name in seen if name not in joints]
    curves: list[Settings] = [seen_over({name: seen[name]}, CURVE) for name in seen]
    curves += [seen_over({a: seen[a], b: seen[b]}) for a, b in itertools.combinations(joints, 2)]
    lines: list[Settings] = [seen_over({name: seen[name]}, LINE) for name in seen]
    mounts: list[Settings] = [seen_over({name: seen[name]}, MOUNT_CURVE) for name in others]
    effect, out, loads = Empirical(), list[PlacedEffect](), _loads(machine, recording)
    for (name,) in effect.places(machine):
        if name in sensor_names(machine):
            forms: list[Settings] = [{WIDTH: _reach(machine, recording)}]
        else:
            own = [line for line in lines if f"{FROM}{name}" not in line]
            forms = [*mounts] if name in FRAMES else [*own, *curves]
            if name in loads:
                degrees = (LINE, LOAD_CURVE) if name in FRAMES else (LOAD_CURVE,)
                forms += [seen_over({LOAD: loads[name]}, degree) for degree in degrees]
        out += [PlacedEffect.at(effect, machine, (name,), settings) for settings in forms]
    return tuple(out)


def _seen(machine: Machine, recording: Recording) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of all that was varied, joints first."""
    rows = ~recording.validation
    columns = {name: recording.q[rows, k] for k, name in enumerate(recording.joints)}
    for name in (PAYLOAD, TIME, *sorted(n for n in recording.drivers if Driver.of(n).thermal)):
        values = recording.driver(name)
        if values is not None:
            columns[name] = values[rows]
    return {
        name: (float(np.min(values)), float(np.max(values)))
        for name, values in columns.items()
        if np.ptp(values) > 0
    }


def _loads(machine: Machine, recording: Recording) -> dict[str, tuple[float, float]]:
    """Smallest and largest load of each joint and mount where it varies, N or N m, at the drawing's geometry."""
    if not machine.loaded:
        return {}
    predictor = Predictor(machine, recording, ports=True)
    x, assembled = predictor.assemble(predictor.model.p_home)
    loads = predictor.loads(predictor.model.p_home, x)
    rows = assembled & ~recording.validation
    ports: dict[str, tuple[str, ...]] = {
        name: (machine.mechanism.actuator(name).displacement,) for name in machine.mechanism.readings
    }
    ports |= {mount: tuple(f"{mount}.motion.{axis}" for axis in TURNS) for mount in FRAMES}
    return {name: own for name, at in ports.items() if (own := _range(loads, at, rows)) is not None}


def _range(
    loads: Mapping[str, Array], ports: tuple[str, ...], rows: NDArray[np.bool_]
) -> tuple[float, float] | None:
    """Of all these loads together; None where nothing is carried, or always the same."""
    values = np.concatenate([loads[port][rows] for port in ports])
    if not len(values) or np.ptp(values) <= SAME * max(float(np.max(np.abs(values))), SAME):
        return None
    return float(np.min(values)), float(np.max(values))


def _reach(machine: Machine, recording: Recording) -> float:
    """The farthest coordinate of any point, mm."""
    columns = [
        f"{point}{axis}" for sensor in machine.sensors for point in point_names(sensor) for axis in XYZ
    ]
    read = [recording.observations[name] for name in columns if name in recording.observations]
    return max((float(np.max(np.abs(values))) for values in read if len(values)), default=1.0) or 1.0


__all__ = ["empirical_forms"]
