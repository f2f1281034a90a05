"""Forms without a name in the load that a joint or a mount carries, or in what a joint's drive was measured to hold."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from truepose.arrays import Array
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import Settings
from truepose.models.effects.empirical import LOAD, LOAD_CURVE, MOMENT, TURNS, seen_over
from truepose.models.file.driver import MEASURED_LOADS, Driver
from truepose.models.machine.machine import FRAMES, Machine

SAME = 1e-6
"""Share of a load (N, N m) below which its changes are rounding."""


def forms_of_load(machine: Machine, recording: Recording) -> dict[str, list[Settings]]:
    """Forms of each joint and mount whose load varies, by the loads (N, N m) at the drawing's geometry."""
    if not machine.loaded:
        return {}
    predictor = Predictor(machine, recording, ports=True)
    x, assembled = predictor.assemble(predictor.model.p_home)
    joints = {name: machine.mechanism.actuator(name).displacement for name in machine.mechanism.readings}
    moments = {mount: [f"{mount}.motion.{axis}" for axis in TURNS] for mount in FRAMES}
    ports = [*joints.values(), *(port for own in moments.values() for port in own)]
    loads = predictor.loads_at(ports, predictor.model.p_home, x)
    rows = assembled & ~recording.validation
    out: dict[str, list[Settings]] = {}
    for name, port in joints.items():
        own = _range(loads[port][rows])
        if own is not None:
            out[name] = [seen_over({LOAD: own}, LOAD_CURVE)]
    for mount, axes in moments.items():
        moment = np.array([loads[port][rows] for port in axes])
        each, size = _range(moment), _range(np.sqrt(np.sum(moment**2, axis=0)))
        if each is not None and size is not None:
            out[mount] = [seen_over({LOAD: each}, LOAD_CURVE), seen_over({MOMENT: size}, LOAD_CURVE)]
    return out


def forms_of_held_load(
    machine: Machine, recording: Recording, seen: Collection[str]
) -> dict[str, list[Settings]]:
    """Forms of each joint in the torque or current of its own drive, where it was recorded and is not among those ``seen``."""
    rows, out = ~recording.validation, dict[str, list[Settings]]()
    for name, values in recording.drivers.items():
        driver, own = Driver.of(name), _range(values[rows])
        if (
            name not in seen
            and driver.kind in MEASURED_LOADS
            and driver.place in machine.mechanism.readings
            and own is not None
        ):
            out.setdefault(driver.place, []).append(seen_over({name: own}, LOAD_CURVE))
    return out


def _range(load: Array) -> tuple[float, float] | None:
    """Smallest and largest; None where nothing is carried, or always the same."""
    if not len(load) or np.ptp(load) <= SAME * max(float(np.max(np.abs(load))), SAME):
        return None
    return float(np.min(load)), float(np.max(load))


__all__ = ["forms_of_held_load", "forms_of_load"]
