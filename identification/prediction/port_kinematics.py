"""The pose of an open chain with many coefficients: derivatives by the ports that they move, and the ports' own by them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.prediction.by_ports import ByPorts
from truepose.identification.prediction.sensor_rows import Sight
from truepose.models import lie
from truepose.models.machine.kinematics import SymbolicModel

MANY = 100
"""Coefficients from which on it pays; fewer are written out."""


@dataclass(frozen=True)
class PortKinematics:
    """``at`` (w,): unknowns of p whose derivatives are written out; ``port``, ``column`` (c,): of those that move one port.

    waves: how far the first of the latter move their ports, by readings and drivers alone, so that they are worked out once
    for all p; ``shifted`` (f,) are the ports that they move.
    """

    function: BatchFunction
    waves: BatchFunction
    at: Index
    port: Index
    column: Index
    shifted: Index

    @classmethod
    def of(cls, model: SymbolicModel, rows: int) -> PortKinematics | None:
        """None where loops close, sensors read several tips, coefficients are few, or where they move readings and no ports."""
        held, first = model.held, len(model.machine.parameters)
        coefficients = sum(len(e.coefficients) for e in model.effects)
        if held is None or coefficients < MANY:
            return None
        own = slice(first, first + coefficients)
        by_port = ca.jacobian(held.values, model.p)[:, own]
        reading = ca.jacobian(held.reading_shift, model.p)
        port, column = (np.array(k, dtype=np.intp) for k in by_port.sparsity().get_triplet())
        reads = np.array(reading[:, own].sparsity().get_triplet()[1], dtype=np.intp)
        alone = np.bincount(column, minlength=coefficients) == 1
        alone[reads] = False
        follows = np.flatnonzero(alone[column])
        values = ca.vertcat(*(by_port.nz[k] for k in follows.tolist()))
        by_p = ca.jacobian_sparsity(values, model.p).get_triplet()[0]
        moving = np.isin(np.arange(len(follows)), by_p)
        order = np.argsort(moving, kind="stable")
        port, column, fixed = port[follows][order], column[follows][order] + first, int(np.sum(~moving))
        at = np.setdiff1d(np.arange(len(model.names)), column)
        shifted = np.unique(port[:fixed])
        outputs = _Outputs(model, at, reading, column[:fixed], shifted)
        moved = [values[k] for k in order[fixed:].tolist()]
        function = BatchFunction("kinematics", outputs.inputs, outputs.of(ca.vertcat(*moved)), rows=rows)
        waves = ca.vertcat(*(values[k] for k in order[:fixed].tolist()))
        return cls(function, BatchFunction("waves", [model.q, model.z], [waves]), at, port, column, shifted)

    def values(self, q: Array, z: Array) -> Array:
        """(n, f) what does not depend on p, of rows of readings q (n, nq) and drivers z (n, nz)."""
        return self.waves(q, z)[0][..., 0]

    def sight(self, q: Array, z: Array, p: Array, values: Array) -> Sight:
        """What the sensors have before them in rows of readings q (n, nq) and drivers z (n, nz), with their ``values``."""
        own = self.port[: values.shape[1]]
        column = self.column[: len(own)]
        moved = [values[:, own == k] @ p[column[own == k]] for k in self.shifted]
        shifts = np.column_stack(moved or [np.zeros((len(q), 0))])
        pose, twist, slopes, shift, shift_by, moving = self.function(q, z, p, shifts)
        ports = ByPorts(slopes, self.port, self.column, np.hstack([values, moving[..., 0]]))
        return Sight(pose, twist, shift[..., 0], shift_by, at=self.at, ports=ports)


class _Outputs:
    """Of the kinematics as a function of q, z, p and what ``fixed`` coefficients shift the ports ``shifted`` (f,) by."""

    def __init__(self, model: SymbolicModel, at: Index, reading: ca.SX, fixed: Index, shifted: Index) -> None:
        held = model.held
        assert held is not None
        self._held, self._model, self._at, self._reading = held, model, at, reading
        self._shift = ca.SX.sym("shift", len(shifted))
        places = fixed.tolist()
        values = ca.substitute(held.values, model.p[places], ca.SX.zeros(len(places)))
        for k, port in enumerate(shifted.tolist()):
            values[port] += self._shift[k]
        self._values = values
        self.inputs = [model.q, model.z, model.p, self._shift]

    def of(self, moving: ca.SX) -> list[ca.SX]:
        """Pose, its twist by unknowns ``at``, slopes of twist and columns by ports, shifts of columns, their slopes, and the
        values of coefficients that depend on p."""
        held, p, places = self._held, self._model.p, self._at.tolist()
        flat, rows = ca.vec(held.world[:3, :]), twist_rows(held.world)
        moved = ca.jacobian(self._values, p)[:, places]
        by_ports = ca.vertcat(
            rows @ ca.jacobian(flat, held.ports), ca.jacobian(held.reading_shift, held.ports)
        )
        twist = rows @ ca.jacobian(flat, p)[:, places] + by_ports[:6, :] @ moved
        shift_by = self._reading[:, places] + by_ports[6:, :] @ moved
        outputs = [held.world, twist, by_ports, held.reading_shift, shift_by, moving]
        return list(ca.substitute([ca.densify(o) for o in outputs], [held.ports], [self._values]))


def twist_rows(world: ca.SX) -> ca.SX:
    """(6, 12) map from the derivative of vec([R|p]) to the twist [dp; vee(dR R')]."""
    rows = ca.SX.zeros(6, 12)
    rows[:3, 9:] = ca.SX.eye(3)
    for k in range(3):
        rows[3:, 3 * k : 3 * k + 3] = 0.5 * lie.skew(world[:3, k])
    return rows


def twists_by(world: ca.SX, *variables: ca.SX) -> list[ca.SX]:
    """(6, v) derivatives of a pose (4, 4), as twists, by each vector of variables."""
    flat, turn = ca.vec(world[:3, :]), twist_rows(world)
    return [turn @ ca.jacobian(flat, by) for by in variables]
