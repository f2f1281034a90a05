"""The forms without a name that a recording could speak of: the effect ``empirical`` wherever something was varied."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.driver import Driver
from truepose.models.effects.base import PlacedEffect, Settings
from truepose.models.effects.common import sensor_names
from truepose.models.effects.empirical import (
    CURVE,
    FROM,
    LINE,
    LOAD,
    LOAD_CURVE,
    MOMENT,
    MOUNT_CURVE,
    TURNS,
    WIDTH,
    Empirical,
    seen_over,
)
from truepose.models.effects.sights import XYZ, point_names
from truepose.models.machine import FRAMES, Machine

Array = NDArray[np.float64]
SAME = 1e-6
"""Share of a load (N, N m) below which its changes are rounding."""


def empirical_forms(machine: Machine, recording: Recording) -> tuple[PlacedEffect, ...]:
    """Every form over the ranges that the calibration rows saw, all coefficients 0.

    Each joint as a line and as a curve in each source (joints, payload, time, thermometers) and as a product of two
    joints; each mount as a curve in each source that is no joint (in a joint, six motions would be a black box for anything);
    each joint and mount as a curve in the load that it carries (lines of it have names), where the file states weights; each
    sensor of points with a volume that bends.
    """
    seen = _varied(recording)
    joints = [name for name in seen if name in machine.mechanism.readings]
    others = [name for name in seen if name not in joints]
    curves: list[Settings] = [seen_over({name: seen[name]}, CURVE) for name in seen]
    curves += [seen_over({a: seen[a], b: seen[b]}) for a, b in itertools.combinations(joints, 2)]
    lines: list[Settings] = [seen_over({name: seen[name]}, LINE) for name in seen]
    mounts: list[Settings] = [seen_over({name: seen[name]}, MOUNT_CURVE) for name in others]
    effect, out, loads = Empirical(), list[PlacedEffect](), _of_load(machine, recording)
    for (name,) in effect.places(machine):
        if name in sensor_names(machine):
            forms: list[Settings] = [{WIDTH: _reach(machine, recording)}]
        else:
            own = [line for line in lines if f"{FROM}{name}" not in line]
            forms = [*mounts] if name in FRAMES else [*own, *curves]
            forms += loads.get(name, [])
        out += [PlacedEffect.at(effect, machine, (name,), settings) for settings in forms]
    return tuple(out)


def _varied(recording: Recording) -> dict[str, tuple[float, float]]:
    """Ranges of all that was varied: joints, payload, time, thermometers by name, however the file has its columns."""
    seen = {name: ends for name, ends in ranges(recording).items() if ends[1] > ends[0]}
    own = sorted(seen.keys() - set(recording.joints), key=lambda name: (Driver.of(name).thermal, name))
    return {name: seen[name] for name in (*(n for n in recording.joints if n in seen), *own)}


def ranges(recording: Recording) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of joints and of smooth drivers in the calibration rows."""
    rows = ~recording.validation
    columns = recording.columns(smooth=True)
    return {name: (float(np.min(v[rows])), float(np.max(v[rows]))) for name, v in columns.items()}


def _of_load(machine: Machine, recording: Recording) -> dict[str, list[Settings]]:
    """Forms of each joint and mount whose load varies, by the loads (N, N m) at the drawing's geometry."""
    if not machine.loaded:
        return {}
    predictor = Predictor(machine, recording, ports=True)
    x, assembled = predictor.assemble(predictor.model.p_home)
    loads = predictor.loads(predictor.model.p_home, x)
    rows = assembled & ~recording.validation
    out: dict[str, list[Settings]] = {}
    for name in machine.mechanism.readings:
        own = _range(loads[machine.mechanism.actuator(name).displacement][rows])
        if own is not None:
            out[name] = [seen_over({LOAD: own}, LOAD_CURVE)]
    for mount in FRAMES:
        moment = np.array([loads[f"{mount}.motion.{axis}"][rows] for axis in TURNS])
        each, size = _range(moment), _range(np.sqrt(np.sum(moment**2, axis=0)))
        if each is not None and size is not None:
            out[mount] = [seen_over({LOAD: each}, LOAD_CURVE), seen_over({MOMENT: size}, LOAD_CURVE)]
    return out


def _range(load: Array) -> tuple[float, float] | None:
    """Smallest and largest; None where nothing is carried, or always the same."""
    if not len(load) or np.ptp(load) <= SAME * max(float(np.max(np.abs(load))), SAME):
        return None
    return float(np.min(load)), float(np.max(load))


def _reach(machine: Machine, recording: Recording) -> float:
    """The farthest coordinate of any point, mm."""
    columns = [
        f"{point}{axis}" for sensor in machine.sensors for point in point_names(sensor) for axis in XYZ
    ]
    read = [recording.observations[name] for name in columns if name in recording.observations]
    told = [values[np.isfinite(values)] for values in read]  # a lost reading is NaN
    return max((float(np.max(np.abs(values))) for values in told if len(values)), default=1.0) or 1.0


__all__ = ["empirical_forms", "ranges"]
