"""What a finding's formula adds to the machine at its estimated coefficients, evaluated for drawing.

The effect's own formula is called with symbols for the readings, so every effect that adds a function of one
reading (gears, screws, encoders, guides) is drawn by the same code.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.report.drivers import reading_unit
from truepose.identification.report.numbers import finer, unit_symbol
from truepose.models.effects.base import PlacedEffect, Site
from truepose.models.machine import Machine
from truepose.models.states import asked, state_names

Array = NDArray[np.float64]
POINTS = 721
MOST_PORTS = 3


@dataclass(frozen=True)
class Curve:
    """A shift over a reading: x (n,), y and its 1-sigma (n,), where it was measured, axis titles."""

    x: Array
    y: Array
    std: Array
    measured: Array
    x_title: str
    y_title: str


@dataclass(frozen=True)
class Formula:
    """Shifts of some terms by port, in symbols of readings and coefficients."""

    q: dict[str, ca.SX]
    coefficients: ca.SX
    amplitudes: Array
    columns: NDArray[np.intp]  # places of the coefficients in the estimate's p
    shifts: dict[str, ca.SX]


def terms_of(diagnosis: Diagnosis, finding: Finding) -> list[PlacedEffect]:
    """The fitted terms that a finding gathers."""
    return [t for t in diagnosis.terms if t.effect.slug == finding.effect and t.place == finding.place]


def formula(machine: Machine, terms: Sequence[PlacedEffect], names: Sequence[str]) -> Formula | None:
    """Sum of the terms' shifts at the drawing's geometry; None when they read drivers, loads or the present state."""
    if not terms or any(t.drivers or t.needs_load for t in terms):
        return None
    q = {name: ca.SX.sym(name) for name in machine.mechanism.readings}
    values = {p.name: ca.SX(p.nominal) for p in machine.parameters} | {
        port: ca.SX(0) for port in machine.ports
    }
    states = {name: ca.SX.sym(name) for name in state_names(machine)}
    symbols: list[ca.SX] = []
    shifts: dict[str, ca.SX] = {}
    for term in terms:
        c = {coefficient.name: ca.SX.sym(coefficient.name) for coefficient in term.coefficients}
        symbols += c.values()
        for port, shift in term.effect.shifts(
            Site(machine, term.place, term.settings_map, c, q, {}, values, {}, states)
        ).items():
            shifts[port] = shifts.get(port, ca.SX(0)) + shift
    if asked(list(shifts.values()), states):
        return None
    amplitudes = np.array([a for term in terms for a in term.amplitudes])
    columns = [names.index(name) for t in terms for name in t.parameter_names]
    return Formula(q, ca.vertcat(*symbols), amplitudes, np.array(columns, dtype=np.intp), shifts)


def curves(diagnosis: Diagnosis, finding: Finding) -> list[Curve]:
    """Functions of a single reading that the finding adds, three ports at most; none for any other effect."""
    after = diagnosis.after
    found = formula(diagnosis.machine, terms_of(diagnosis, finding), after.prior.names)
    if found is None:
        return []
    place = {int(k): j for j, k in enumerate(after.prior.free)}
    at = [place[int(k)] for k in found.columns if int(k) in place]
    covariance = (
        after.covariance[np.ix_(at, at)]
        if len(at) == len(found.columns)
        else np.zeros((len(found.columns),) * 2)
    )
    out = []
    for port, shift in found.shifts.items():
        readings = [name for name, symbol in found.q.items() if ca.depends_on(shift, symbol)]
        if len(readings) == 1:
            out.append(_curve(diagnosis, found, port, readings[0], covariance))
    return out[:MOST_PORTS]


def _curve(diagnosis: Diagnosis, found: Formula, port: str, reading: str, covariance: Array) -> Curve:
    shift, recording = found.shifts[port], diagnosis.recording
    measured = np.unique(recording.q[:, recording.joints.index(reading)])
    x = np.linspace(measured.min(), measured.max(), POINTS)
    function = ca.Function(
        "shift", [found.q[reading], found.coefficients], [shift, ca.jacobian(shift, found.coefficients)]
    )
    pairs = [function(v, found.amplitudes) for v in x]
    y = np.array([float(value) for value, _ in pairs])
    slopes = np.array([np.array(slope.full()).ravel() for _, slope in pairs])
    std = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", slopes, covariance, slopes), 0.0))
    factor, unit = reading_unit(diagnosis.machine, reading)
    scale, name = finer(float(np.max(np.abs(y), initial=0.0)) or 1.0, diagnosis.machine.unit_of(port))
    title = f"shift of {port} [{unit_symbol(name) or '1'}]"
    return Curve(factor * x, scale * y, scale * std, factor * measured, f"{reading} [{unit}]", title)


def coupling_matrix(diagnosis: Diagnosis, finding: Finding) -> tuple[list[str], Array] | None:
    """Ports, and (ports, readings) shift a unit of reading at mid-range; None with fewer than two ports."""
    found = formula(diagnosis.machine, terms_of(diagnosis, finding), diagnosis.after.prior.names)
    if found is None or len(found.shifts) < 2:
        return None
    readings = ca.vertcat(*found.q.values())
    slope = ca.jacobian(ca.vertcat(*found.shifts.values()), readings)
    middle = np.array([np.mean(a.range) if a.range else 0.0 for a in diagnosis.machine.mechanism.actuators])
    value = ca.Function("slope", [readings, found.coefficients], [slope])(middle, found.amplitudes)
    return list(found.shifts), np.array(value.full())
