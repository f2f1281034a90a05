"""The least-squares fit of base and tool under one hypothesis: damped steps over a few dozen rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.align import transform
from truepose.identification.leaves.check.scene import Array, Mask, Scene, Stand
from truepose.identification.prediction.predictor import Predictor, lost_of
from truepose.identification.prediction.sensor_rows import SensorFunctions, Sight, joined
from truepose.models.machine.machine import FRAME_OF, Machine

KEPT = 0.8
"""Share of the rows, those that fit best, that a misfit is taken over: gross readings must not hide a slip."""
STEPS, FEW = 12, 4
"""Most steps of a fit, and of a quick one."""
_ENOUGH = 1e-3


@dataclass(frozen=True)
class Ends:
    """What lies between the flange and a reading: the only constants that the cheap fit moves.

    names (nt,): six of the base, six of the tool, then the instrument's; places (nt,) and tolerance (nt,) of them among all
    constants; sensors: their functions of these; long (m,): which channels are lengths.
    """

    machine: Machine
    names: Sequence[str]
    places: NDArray[np.intp]
    tolerance: Array
    sensors: Sequence[SensorFunctions]
    long: Mask


class FrameFit:
    """The least-squares problem of the two frames (and the instrument's constants) for one hypothesis.

    Its unknowns (nt,) are those of ``Ends``.
    """

    def __init__(
        self, ends: Ends, here: Predictor, flange: Array, good: Mask, scene: Scene, scale: Array
    ) -> None:
        self.ends, self.flange, self.good, self.scene = ends, flange, good, scene
        self.rows, self.comparisons = here.recording, here.comparisons()
        self.lost = [lost_of(sensor, here.recording) for sensor in ends.machine.sensors]
        n, k = len(flange), sum(len(s.columns) for s in ends.machine.sensors)
        self.scale = scale
        self.shift, self.shift_by = np.zeros((n, k)), np.zeros((n, k, len(ends.names)))

    def cost(self, base: Array, tool: Array, p: Array) -> float:
        """Misfit with base and tool (4, 4) there, all else at constants (np,)."""
        return _trimmed(self._seen(base, tool, p[self.ends.places])[self.good])

    def descended(
        self, p: Array, free: tuple[str, ...], rows: NDArray[np.intp], steps: int, held: tuple[str, ...] = ()
    ) -> Stand:
        """Return where damped steps from p (np,) end: frames ``free`` wherever, ``held`` nowhere, others as tolerances let."""
        ends, t, drawn = self.ends, p[self.ends.places], self.scene.p[self.ends.places]
        tolerance = ends.tolerance.copy()
        tolerance[:12] = [
            np.inf if FRAME_OF[name] in free else 0.0 if FRAME_OF[name] in held else tolerance[k]
            for k, name in enumerate(ends.names[:12])
        ]
        moving = np.flatnonzero(tolerance > 0)
        size = np.array(
            [100.0 if ends.machine.geometry[ends.names[k]].unit == "mm" else 1.0 for k in moving.tolist()]
        )
        weight = size / tolerance[moving]
        if not (steps and len(moving)):
            return self._stand(p, self._seen(transform(t[:6]), transform(t[6:12]), t), rows)
        residual, jacobian = self._evaluate(t)
        best, damping = self._cost(residual, (t - drawn)[moving] / tolerance[moving]), 1e-3
        for _ in range(steps):
            noise = max(_trimmed(residual[self.good]), 1.0)
            heed = _weights(residual) * self.good
            j = (jacobian[:, :, moving] * heed[:, None, None]).reshape(-1, len(moving)) * size
            away = (noise * weight) ** 2 * (t - drawn)[moving] / size
            step = _damped(j, (residual * heed[:, None]).reshape(-1), away, noise * weight, damping)
            trial = t.copy()
            trial[moving] -= step * size
            fresh, slopes = self._evaluate(trial)
            now = self._cost(fresh, (trial - drawn)[moving] / tolerance[moving])
            if now < best:
                gained = best - now
                t, residual, jacobian, best, damping = trial, fresh, slopes, now, max(damping / 10, 1e-9)
                if gained < _ENOUGH:
                    break
            elif damping > 1e6:
                break
            else:
                damping *= 30
        out = p.copy()
        out[ends.places] = t
        return self._stand(out, residual, rows)

    def _cost(self, residual: Array, off: Array) -> float:
        """Return minus the logarithm of the likelihood a reading, with noise of a size that nobody knows.

        residual (n, m); off (k,): departures, in tolerances. What is left counts as noise: constants of which the file says how
        large they are do not bend for a misfit that they cannot explain.
        """
        left, count = _trimmed(residual[self.good]), max(residual[self.good].size, 1)
        read = np.log(left) if left > 1.0 else (left**2 - 1.0) / 2.0
        return float(read + np.sum(off**2) / (2.0 * count))

    def _stand(self, p: Array, residual: Array, rows: NDArray[np.intp]) -> Stand:
        misfit, length = _trimmed(residual[self.good]), self._length(residual)
        return Stand(p, misfit, length, residual * self.good[:, None], rows, self.scene)

    def _length(self, residual: Array) -> float | None:
        ends = self.ends
        if not ends.long.any():
            return None
        sigma = np.array([c.sigma for c in ends.machine.channels])
        points = {c.point for c in ends.machine.channels if c.unit == "mm"}
        mm = (residual * sigma / self.scale)[self.good][:, ends.long]
        each = np.sort(np.sum(mm**2, axis=1) / max(len(points), 1))
        return float(np.sqrt(np.mean(each[: max(int(KEPT * len(each)), 1)])))

    def _seen(self, base: Array, tool: Array, t: Array) -> Array:
        """Residuals (n, m) alone."""
        pose = base @ self.flange @ tool
        every = zip(self.ends.sensors, self.comparisons, self.lost, strict=True)
        residual = np.hstack([f.residual(pose, t, self.rows, c, gone) for f, c, gone in every])
        return np.nan_to_num(residual, nan=1e12) * self.scale

    def _evaluate(self, t: Array) -> tuple[Array, Array]:
        """Residuals (n, m) and their Jacobian (n, m, nt)."""
        base, tool = transform(t[:6]), transform(t[6:12])
        pose = base @ self.flange @ tool
        twist = np.zeros((len(pose), 6, len(t)))
        about = _turning(t[3:6])
        twist[:, :3, :3] = np.eye(3)
        twist[:, 3:, 3:6] = about
        twist[:, :3, 3:6] = np.cross(about.T[None], (pose[:, :3, 3] - base[:3, 3])[:, None]).transpose(
            0, 2, 1
        )
        carried = base[:3, :3] @ self.flange[:, :3, :3]
        twist[:, :3, 6:9] = carried
        twist[:, 3:, 9:12] = carried @ _turning(t[9:12])
        sight, rows = Sight(pose, twist, self.shift, self.shift_by), slice(0, len(pose))
        every = zip(self.ends.sensors, self.comparisons, self.lost, strict=True)
        block = joined(rows, [f.block(sight, t, self.rows, rows, c, gone) for f, c, gone in every])
        return np.nan_to_num(block.residual, nan=1e12) * self.scale, block.jacobian * self.scale[:, None]


def _turning(rpy: Array) -> Array:
    """(3, 3) axes, as columns, about which a frame Rz(yaw) Ry(pitch) Rx(roll) turns with roll, pitch and yaw."""
    (_, cp, cy), (_, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array([[cy * cp, -sy, 0.0], [sy * cp, cy, 0.0], [-sp, 0.0, 1.0]])


def _damped(j: Array, residual: Array, away: Array, weight: Array, damping: float) -> Array:
    """(k,) a damped Gauss-Newton step: Jacobian (r, k), residual (r,), what the tolerances pull by (k,), their weight (k,)."""
    right = j.T @ residual + away
    normal = j.T @ j + np.diag(weight**2)
    floor = 1e-9 * max(float(np.diag(normal).max(initial=0.0)), 1e-300)
    more = np.diag(damping * np.maximum(np.diag(normal), floor) + floor * 1e-3)
    return np.asarray(np.linalg.solve(normal + more, right))


def _row_sizes(residual: Array) -> Array:
    return np.sqrt(np.mean(residual**2, axis=1)) if residual.shape[1] else np.zeros(len(residual))


def _trimmed(residual: Array) -> float:
    """Rms over the rows that fit best."""
    each = np.sort(_row_sizes(residual))
    kept = each[: max(int(np.ceil(KEPT * len(each))), 1)]
    return float(np.sqrt(np.mean(kept**2))) if len(kept) else float("inf")


def _weights(residual: Array) -> Array:
    """(n,) of Cauchy's loss, scaled by the middle row."""
    each = _row_sizes(residual)
    middle = float(np.median(each)) or 1.0
    return 1.0 / np.sqrt(1.0 + (each / (3.0 * middle)) ** 2)


__all__ = ["FEW", "KEPT", "STEPS", "Ends", "FrameFit", "transform"]
