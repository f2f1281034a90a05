"""Fits whose answer is known: exact readings of a machine with effects, and an estimate that stands at the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from support.effect_machines import READINGS
from support.moving_machines import record
from truepose.arrays import Array
from truepose.identification.fit.estimate import result
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import Solution, Status
from truepose.identification.fit.problem import Problem, prior_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.machine.machine import Machine

ROWS = 40


def posed(machine: Machine, rows: int = ROWS) -> Recording:
    """Poses about the tests' own, warming up; nothing is read yet."""
    rng = np.random.default_rng(4)
    spans = [0.2 * np.ptp(a.range) if a.range else 0.2 for a in machine.mechanism.actuators]
    q = np.array(READINGS[machine.name]) + np.array(spans) * rng.uniform(-1, 1, (rows, len(spans)))
    temperature = 20 + 8 * rng.random(rows)
    drivers = {"temperature.air": temperature, "pressure": 1013.0 + rng.normal(size=rows)}
    drivers |= {f"approach.{name}": rng.choice([-1.0, 1.0], rows) for name in machine.mechanism.readings}
    return record(machine, q, drivers=drivers)


def read(machine: Machine, recording: Recording, terms: Sequence[PlacedEffect]) -> Recording:
    """The same with exact readings of the machine with these effects."""
    predictor = Predictor(machine, recording, terms)
    p = predictor.model.p_home
    names, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
    return replace(recording, observations=dict(zip(names, values.T, strict=True)))


def fit_at(
    machine: Machine, recording: Recording, terms: Sequence[PlacedEffect], away: Array | float = 0.0
) -> Estimate:
    """What a fit says that ends at the machine file's constants and the terms' amplitudes, plus ``away`` (np,)."""
    predictor = Predictor(machine, recording, terms)
    problem = Problem(
        predictor, prior_of(machine, terms), predictor.model.p_home + away, np.ones(len(recording), bool)
    )
    free = len(problem.prior.free)
    still = Solution(np.zeros(free), np.eye(free + 1), 0.0, next(iter(Status)), 1, 0.0, np.zeros(free))
    return result(problem, still, tuple(terms))


def formula_of(machine: Machine, recording: Recording, terms: Sequence[PlacedEffect]) -> dict[str, Array]:
    """(n,) shift of each port as the effects' own formulas say, in numbers; loads are of the machine without them."""
    bare = Predictor(machine, recording, ports=True)
    p = np.concatenate([[c.nominal for c in machine.parameters], np.zeros(len(machine.ports))])
    x, _ = bare.assemble(p)
    loads = bare.loads(p, x)
    names, columns, _, _ = bare.columns(p, x)
    values = {c.name: ca.SX(c.nominal) for c in machine.parameters} | {n: ca.SX(0) for n in machine.ports}
    out: dict[str, Array] = {}
    for row in range(len(recording)):
        q = dict(zip(machine.mechanism.readings, map(ca.SX, recording.q[row]), strict=True))
        load = {n: ca.SX(v[row]) for n, v in loads.items()}
        states = {f"seen.{n}": ca.SX(v) for n, v in zip(names, columns[row], strict=True)}
        for term in terms:
            z = {name: ca.SX(float(np.asarray(recording.driver(name))[row])) for name in term.drivers}
            c = {name: ca.SX(value) for name, value in term.values.items()}
            site = Site(machine, term.place, term.settings_map, c, q, z, values, load, states)
            for port, shift in term.effect.shifts(site).items():
                out.setdefault(port, np.zeros(len(recording)))[row] += float(ca.evalf(shift))
    return out
