"""Effects at work: placed on a machine, its model solved with them, and what they do to its ports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from support.effect_machines import READINGS
from truepose.arrays import Array
from truepose.models.effects.base import Place, PlacedEffect, Settings, Site, effects
from truepose.models.machine.assembly import load_scale
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine

DRIVERS = {"time": 5000.0, "payload": 4.0, "temperature": 27.0, "approach": -1.0, "session": 1.0}
DRIVERS |= {
    "stop": 0.1,
    "loop": -0.1,
    "creep": 0.2,
    "velocity": 0.3,
    "pressure": 985.0,
    "step": 0.2,
    "heat": 0.4,
}


@dataclass(frozen=True)
class Campaign:
    """A recording as effects see it: two hours, three sessions, these columns."""

    columns: tuple[str, ...] = ("time", "temperature", "approach", "session", "velocity", "pressure")
    n_sessions: int = 3

    def driver(self, name: str) -> object | None:
        if name.split(".", maxsplit=1)[0] not in self.columns and name not in self.columns:
            return None
        return np.linspace(100.0, 7300.0, 5) if name == "time" else np.full(5, 21.0)

    def inferred(self, name: str) -> bool:
        return False


AT_REST = Campaign(tuple(name for name in Campaign.columns if name != "velocity"))
"""The same, with joints that stood when they were read."""


class Solved:
    """A symbolic model at one configuration; Newton closes the loops.

    jacobian (12 + k, np): of the pose, row by row of its 3 x 4, and of the k columns of the sensors. Loads are by
    case, states by name.
    """

    def __init__(self, model: SymbolicModel, q: Sequence[float] | Array, **drivers: float) -> None:
        m, self.model = model, model
        given = DRIVERS | drivers
        z = [given.get(name, given.get(name.split(".")[0], 0.0)) for name in model.drivers]
        at = [np.array(q), np.array(z), model.p_home]
        x, inputs = model.home, [m.x, m.q, m.z, m.p]
        flat = ca.vertcat(ca.vec(m.pose[:3, :]), seen_readings(model))
        g = ca.Function("g", inputs, [m.closure, ca.jacobian(m.closure, m.x), ca.jacobian(m.closure, m.p)])
        f = ca.Function("f", inputs, [m.pose, ca.jacobian(flat, m.x), ca.jacobian(flat, m.p), flat[12:]])
        for _ in range(12 if len(x) else 0):
            residual, gx, _ = (np.array(v) for v in g(x, *at))
            x = x - np.linalg.solve(gx, residual)[:, 0]
        _, gx, gp = (np.array(v) for v in g(x, *at))
        xp = -np.linalg.solve(gx, gp) if len(x) else np.zeros((0, len(model.names)))
        self.pose, fx, fp, readings = (np.array(v) for v in f(x, *at))
        self.jacobian: Array = fx @ xp + fp
        self.readings: Array = readings[:, 0]
        self.load: dict[str, float] = {}
        for case, energy in m.energies.items():
            e = ca.Function("e", inputs, [ca.jacobian(energy, m.x), ca.jacobian(energy, m.p)])
            ex, ep = (np.array(v) for v in e(x, *at))
            names = [f"{case}{name}" for name in model.names]
            self.load |= dict(zip(names, -(ex @ xp + ep)[0], strict=True))
        seen = ca.Function("states", inputs, [ca.vertcat(ca.SX(0, 1), *m.states.values())])
        self.states = dict(zip(m.states, np.array(seen(x, *at))[:, 0], strict=True))

    @property
    def position(self) -> Array:
        return np.asarray(self.pose[:3, 3])


def seen_readings(model: SymbolicModel) -> ca.SX:
    """(k,) what the columns of all sensors should read, with what effects add."""
    p = dict(zip(model.names, ca.vertsplit(model.p), strict=True))
    parts = [
        sensor.predict(model.world, {n: p[n] for n in (*(q.name for q in sensor.parameters), *sensor.reads)})
        for sensor in model.machine.sensors
    ]
    return ca.vertcat(*parts) + model.reading_shift


def candidates(machine: Machine, slug: str) -> list[PlacedEffect]:
    """The effect at every place with every setting (of long lists, the first and the last two)."""
    effect, out = effects.get(slug, "test")(), []
    for place in effect.places(machine):
        settings = list(
            effect.settings(machine, place, Campaign()) or effect.settings(machine, place, AT_REST)
        )
        chosen = settings if len(settings) <= 5 else [settings[0], *settings[-2:]]
        out += [PlacedEffect.at(effect, machine, place, s) for s in chosen]
    return out


def bare(machine: Machine) -> Solved:
    """Every parameter and port as a variable, no effects; solved once a machine and gravity."""
    key = (machine.name, machine.gravity)
    if key not in _BARE:
        _BARE[key] = Solved(symbolic_model(machine, ports=True), READINGS[machine.name])
    return _BARE[key]


_BARE: dict[object, Solved] = {}


def with_effect(
    machine: Machine, slug: str, place: Place, settings: Settings | None = None, **values: float
) -> PlacedEffect:
    return PlacedEffect.at(effects.get(slug, "test")(), machine, place, settings, values)


def shift_slopes(machine: Machine, placed: PlacedEffect) -> dict[str, Array]:
    """Derivative of each port's shift by the coefficients, at the tests' configuration and drivers."""
    readings = dict(zip(machine.mechanism.readings, READINGS[machine.name], strict=True))
    reference = bare(machine)
    values = dict(zip(reference.model.names, map(ca.SX, reference.model.p_home), strict=True))
    loads = {
        name: ca.SX(load / load_scale(machine, name.rpartition("|")[2]))
        for name, load in reference.load.items()
    }
    c = {coefficient.name: ca.SX.sym(coefficient.name) for coefficient in placed.coefficients}
    z = {name: ca.SX(DRIVERS[name.split(".")[0]]) for name in placed.drivers}
    q = {name: ca.SX(value) for name, value in readings.items()}
    states = {name: ca.SX(value) for name, value in reference.states.items()}
    site = Site(machine, placed.place, placed.settings_map, c, q, z, values, loads, states)
    symbols = ca.vertcat(*c.values())
    return {
        port: np.array(ca.evalf(ca.substitute(ca.jacobian(shift, symbols), symbols, 0 * symbols)))[0]
        for port, shift in placed.effect.shifts(site).items()
    }


def position(machine: Machine, q: Sequence[float] | Array, *placed: PlacedEffect, **drivers: float) -> Array:
    return Solved(symbolic_model(machine, placed), q, **drivers).position
