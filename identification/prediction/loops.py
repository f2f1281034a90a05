"""Passive coordinates at many rows of readings: Newton's method from home, and along a way where that is too far."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
from scipy.spatial import cKDTree

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.prediction.sensor_rows import TOGETHER
from truepose.models.machine.closure import ROUNDS, closed, coordinate_scale, slides_of
from truepose.models.machine.kinematics import SymbolicModel
from truepose.threads import in_order

_STEPS = 8
_FEW = 12
"""Rounds of Newton's method for rows that are given up where it does not get there."""


class Loops:
    """The closed loops of one model; ``rows``: how many rows will be evaluated in all calls together."""

    def __init__(self, model: SymbolicModel, rows: int = 0) -> None:
        m = self._model = model
        outputs = [m.equations, ca.jacobian(m.equations, m.x), m.gap]
        self.closure = BatchFunction("closure", [m.x, m.q, m.z, m.p], outputs, rows=rows)
        """Equations, their derivative by x, and gaps."""
        self.scale = coordinate_scale(m.machine, len(m.home), m.gap.numel())
        slides = slides_of(m.machine.mechanism)
        forces = (len(m.home) - len(slides)) * [False]  # these come last
        self.slides = np.array([*slides, *forces], dtype=bool)

    def assemble(
        self,
        q: Array,
        z: Array,
        p: Array,
        start: Array | None = None,
        *,
        follow: bool = True,
        larger: float = 1.0,
    ) -> tuple[Array, Mask]:
        """Passive coordinates (n, nx) at readings (n, nq), drivers (n, nz) and parameters (np,), and which rows have them.

        ``start`` (n, nx) is where Newton's method begins, by default home. ``follow``: whether rows out of its reach are
        followed from others. ``larger``: by how much ``p`` has the machine larger than its file, home included.
        """
        grown = np.where(self.slides, larger, 1.0)
        x = np.tile(self._model.home * grown, (len(q), 1)) if start is None else start.copy()
        if x.shape[1] == 0:
            return x, np.ones(len(q), dtype=bool)
        x, good = self._closed(x, q, z, p, ROUNDS if follow else _FEW, grown)
        if not follow:
            return x, good
        if good.any() and not good.all():
            self._continue(x, good, (q, z, p), _nearest(q, good))
        if not good.all():
            self._continue(x, good, (q, z, p), None)
        return x, good

    def _closed(
        self, x: Array, q: Array, z: Array, p: Array, rounds: int = ROUNDS, grown: Array | float = 1.0
    ) -> tuple[Array, Mask]:
        scale = replace(self.scale, size=self.scale.size * grown, limit=self.scale.limit * grown)

        def some(first: int) -> tuple[Array, Mask]:
            own = slice(first, first + TOGETHER)
            some_q, some_z = q[own], z[own]

            def equations(x: Array, rows: Index) -> tuple[Array, Array, Array]:
                g, gx, gap = self.closure(x, some_q[rows], some_z[rows], p)
                return g, gx, gap

            return closed(equations, x[own], scale, rounds=rounds)

        found = list(in_order(some, range(0, max(len(x), 1), TOGETHER)))
        return np.concatenate([x for x, _ in found]), np.concatenate([good for _, good in found])

    def _continue(self, x: Array, good: Mask, at: tuple[Array, Array, Array], origin: Index | None) -> None:
        """Follow the rows that are not good from the row ``origin`` names, or from home."""
        (q, z, p), rows = at, np.flatnonzero(~good)
        here = np.tile(self._model.home, (len(rows), 1)) if origin is None else x[origin]
        first = np.tile(self._model.q_home, (len(rows), 1)) if origin is None else q[origin]
        reached = np.zeros(len(rows), dtype=bool)
        for fraction in np.linspace(0.0, 1.0, _STEPS + 1):
            here, reached = self._closed(here, first + fraction * (q[rows] - first), z[rows], p)
        x[rows[reached]], good[rows[reached]] = here[reached], True


def _nearest(q: Array, good: Mask) -> Index:
    """For each row that is not good the good one with the closest readings."""
    span = np.ptp(q, axis=0)
    scaled = q / np.where(span > 0, span, 1.0)
    return np.flatnonzero(good)[cKDTree(scaled[good]).query(scaled[~good])[1]]
