"""What a finding's terms shift, as expressions of readings and coefficients: the effects' own formulas, called with symbols."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.machine.machine import Machine
from truepose.models.machine.states import asked, state_names


@dataclass(frozen=True)
class Formula:
    """Shifts of some terms by port, in symbols of readings and coefficients; plain: nothing else is in them."""

    q: dict[str, ca.SX]
    coefficients: ca.SX
    amplitudes: Array
    shifts: dict[str, ca.SX]
    plain: bool


def terms_of(diagnosis: Diagnosis, finding: Finding) -> list[PlacedEffect]:
    """The fitted terms that a finding gathers."""
    return [t for t in diagnosis.terms if t.effect.slug == finding.effect and t.place == finding.place]


def formula(machine: Machine, terms: Sequence[PlacedEffect]) -> Formula | None:
    """Sum of the terms' shifts at the drawing's geometry; None without terms."""
    if not terms:
        return None
    q = {name: ca.SX.sym(name) for name in machine.mechanism.readings}
    values = {p.name: ca.SX(p.nominal) for p in machine.parameters} | {
        port: ca.SX(0) for port in machine.ports
    }
    states = {name: ca.SX.sym(name) for name in state_names(machine)}
    drivers = {name: ca.SX.sym(name) for term in terms for name in term.drivers}
    cases = machine.load_cases or ("",)
    loads = {f"{case}{port}": ca.SX.sym(port) for case in cases for port in values}
    symbols: list[ca.SX] = []
    shifts: dict[str, ca.SX] = {}
    for term in terms:
        c = {coefficient.name: ca.SX.sym(coefficient.name) for coefficient in term.coefficients}
        symbols += c.values()
        site = Site(machine, term.place, term.settings_map, c, q, drivers, values, loads, states)
        for port, shift in term.effect.shifts(site).items():
            shifts[port] = shifts.get(port, ca.SX(0)) + shift
    read = [*drivers.values(), *(s for t in terms if t.needs_load for s in loads.values())]
    plain = not asked(list(shifts.values()), states) and not any(
        ca.depends_on(shift, symbol) for shift in shifts.values() for symbol in read
    )
    amplitudes = np.array([a for term in terms for a in term.amplitudes])
    return Formula(q, ca.vertcat(*symbols), amplitudes, shifts, plain)


def coupling_matrix(diagnosis: Diagnosis, finding: Finding) -> tuple[list[str], Array] | None:
    """Ports, and (ports, readings) shift a unit of reading at mid-range; None with fewer than two ports of each."""
    found = formula(diagnosis.nominal, terms_of(diagnosis, finding))
    if found is None or len(found.shifts) < 2 or not found.plain:
        return None
    readings = ca.vertcat(*found.q.values())
    slope = ca.jacobian(ca.vertcat(*found.shifts.values()), readings)
    middle = np.array([np.mean(a.range) if a.range else 0.0 for a in diagnosis.nominal.mechanism.actuators])
    value = np.array(
        ca.Function("slope", [readings, found.coefficients], [slope])(middle, found.amplitudes).full()
    )
    return (list(found.shifts), value) if np.count_nonzero(np.any(value != 0.0, axis=0)) > 1 else None
