"""What each row says of a shift that an effect makes: the fitted shift, plus what that row's own residual would add to it.

Where an effect is a function of its driver, these points scatter about it (component-plus-residual plots: Larsen and
McCleary, Technometrics 14, 1972). A residual (m,) is turned into a shift by the port's derivative s (m,) of the same
residual: -(s r) / (s s).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.covariance import UNSEEN
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

SAME = 1e-3
"""Share of its size by which a function may differ from itself a period later."""


@dataclass(frozen=True)
class PortShift:
    """Of a port: the fitted shift (n,) with its 1-sigma (n,), and what each row says (n,); NaN where a row says nothing.

    In the port's unit (mm or rad). joint: the one joint whose reading decides the shift, empty where anything else does;
    period: the shortest one of that function in the reading's unit, infinite without one.
    """

    port: str
    fitted: Array
    std: Array
    rows: Array
    joint: str
    period: float


def port_shifts(
    fit: Estimate,
    recording: Recording,
    groups: Sequence[Sequence[PlacedEffect]],
    rows: Index | None = None,
) -> list[list[PortShift]]:
    """Return what each group of terms of a fit shifts, port by port and row by row.

    Ports that no reading sees are left out. ``rows``: those that are wanted, by default all; the others are NaN.
    """
    if not groups:
        return []
    predictor = Predictor(fit.nominal, recording, fit.effects, ports=True)
    p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
    found = [_Group(predictor, fit, p, terms) for terms in groups]
    for own, residual, jacobian in _blocks(predictor, fit, p, rows):
        for group in found:
            group.take(own, residual, jacobian)
    return [group.shifts() for group in found]


class _Group:
    """Terms that act together: places of their coefficients and ports among all names, and what rows said so far."""

    def __init__(self, predictor: Predictor, fit: Estimate, p: Array, terms: Sequence[PlacedEffect]) -> None:
        self.predictor, self.fit, self.p, self.terms = predictor, fit, p, terms
        model, names = predictor.model, list(predictor.model.names)
        self.own = [names.index(name) for term in terms for name in term.parameter_names]
        by = _slopes(predictor, self.own)
        rows = sorted(set(by.sparsity().get_triplet()[0]))
        self.at = [_ports(predictor)[k] for k in rows]
        self.by = by[rows, :]
        """(ports, own) how far a unit of each coefficient shifts each port."""
        self.slopes = BatchFunction("slopes", [model.x, model.q, model.z, model.p], [self.by])
        self.found = np.full((3, len(rows), len(fit.residual)), np.nan)
        """(3, ports, n): fitted, std, rows."""

    def take(self, rows: Index, residual: Array, jacobian: Array) -> None:
        """Take what some rows say."""
        fit, p, own = self.fit, self.p, self.own
        count, covariance = len(fit.nominal.parameters), _covariance(fit, own)
        lengths = [*range(count), *range(len(fit.p), len(p))]  # all but coefficients
        shares = self._shares(rows)
        largest = float(np.max(np.sum(jacobian[:, :, lengths] ** 2, axis=1), initial=0.0))
        for k, column in enumerate(self.at):
            s = jacobian[:, :, column]
            size = np.sum(s**2, axis=1)
            seen = size > UNSEEN**2 * largest
            by = np.where(seen[:, None], shares[:, k], np.nan)
            fitted = by @ p[own]
            beside = -np.sum(s * residual, axis=1) / np.where(seen, size, np.nan)
            spread = np.maximum(np.einsum("nc,cd,nd->n", by, covariance, by), 0.0)
            self.found[:, k, rows] = fitted, np.sqrt(spread), fitted + beside

    def _shares(self, rows: Index, reading: int = 0, moved: float = 0.0) -> Array:
        """Return (n, ports, own) what a unit of each coefficient shifts, with one reading moved."""
        q = self.predictor.q[rows].copy()
        q[:, reading] += moved
        return np.asarray(self.slopes(self.fit.x[rows], q, self.predictor.z[rows], self.p)[0])

    def shifts(self) -> list[PortShift]:
        """Return the shifts of the ports that readings see."""
        out = list[PortShift]()
        for k, port in enumerate(self.at):
            if np.isfinite(self.found[0, k]).any():
                fitted, std, rows = self.found[:, k]
                out.append(PortShift(self.predictor.model.names[port], fitted, std, rows, *self._joint(k)))
        return out

    def _joint(self, k: int) -> tuple[str, float]:
        """Return the one joint that the shift at a port is a function of, and the period of that function."""
        model = self.predictor.model
        read = [j for j in range(model.q.numel()) if ca.depends_on(self.by[k, :], model.q[j])]
        others = ca.vertcat(model.x, model.z)
        if len(read) != 1 or ca.depends_on(self.by[k, :], others) or any(t.needs_load for t in self.terms):
            return "", np.inf
        name = model.readings[read[0]]
        actuator = self.fit.nominal.mechanism.actuator(name)
        turn = {"rad": 2 * np.pi, "turn": 1.0}.get(actuator.reading_unit, actuator.screw_pitch or np.inf)
        rows = np.flatnonzero(np.isfinite(self.found[0, k]))
        orders = {v for term in self.terms for v in term.settings_map.values() if v > 0} | {1.0}
        for period in sorted(turn / order for order in orders if np.isfinite(turn)):
            away = self._shares(rows, read[0], period)[:, k] @ self.p[self.own] - self.found[0, k, rows]
            if np.max(np.abs(away)) < SAME * np.ptp(self.found[0, k, rows]):
                return name, float(period)
        return name, np.inf


def _ports(predictor: Predictor) -> list[int]:
    """Return the places of what effects can shift, among all names: parameters and ports."""
    return [k for k, name in enumerate(predictor.model.names) if name in predictor.model.values]


def _slopes(predictor: Predictor, own: Sequence[int]) -> ca.SX:
    """Return (ports, own) how far a unit of each coefficient shifts each port; shifts are linear in them.

    Not from the readings' derivatives: where a term shifts several ports these say what all of them do together.
    """
    m = predictor.model
    shifted = ca.vertcat(*(m.values[m.names[k]] for k in _ports(predictor)))
    by = ca.jacobian(shifted, ca.vertcat(*(m.p[k] for k in own)))
    marks = [symbol for symbol in ca.symvar(by) if symbol.name().removeprefix("state.") in m.states]
    if marks:  # what a sensor sees, on which shifts of its readings depend
        states = [m.states[mark.name().removeprefix("state.")] for mark in marks]
        by = ca.substitute(by, ca.vertcat(*marks), ca.vertcat(*states))
    return by


def _blocks(
    predictor: Predictor, fit: Estimate, p: Array, wanted: Index | None
) -> Iterator[tuple[Index, Array, Array]]:
    """Index, residuals and Jacobians, of rows that are wanted and could be assembled."""
    good = np.flatnonzero(np.isfinite(fit.residual).all(axis=1))
    if wanted is not None:
        good = np.intersect1d(good, wanted)
    if any(sensor.compares for sensor in fit.nominal.sensors):
        for block in predictor.blocks(p, fit.x):
            rows = np.arange(len(fit.residual))[block.rows]
            kept = np.isin(rows, good)
            yield rows[kept], block.residual[kept], _by_own_row(fit.nominal, block)[kept]
        return
    for block in predictor.of_rows(good).blocks(p, fit.x[good]):
        yield good[block.rows], block.residual, block.jacobian


def _by_own_row(machine: Machine, block: Block) -> Array:
    """(n, m, np) what each row's own prediction does to its residual, while the rows that it is compared with stand still.

    A shift that is alike in both cancels in what a sensor reads as a change; a row says something of it all the same.
    """
    if block.compare is None:
        return block.jacobian
    sigma = [c.sigma if sensor.compares else 1.0 for sensor in machine.sensors for c in sensor.channels]
    told = np.any(block.jacobian != 0.0, axis=2, keepdims=True)  # neither lost nor its own origin
    return np.where(told, block.here / np.array(sigma)[:, None], 0.0)


def _covariance(fit: Estimate, own: Sequence[int]) -> Array:
    """Covariance of some entries of p; zero where one is not free."""
    place = {int(k): j for j, k in enumerate(fit.prior.free)}
    out = np.zeros((len(own), len(own)))
    known = [k for k, entry in enumerate(own) if entry in place]
    at = [place[own[k]] for k in known]
    out[np.ix_(known, known)] = fit.covariance_among(np.array(at))
    return out
