"""A drawn machine set against readings by moving base and tool alone: the cheap fit that every hypothesis is judged by.

Flange poses are worked out once for a hypothesis; only the two frames (and the constants of the instrument) then move, by
damped Gauss-Newton steps over a few dozen rows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.check.alignment import Frames, starts
from truepose.identification.prediction.lost import lost_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import Sight, joined, sights
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine import FRAME_OF, FRAMES, Machine
from truepose.models.mechanism import AXES
from truepose.models.sensors.pose import Pose
from truepose.models.sensors.targets import Targets

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MOST_ROWS = 45
"""Rows that a hypothesis is judged by: enough to tell slips apart, few enough for a hundred hypotheses in a second."""
KEPT = 0.8
"""Share of the rows, those that fit best, that a misfit is taken over: gross readings must not hide a slip."""
ABSURD = 0.02
"""Share of what the tool moves that no drawing is wrong by."""
_STEPS, _FEW, _ENOUGH = 12, 4, 1e-3


@dataclass(frozen=True)
class Scene:
    """What a hypothesis says: all rows (their readings may be changed), constants p (np,), the factor by which it changed
    measured lengths, and the rows (n,) that it leaves without a reading."""

    rows: Recording
    p: Array
    size: float = 1.0
    lost: Mask | None = None

    def with_joints(self, q: Array) -> Scene:
        """The same with other readings of the joints (n, nq)."""
        return replace(self, rows=replace(self.rows, q=q))

    def with_columns(self, columns: Mapping[str, Array], size: float = 1.0) -> Scene:
        """The same with other columns (n,) of the sensors, lengths of which were multiplied by ``size``."""
        seen = {**self.rows.observations, **columns}
        return replace(self, rows=replace(self.rows, observations=seen), size=self.size * size)


@dataclass(frozen=True)
class Stand:
    """Where base and tool stand best: constants p (np,), and what is left.

    misfit: whitened rms over the rows that fit best, lengths in the unit that they were recorded in; length: rms of the 3-D
    error, mm, None where no length is read; residual (n, m) whitened; rows: places (n,) of the rows judged.
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


