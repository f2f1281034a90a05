"""What a hypothesis says of the rows and of the machine, and where base and tool then stand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MOST_ROWS = 45
"""Rows that a hypothesis is judged by: enough to tell slips apart, few enough for a hundred hypotheses in a second."""


@dataclass(frozen=True)
class Scene:
    """What a hypothesis says: all rows (their readings may be changed), constants p (np,), the factors by which it changed
    measured lengths (size) and angles (width), and the rows (n,) that it leaves without a reading.

    drawn, stated: the factors by which it changed the lengths of the mechanism and those of tolerances. exchanged: whether base
    and tool have each other's tolerances. coarse, turned: the factors by which the sigmas
    of lengths grow, and the sigmas and tolerances of angles.
    """

    rows: Recording
    p: Array
    size: float = 1.0
    width: float = 1.0
    lost: Mask | None = None
    drawn: float = 1.0
    stated: float = 1.0
    exchanged: bool = False
    coarse: float = 1.0
    turned: float = 1.0

    def with_joints(self, q: Array) -> Scene:
        """The same with other readings of the joints (n, nq)."""
        return replace(self, rows=replace(self.rows, q=q))

    def with_columns(self, columns: Mapping[str, Array], size: float = 1.0, width: float = 1.0) -> Scene:
        """The same with other columns (n,) of the sensors, multiplied by ``size`` (lengths) and ``width`` (angles)."""
        seen = {**self.rows.observations, **columns}
        rows = replace(self.rows, observations=seen)
        return replace(self, rows=rows, size=self.size * size, width=self.width * width)


@dataclass(frozen=True)
class Stand:
    """Where base and tool stand best: constants p (np,), and what is left.

    misfit: whitened rms over the rows that fit best; length: rms of the 3-D error, mm, None where no length is read; residual
    (n, m) whitened; rows: places (n,) of the rows judged.
    """

    p: Array
    misfit: float
    length: float | None
    residual: Array
    rows: NDArray[np.intp]
    scene: Scene

    @property
    def bad(self) -> bool:
        """Whether nothing could be fitted."""
        return not np.isfinite(self.misfit)


def usable(machine: Machine, scene: Scene) -> NDArray[np.intp]:
    """Return the places of all rows to judge by; where rows count from others, of motions and the rows that they start at."""
    use = ~scene.rows.validation
    if scene.lost is not None:
        use &= ~scene.lost
    rows = np.flatnonzero(use)
    if len(rows) and differs(machine) and scene.rows.from_row is not None:
        return _with_origins(scene.rows.q, rows, scene.rows.from_row)
    return rows


def chosen(machine: Machine, scene: Scene) -> NDArray[np.intp]:
    """Return the places of the rows to judge by, spread over the recording; with those that ``from`` names."""
    rows = usable(machine, scene)
    if differs(machine) and scene.rows.from_row is not None:
        return rows
    return _spread(rows)


def _spread(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    step = np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).round().astype(int)
    return np.asarray(rows[np.unique(step)])


def _with_origins(q: Array, rows: NDArray[np.intp], origin: NDArray[np.int64]) -> NDArray[np.intp]:
    """The first row of each motion that was read, so that repeats do not crowd out poses, and the rows that they start at."""
    told = np.column_stack([q[rows], q[origin[rows]]])
    moved = rows[np.any(q[rows] != q[origin[rows]], axis=1)]
    first = np.sort(np.unique(told, axis=0, return_index=True)[1])
    wanted = np.intersect1d(rows[first], moved)
    wanted = _spread(wanted) if len(wanted) else rows[:1]
    while True:
        closed = np.unique(np.concatenate([wanted, origin[wanted]]))
        if len(closed) == len(wanted):
            return closed
        wanted = closed


def differs(machine: Machine) -> bool:
    """Whether a sensor reads changes since another row."""
    return any(sensor.differs_from_row for sensor in machine.sensors)


__all__ = ["Array", "Mask", "Scene", "Stand", "chosen", "differs", "usable"]
