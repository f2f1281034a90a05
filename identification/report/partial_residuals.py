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


@dataclass(frozen=True)
class PortShift:
    """Of a port: the fitted shift (n,) with its 1-sigma (n,), and what each row says (n,); NaN where a row says nothing.

    In the port's unit (mm or rad).
    """

    port: str
    fitted: Array
    std: Array
    rows: Array


def all_port_shifts(
    fit: Estimate,
    recording: Recording,
    wanted: Sequence[tuple[Sequence[PlacedEffect], Sequence[str]]],
    rows: Index | None = None,
) -> list[list[PortShift]]:
    """What groups of terms of a fit shift at some ports each, row by row; readings are evaluated once for all of them.

    Ports that no reading sees are left out. ``rows``: those that are wanted, by default all; the others are NaN.
    """
    if not wanted:
        return []
    predictor = Predictor(fit.nominal, recording, fit.effects, ports=True)
    p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
    groups = [_Group.of(predictor, fit, terms, ports) for terms, ports in wanted]
    for own, residual, jacobian in _blocks(predictor, fit, p, rows):
        for group in groups:
            group.take(own, residual, jacobian, p)
    return [group.shifts() for group in groups]


@dataclass(frozen=True)
class _Group:
    """Terms that act together: places of their coefficients and ports among all names, and what rows said so far."""

    predictor: Predictor
    fit: Estimate
    ports: Sequence[str]
    own: list[int]
    at: list[int]
    covariance: Array
    slopes: BatchFunction
    found: Array  # (3, ports, n): fitted, std, rows

    @classmethod
    def of(
        cls, predictor: Predictor, fit: Estimate, terms: Sequence[PlacedEffect], ports: Sequence[str]
    ) -> _Group:
        names = list(predictor.model.names)
        own = [names.index(name) for term in terms for name in term.parameter_names]
        found = np.full((3, len(ports), len(fit.residual)), np.nan)
        at = [names.index(port) for port in ports]
        slopes = _slopes(predictor, own, ports)
        return cls(predictor, fit, ports, own, at, _covariance(fit, own), slopes, found)

    def take(self, rows: Index, residual: Array, jacobian: Array, p: Array) -> None:
        """What some rows say."""
        fit, q, z, own = self.fit, self.predictor.q[rows], self.predictor.z[rows], self.own
        count = len(fit.nominal.parameters)
        lengths = [*range(count), *range(len(fit.p), len(p))]  # all but coefficients
        shares = self.slopes(fit.x[rows], q, z, p)[0]  # (n, ports, own)
        largest = float(np.max(np.sum(jacobian[:, :, lengths] ** 2, axis=1), initial=0.0))
        for k, column in enumerate(self.at):
            s = jacobian[:, :, column]
            size = np.sum(s**2, axis=1)
            seen = size > UNSEEN**2 * largest
            by = np.where(seen[:, None], shares[:, k], np.nan)
            fitted = by @ p[own]
            beside = -np.sum(s * residual, axis=1) / np.where(seen, size, np.nan)
            spread = np.maximum(np.einsum("nc,cd,nd->n", by, self.covariance, by), 0.0)
            self.found[:, k, rows] = fitted, np.sqrt(spread), fitted + beside

    def shifts(self) -> list[PortShift]:
        """Of the ports that readings see."""
        seen = [k for k in range(len(self.ports)) if np.isfinite(self.found[0, k]).any()]
        return [PortShift(self.ports[k], *self.found[:, k]) for k in seen]


def _slopes(predictor: Predictor, own: Sequence[int], ports: Sequence[str]) -> BatchFunction:
    """Of each row, how far a unit of each coefficient shifts each port; shifts are linear in them.

    Not from the readings' derivatives: where a term shifts several ports these say what all of them do together.
    """
    m = predictor.model
    shifted = ca.vertcat(*(m.values[port] for port in ports))
    by = ca.jacobian(shifted, m.p)[:, list(own)]
    marks = [symbol for symbol in ca.symvar(by) if symbol.name().removeprefix("state.") in m.states]
    if marks:  # what a sensor sees, on which shifts of its readings depend
        states = [m.states[mark.name().removeprefix("state.")] for mark in marks]
        by = ca.substitute(by, ca.vertcat(*marks), ca.vertcat(*states))
    return BatchFunction("slopes", [m.x, m.q, m.z, m.p], [by])


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
    told = np.any(
        block.jacobian != 0.0, axis=2, keepdims=True
    )  # not one that was lost, or that is its own origin
    return np.where(told, block.here / np.array(sigma)[:, None], 0.0)


def _covariance(fit: Estimate, own: Sequence[int]) -> Array:
    """Covariance of some entries of p; zero where one is not free."""
    place = {int(k): j for j, k in enumerate(fit.prior.free)}
    out = np.zeros((len(own), len(own)))
    known = [k for k, entry in enumerate(own) if entry in place]
    at = [place[own[k]] for k in known]
    out[np.ix_(known, known)] = fit.covariance_among(np.array(at))
    return out