class Rig:
    """One machine and the rows that hypotheses about it are judged by."""

    def __init__(self, machine: Machine, recording: Recording) -> None:
        self.machine, self.recording = machine, recording
        self.predictor = Predictor(
            machine, recording.subset(slice(0, 1)) if not _differs(machine) else recording, machine.effects
        )
        self.names = list(self.predictor.model.names)
        self.at = {
            frame: np.array([self.names.index(f"{frame}.{axis}") for axis in AXES]) for frame in FRAMES
        }
        self.seen = [*FRAME_OF, *(p.name for s in machine.sensors for p in s.parameters)]
        """Constants between the flange and a reading: the only ones that the cheap fit moves."""
        self.places = np.array([self.names.index(name) for name in self.seen])
        self.sensors = sights(machine, self.seen, 1)
        tolerance = {p.name: p.tolerance for p in machine.parameters}
        self.tolerance = np.array([tolerance.get(name, 0.0) for name in self.names])
        self.scene = Scene(recording, self.predictor.model.p_home.copy())
        self.closed_form = any(
            isinstance(s, Pose) or (isinstance(s, Targets) and len(s.parameters) >= 9)
            for s in machine.sensors
        )
        spans = np.ptp(recording.q, axis=0)
        self.still = tuple(n for n, span in zip(recording.joints, spans, strict=True) if span == 0.0)
        self.long = np.array([c.unit == "mm" for c in machine.channels])

    def chosen(self, scene: Scene) -> NDArray[np.intp]:
        """Places of the rows to judge by, spread over the recording; with those that ``from`` names."""
        use = ~scene.rows.validation
        if scene.lost is not None:
            use &= ~scene.lost
        if not use.any():
            return np.zeros(0, dtype=np.intp)
        rows = np.flatnonzero(use)
        if _differs(self.machine) and scene.rows.from_row is not None:
            return self._with_origins(rows, scene.rows.from_row)
        step = np.unique(np.linspace(0, len(rows) - 1, min(MOST_ROWS, len(rows))).round().astype(int))
        return rows[step]

    def _with_origins(self, rows: NDArray[np.intp], origin: NDArray[np.int64]) -> NDArray[np.intp]:
        """The first row of each motion that was read, so that repeats do not crowd out poses."""
        q = self.recording.q
        told = np.column_stack([q[rows], q[origin[rows]]])
        moved = rows[np.any(q[rows] != q[origin[rows]], axis=1)]
        first = np.sort(np.unique(told, axis=0, return_index=True)[1])
        wanted = np.intersect1d(rows[first], moved)
        wanted = (
            wanted[
                np.unique(np.linspace(0, len(wanted) - 1, min(MOST_ROWS, len(wanted))).round().astype(int))
            ]
            if len(wanted)
            else rows[:1]
        )
        while True:
            closed = np.unique(np.concatenate([wanted, origin[wanted]]))
            if len(closed) == len(wanted):
                return closed
            wanted = closed

    def frames_of(self, p: Array) -> Frames:
        """Base and tool (4, 4) that constants have."""
        out = []
        for frame in FRAMES:
            out.append(_frame(p[self.at[frame]]))
        return out[0], out[1]

    def with_frames(self, p: Array, frames: Sequence[Array]) -> Array:
        """Constants with base and tool there."""
        out = p.copy()
        for frame, pose in zip(FRAMES, frames, strict=True):
            out[self.at[frame]] = [*pose[:3, 3], *lie.rpy_of(pose[:3, :3])]
        return out

    def stand(
        self,
        scene: Scene | None = None,
        free: tuple[str, ...] = FRAMES,
        *,
        aligned: bool = True,
        quick: bool = False,
    ) -> Stand:
        """The best fit of the frames ``free``, wherever they are, others within their tolerance; ``aligned``: also from
        closed forms; ``quick``: a few steps only, none where a closed form has it."""
        scene = scene or self.scene
        rows = self.chosen(scene)
        here = self.predictor.over(scene.rows.subset(rows))
        flange, good = self._flanges(here, scene.p)
        nothing = Stand(scene.p, float("inf"), None, np.zeros((0, len(self.long))), rows, scene)
        if len(rows) == 0 or good.mean() < 0.5:
            return nothing
        fit = _Frames(self, here, flange, good, scene)
        stated = self.frames_of(scene.p)
        wide = [f for f in FRAMES if f in free or not np.isfinite(self.tolerance[self.at[f]]).all()]
        begins = (
            starts(self.machine, here.recording, flange, stated, self._points(scene.p))
            if aligned and "base" in wide
            else [stated]
        )
        best: tuple[float, Array] | None = None
        for frames in begins:
            p = self.with_frames(
                scene.p, [f if name in wide else s for name, f, s in zip(FRAMES, frames, stated, strict=True)]
            )
            cost = fit.cost(p)
            if best is None or cost < best[0]:
                best = (cost, p)
        if best is None or not np.isfinite(best[0]):
            return nothing
        steps = (0 if self.closed_form else _FEW) if quick else _STEPS
        return fit.descended(best[1], free, rows, steps)

    def away(self, p: Array) -> float:
        """How far constants (np,) have base and tool from where the file says, in tolerances; 0 where those are infinite."""
        places = np.concatenate([self.at[frame] for frame in FRAMES])
        tolerance = np.maximum(self.tolerance[places], np.where(np.arange(12) % 6 < 3, 1.0, 0.01))
        there, here = self.frames_of(p), self.frames_of(self.scene.p)
        off = [
            np.concatenate([b[:3, 3] - a[:3, 3], lie.log_so3(a[:3, :3].T @ b[:3, :3])])
            for a, b in zip(here, there, strict=True)
        ]
        return float(np.linalg.norm(np.concatenate(off) / tolerance))

    def _points(self, p: Array) -> Array | None:
        for sensor in self.machine.sensors:
            if isinstance(sensor, Targets):
                return p[[self.names.index(q.name) for q in sensor.parameters]].reshape(-1, 3)
        return None

    def _flanges(self, here: Predictor, p: Array) -> tuple[Array, Mask]:
        bare = p.copy()
        for frame in FRAMES:
            bare[self.at[frame]] = 0.0
        x, good = here.assemble(bare, follow=False)
        return here.poses(bare, x)[0], good


