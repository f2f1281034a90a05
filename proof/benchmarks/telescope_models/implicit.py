"""Calibration by what the loops lack at the measured poses, in place of what the sensor should have read.

The objectives of Gayral and Daney 2012 (INRIA RR-8096, Table 2): readings and measured pose together should close
the loops, so that no pose is solved for. Give a ``ClosurePredictor`` to ``estimate`` in place of its own
predictor; every estimator then works as usual. ``whitened`` weighs the gaps by what the pose's noise does to them;
without it their plain sum of squares is minimised, as in the paper.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.closure import closed
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import COORDINATES
from truepose.models.machine.sensor import Channel
from truepose.models.sensors.pose import Pose

Array = NDArray[np.float64]


class ClosurePredictor(Predictor):
    """Gaps of the loops at measured poses as residuals, one for each coordinate of the platform, and Jacobians.

    The machine needs one ``pose`` sensor and passive coordinates that its pose tells (a platform on legs). Raises
    InputError where it has not, and for effects of loads, whose leg forces no pose tells.
    """

    def __init__(
        self,
        machine: Machine,
        recording: Recording,
        effects: Sequence[PlacedEffect] = (),
        *,
        whitened: bool = True,
    ) -> None:
        super().__init__(machine, recording, effects)
        self._sensor, self._count = _pose_sensor(machine), _told(machine, len(self.model.home))
        read = np.column_stack([recording.observations[name] for name in self._sensor.columns])
        self._measured = np.tile(np.eye(4), (len(read), 1, 1))
        self._measured[:, :3, :3], self._measured[:, :3, 3] = lie.exp_so3(read[:, 3:]), read[:, :3]
        self._whitener = np.tile(np.eye(self._count) / self._sensor.sigma_xyz, (len(read), 1, 1))
        if whitened:
            self._whitener = self._whitening()

    @property
    def channels(self) -> tuple[Channel, ...]:
        """One gap for each coordinate of the platform."""
        sigma = self._sensor.sigma_xyz
        return tuple(Channel(f"gap{k + 1}", "mm", sigma, "closure", "tool") for k in range(self._count))

    def assemble(
        self, p: Array, start: Array | None = None, *, follow: bool = True, larger: float = 1.0
    ) -> tuple[Array, NDArray[np.bool_]]:
        """Passive coordinates (n, nx) at the measured poses (and of the assembly at home, which closes)."""
        x = np.tile(self.model.home, (len(self.q), 1)) if start is None else start

        def equations(x: Array, rows: NDArray[np.intp]) -> tuple[Array, Array, Array]:
            k, at = self._count, (x, self.q[rows], self.z[rows], p)
            pose, by_x, _, gap_x, *_ = self._kinematics(*at)
            slope = np.zeros((len(x), x.shape[1], x.shape[1]))
            slope[:, :k, :k], slope[:, k:, k:] = by_x[:, :, :k], gap_x[:, k:, k:]
            g = -_towards(self._measured[rows], pose)
            if x.shape[1] > k:
                g = np.hstack([g, self._loops.closure(*at)[0][:, k:]])
            return g, slope, np.zeros((len(x), 0, 1))

        return closed(equations, x, self._loops.scale)

    def of_rows(self, rows: NDArray[np.intp]) -> ClosurePredictor:
        """The same for some rows."""
        part = super().of_rows(rows)
        assert isinstance(part, ClosurePredictor)
        part._measured, part._whitener = self._measured[rows], self._whitener[rows]
        return part

    def blocks(self, p: Array, x: Array, weight: Array | NDArray[np.bool_] | None = None) -> Iterator[Block]:
        """All rows at once: gaps in units of their noise, and their Jacobian by p."""
        gap, slope = self._gaps(p, x)
        residual = np.squeeze(self._whitener @ gap, axis=-1)
        yield Block(slice(0, len(self.q)), residual, self._whitener @ slope)

    def _gaps(self, p: Array, x: Array) -> tuple[Array, Array]:
        """(n, k, 1) gaps and (n, k, np) their derivative by p, measured poses kept."""
        k = self._count
        _, by_x, by_p, gap_x, gap_p, *_ = self._kinematics(x, self.q, self.z, p)
        gap = self._loops.closure(x, self.q, self.z, p)[0]
        moved = -np.linalg.solve(by_x[:, :, :k], by_p)
        slope = gap_p[:, :k] + gap_x[:, :k, :k] @ moved
        if x.shape[1] > k:
            slope -= gap_x[:, :k, k:] @ np.linalg.solve(gap_x[:, k:, k:], gap_p[:, k:])
        return gap[:, :k], slope

    def _whitening(self) -> Array:
        """(n, k, k) inverse roots of the gaps' covariance under the pose's noise, at the drawing."""
        p = self.model.p_home
        x, _ = self.assemble(p)
        _, by_x, _, gap_x, *_ = self._kinematics(x, self.q, self.z, p)
        noise = np.diag([*3 * [self._sensor.sigma_xyz], *3 * [self._sensor.sigma_rot]])
        root = gap_x[:, : self._count, : self._count] @ np.linalg.solve(by_x[:, :, : self._count], noise)
        return np.asarray(np.linalg.inv(np.linalg.cholesky(root @ root.transpose(0, 2, 1))))


def _towards(goal: Array, pose: Array) -> Array:
    """(n, 6, 1) world twist from poses (n, 4, 4) to others."""
    turn = goal[:, :3, :3] @ pose[:, :3, :3].transpose(0, 2, 1)
    return np.hstack([goal[:, :3, 3] - pose[:, :3, 3], lie.log_so3(turn)])[..., None]


def _pose_sensor(machine: Machine) -> Pose:
    if len(machine.sensors) == 1 and isinstance(machine.sensors[0], Pose):
        return machine.sensors[0]
    found = ", ".join(sensor.type for sensor in machine.sensors) or "none"
    raise InputError(
        f"{machine.name}: sensor: found {found}, expected one of type pose for gaps at measured poses "
        "(`truepose poses` turns points into poses)"
    )


def _told(machine: Machine, unknowns: int) -> int:
    """How many passive coordinates there are, all of which the pose has to tell."""
    count = sum(COORDINATES[joint.kind] for joint in machine.mechanism.passive)
    known = sum(COORDINATES[joint.kind] for joint in machine.mechanism.unknown)
    if count != 6 or unknowns != known:
        raise InputError(
            f"{machine.name}: found {unknowns} unknowns of closed loops, expected the six of a platform on legs "
            "and no effect of loads: only those are known from a measured pose"
        )
    return count


__all__ = ["ClosurePredictor"]
