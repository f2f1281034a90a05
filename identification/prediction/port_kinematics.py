"""The pose of an open chain with many coefficients: derivatives by the ports that they move, and the ports' own by them."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.prediction.by_ports import ByPorts
from truepose.identification.prediction.sensor_rows import Sight
from truepose.models import lie
from truepose.models.kinematics import SymbolicModel

Array = NDArray[np.float64]
Index = NDArray[np.intp]
MANY = 100
"""Coefficients from which on it pays; fewer are written out."""


@dataclass(frozen=True)
class PortKinematics:
    """``at`` (w,): unknowns of p whose derivatives are written out; ``port``, ``column`` (c,): of those that move one port."""

    function: BatchFunction
    at: Index
    port: Index
    column: Index

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
        follows = alone[column]
        port, column = port[follows], column[follows] + first
        at = np.setdiff1d(np.arange(len(model.names)), column)
        values = ca.vertcat(*(by_port.nz[k] for k in np.flatnonzero(follows).tolist()))
        outputs = _outputs(model, at, reading, values)
        function = BatchFunction("kinematics", [model.q, model.z, model.p], outputs, rows=rows)
        return cls(function, at, port, column)

    def sight(self, q: Array, z: Array, p: Array) -> Sight:
        """What the sensors have before them in rows of readings q (n, nq) and drivers z (n, nz)."""
        pose, twist, slopes, shift, shift_by, values = self.function(q, z, p)
        ports = ByPorts(slopes, self.port, self.column, values[..., 0])
        return Sight(pose, twist, shift[..., 0], shift_by, at=self.at, ports=ports)


def _outputs(model: SymbolicModel, at: Index, reading: ca.SX, values: ca.SX) -> list[ca.SX]:
    """Pose, its twist by unknowns ``at``, slopes of twist and columns by ports, shifts of columns, their slopes, ``values``."""
    held = model.held
    assert held is not None
    flat, rows = ca.vec(held.world[:3, :]), twist_rows(held.world)
    places = at.tolist()
    moved = ca.jacobian(held.values, model.p)[:, places]
    by_ports = ca.vertcat(rows @ ca.jacobian(flat, held.ports), ca.jacobian(held.reading_shift, held.ports))
    twist = rows @ ca.jacobian(flat, model.p)[:, places] + by_ports[:6, :] @ moved
    shift_by = reading[:, places] + by_ports[6:, :] @ moved
    outputs = [held.world, twist, by_ports, held.reading_shift, shift_by, values]
    return list(ca.substitute([ca.densify(o) for o in outputs], [held.ports], [held.values]))


def twist_rows(world: ca.SX) -> ca.SX:
    """(6, 12) map from the derivative of vec([R|p]) to the twist [dp; vee(dR R')]."""
    rows = ca.SX.zeros(6, 12)
    rows[:3, 9:] = ca.SX.eye(3)
    for k in range(3):
        rows[3:, 3 * k : 3 * k + 3] = 0.5 * lie.skew(world[:3, k])
    return rows


__all__ = ["PortKinematics", "twist_rows"]