class _Frames:
    """The least-squares problem of the two frames (and the instrument's constants) for one hypothesis.

    Its unknowns are those of ``Rig.seen``: six of the base, six of the tool, then the instrument's.
    """

    def __init__(self, rig: Rig, here: Predictor, flange: Array, good: Mask, scene: Scene) -> None:
        self.rig, self.flange, self.good, self.scene = rig, flange, good, scene
        self.rows, self.comparisons = here.recording, here.comparisons()
        self.lost = [lost_of(sensor, here.recording) for sensor in rig.machine.sensors]
        n, k = len(flange), sum(len(s.columns) for s in rig.machine.sensors)
        self.shift, self.shift_by = np.zeros((n, k)), np.zeros((n, k, len(rig.seen)))
        self.scale = np.where(rig.long, 1.0 / scene.size, 1.0)

    def cost(self, p: Array) -> float:
        """Misfit at constants (np,)."""
        return _trimmed(self._evaluate(p[self.rig.places])[0][self.good])

    def descended(self, p: Array, free: tuple[str, ...], rows: NDArray[np.intp], steps: int) -> Stand:
        """Where damped steps from constants (np,) end; the instrument's are held by their tolerances."""
        rig, t, drawn = self.rig, p[self.rig.places], self.scene.p[self.rig.places]
        tolerance = rig.tolerance[rig.places]
        tolerance[:12] = [
            np.inf if FRAME_OF[name] in free else tolerance[k] for k, name in enumerate(rig.seen[:12])
        ]
        moving = np.flatnonzero(tolerance > 0)
        size = np.array([100.0 if rig.machine.geometry[rig.seen[k]].unit == "mm" else 1.0 for k in moving])
        weight = size / tolerance[moving]
        residual, jacobian = self._evaluate(t)
        best, damping = _trimmed(residual[self.good]), 1e-3
        for _ in range(steps if len(moving) else 0):
            heed = _weights(residual) * self.good
            j = (jacobian[:, :, moving] * heed[:, None, None]).reshape(-1, len(moving)) * size
            right = (
                j.T @ (residual * heed[:, None]).reshape(-1) + weight * (t - drawn)[moving] / size * weight
            )
            normal = j.T @ j + np.diag(weight**2)
            floor = 1e-9 * max(float(np.diag(normal).max(initial=0.0)), 1e-300)
            step = np.linalg.solve(
                normal + np.diag(damping * np.maximum(np.diag(normal), floor) + floor * 1e-3), right
            )
            trial = t.copy()
            trial[moving] -= step * size
            fresh, slopes = self._evaluate(trial)
            now = _trimmed(fresh[self.good])
            if now < best:
                gained = (best - now) / best
                t, residual, jacobian, best, damping = trial, fresh, slopes, now, max(damping / 10, 1e-9)
                if gained < _ENOUGH:
                    break
            elif damping > 1e6:
                break
            else:
                damping *= 30
        out = p.copy()
        out[rig.places] = t
        return Stand(out, best, self._length(residual), residual * self.good[:, None], rows, self.scene)

    def _length(self, residual: Array) -> float | None:
        rig = self.rig
        if not rig.long.any():
            return None
        sigma = np.array([c.sigma for c in rig.machine.channels])
        points = {c.point for c in rig.machine.channels if c.unit == "mm"}
        mm = (residual * sigma / self.scale)[self.good][:, rig.long]
        each = np.sort(np.sum(mm**2, axis=1) / max(len(points), 1))
        return float(np.sqrt(np.mean(each[: max(int(KEPT * len(each)), 1)])))

    def _evaluate(self, t: Array) -> tuple[Array, Array]:
        """Residuals (n, m) and their Jacobian (n, m, nt)."""
        base, tool = _frame(t[:6]), _frame(t[6:12])
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
        every = zip(self.rig.sensors, self.comparisons, self.lost, strict=True)
        block = joined(rows, [f.block(sight, t, self.rows, rows, c, gone) for f, c, gone in every])
        residual = np.nan_to_num(block.residual, nan=1e12)
        return residual * self.scale, block.jacobian * self.scale[:, None]


def _frame(t: Array) -> Array:
    """(4, 4) transform of x y z and roll pitch yaw (6,)."""
    out = np.eye(4)
    out[:3, 3], out[:3, :3] = t[:3], _rpy(t[3:])
    return out


def _rpy(rpy: Array) -> Array:
    """(3, 3) Rz(yaw) Ry(pitch) Rx(roll)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _turning(rpy: Array) -> Array:
    """(3, 3) axes, as columns, about which a frame Rz(yaw) Ry(pitch) Rx(roll) turns with roll, pitch and yaw."""
    (_, cp, cy), (_, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array([[cy * cp, -sy, 0.0], [sy * cp, cy, 0.0], [-sp, 0.0, 1.0]])


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


def motion(rig: Rig, stand: Stand) -> float:
    """Whitened rms of the readings about their mean over the rows judged."""
    rows = stand.scene.rows.subset(stand.rows)
    spread = [
        np.nanstd(rows.observations[c]) / channel.sigma
        for s in rig.machine.sensors
        for c, channel in zip(s.columns, s.channels, strict=False)
        if c in rows.observations
    ]
    return float(np.sqrt(np.mean(np.square(spread)))) / stand.scene.size if spread else float("inf")


def _differs(machine: Machine) -> bool:
    return any(sensor.differs_from_row for sensor in machine.sensors)


__all__ = ["ABSURD", "KEPT", "Rig", "Scene", "Stand", "motion"]
