"""A drawn machine set against readings by moving base and tool alone: the cheap fit that every hypothesis is judged by.

Flange poses are worked out once for a hypothesis; only the two frames (and the constants of the instrument) then move, by
damped Gauss-Newton steps over a few dozen rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.identification.fit.align import ZEROS, transform, unknown_zeros
from truepose.identification.leaves.check.alignment import Frames, frames_from_poses, starts, tools
from truepose.identification.leaves.check.pair import Scene, Stand, chosen, differs
from truepose.identification.prediction.predictor import Predictor, lost_of
from truepose.identification.prediction.sensor_rows import Sight, joined, sights
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import FRAME_OF, FRAMES, Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.sensors.direction import Direction
from truepose.models.sensors.pose import Pose
from truepose.models.sensors.targets import Targets

# -- The least-squares fit of base and tool under one hypothesis: damped steps over a few dozen rows

KEPT = 0.8
"""Share of the rows, those that fit best, that a misfit is taken over: gross readings must not hide a slip."""
STEPS, FEW = 12, 4
"""Most steps of a fit, and of a quick one."""
_ENOUGH = 1e-3


class FrameFit:
    """The least-squares problem of the two frames (and the instrument's constants) for one hypothesis.

    Its unknowns (nt,) are the rig's ``ends``, with tolerances (np,) of all constants.
    """

    def __init__(
        self, rig: Rig, tolerance: Array, here: Predictor, flange: Array, good: Mask, scene: Scene
    ) -> None:
        self.rig, self.tolerance = rig, tolerance[rig.places]
        self.flange, self.good, self.scene, self.scale = flange, good, scene, rig.scale(scene)
        self.rows, self.comparisons = here.recording, here.comparisons()
        self.lost = [lost_of(sensor, here.recording) for sensor in rig.machine.sensors]
        n, k = len(flange), sum(len(s.columns) for s in rig.machine.sensors)
        self.shift, self.shift_by = np.zeros((n, k)), np.zeros((n, k, len(rig.ends)))

    def cost(self, base: Array, tool: Array, p: Array) -> float:
        """Misfit with base and tool (4, 4) there, all else at constants (np,)."""
        return trimmed(self._seen(base, tool, p[self.rig.places])[self.good])

    def descended(
        self, p: Array, free: tuple[str, ...], rows: Index, steps: int, held: tuple[str, ...] = ()
    ) -> Stand:
        """Return where damped steps from p (np,) end: frames ``free`` wherever, ``held`` nowhere, others as tolerances let."""
        rig, t, drawn = self.rig, p[self.rig.places], self.scene.p[self.rig.places]
        tolerance = self.tolerance.copy()
        tolerance[:12] = [
            np.inf if FRAME_OF[name] in free else 0.0 if FRAME_OF[name] in held else tolerance[k]
            for k, name in enumerate(rig.ends[:12])
        ]
        moving = np.flatnonzero(tolerance > 0)
        size = np.array(
            [100.0 if rig.machine.geometry[rig.ends[k]].unit == "mm" else 1.0 for k in moving.tolist()]
        )
        weight = size / tolerance[moving]
        if not (steps and len(moving)):
            return self._stand(p, self._seen(transform(t[:6]), transform(t[6:12]), t), rows)
        residual, jacobian = self._evaluate(t)
        best, damping = self._cost(residual, (t - drawn)[moving] / tolerance[moving]), 1e-3
        for _ in range(steps):
            noise = max(trimmed(residual[self.good]), 1.0)
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
        out[rig.places] = t
        return self._stand(out, residual, rows)

    def _cost(self, residual: Array, off: Array) -> float:
        """Return minus the logarithm of the likelihood a reading, with noise of a size that nobody knows.

        residual (n, m); off (k,): departures, in tolerances. What is left counts as noise: constants of which the file says how
        large they are do not bend for a misfit that they cannot explain.
        """
        left, count = trimmed(residual[self.good]), max(residual[self.good].size, 1)
        read = np.log(left) if left > 1.0 else (left**2 - 1.0) / 2.0
        return float(read + np.sum(off**2) / (2.0 * count))

    def _stand(self, p: Array, residual: Array, rows: Index) -> Stand:
        misfit, length = trimmed(residual[self.good]), self._length(residual)
        return Stand(p, misfit, length, residual * self.good[:, None], rows, self.scene)

    def _length(self, residual: Array) -> float | None:
        channels, long = self.rig.machine.channels, self.rig.long
        if not long.any():
            return None
        sigma = np.array([c.sigma for c in channels])
        points = {c.point for c in channels if c.unit == "mm"}
        mm = (residual * sigma / self.scale)[self.good][:, long]
        each = np.sort(np.sum(mm**2, axis=1) / max(len(points), 1))
        return float(np.sqrt(np.mean(each[: max(int(KEPT * len(each)), 1)])))

    def _seen(self, base: Array, tool: Array, t: Array) -> Array:
        """Residuals (n, m) alone."""
        pose = base @ self.flange @ tool
        every = zip(self.rig.sensors, self.comparisons, self.lost, strict=True)
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
        every = zip(self.rig.sensors, self.comparisons, self.lost, strict=True)
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


def trimmed(residual: Array) -> float:
    """Rms over the rows that fit best."""
    each = np.sort(_row_sizes(residual))
    kept = each[: max(int(np.ceil(KEPT * len(each))), 1)]
    return float(np.sqrt(np.mean(kept**2))) if len(kept) else float("inf")


def _weights(residual: Array) -> Array:
    """(n,) of Cauchy's loss, scaled by the middle row."""
    each = _row_sizes(residual)
    middle = float(np.median(each)) or 1.0
    return 1.0 / np.sqrt(1.0 + (each / (3.0 * middle)) ** 2)


# -- A drawn machine set against readings by moving base and tool alone: the cheap fit that every hypothesis is judged by

ABSURD = 0.02
"""Share of what the tool moves that no drawing is wrong by."""
_STARTS = 4
"""Places of base and tool that a fit starts from, the nearest first, where readings show no whole pose."""


class Rig:
    """One machine and the rows that hypotheses about it are judged by.

    long (m,): which channels are lengths; lengths (np,): which constants grow with the machine, mm or mm a turn; ends: names of
    the constants between the flange and a reading, the only ones that the cheap fit moves: six of the base, six of the tool,
    then the instrument's; places (nt,): where these are among all; sensors: their functions of these.
    """

    def __init__(self, machine: Machine, recording: Recording) -> None:
        self.machine, self.recording, self.actuators = machine, recording, machine.mechanism.actuators
        self.predictor = Predictor(
            machine, recording.subset(slice(0, 1)) if not differs(machine) else recording, machine.effects
        )
        self.names = list(self.predictor.model.names)
        self.at = {
            frame: np.array([self.names.index(f"{frame}.{axis}") for axis in AXES]) for frame in FRAMES
        }
        tolerance = {p.name: p.tolerance for p in machine.parameters}
        self.tolerance = np.array([tolerance.get(name, 0.0) for name in self.names])
        self.long = np.array([c.unit == "mm" for c in machine.channels])
        units = [machine.geometry[n].unit if n in machine.geometry else "" for n in self.names]
        self.lengths = np.array([unit.partition("/")[0] == "mm" for unit in units])
        self.angles = np.array([unit == "rad" for unit in units])
        self.wide = np.array([c.unit == "rad" for c in machine.channels])
        self.ends = [*FRAME_OF, *(p.name for s in machine.sensors for p in s.parameters)]
        self.places = np.array([self.names.index(name) for name in self.ends])
        self.sensors = sights(machine, self.ends, 1)
        self.scene = Scene(recording, self.predictor.model.p_home.copy())
        self.closed_form = any(
            isinstance(s, Pose) or (isinstance(s, Targets) and len(s.parameters) >= 9)
            for s in machine.sensors
        )
        spans = np.ptp(recording.q, axis=0)
        self.still = tuple(n for n, span in zip(recording.joints, spans, strict=True) if span == 0.0)
        self._stood: dict[tuple[object, ...], tuple[Array, Mask]] = {}
        """Flange poses by what they follow from: many hypotheses differ in sensors and frames alone."""
        self.scene = self._with_zeros()

    def _with_zeros(self) -> Scene:
        """The scene with zeros of joints that nobody knows where directions fit best.

        Only where nobody knows how the base is turned either: a base that is nearly known shows the zeros by itself.
        """
        scene, unknown = self.scene, unknown_zeros(self.machine)
        turned = np.isinf(self.tolerance[self.at["base"][3:]]).all()
        seeing = all(isinstance(sensor, Direction) for sensor in self.machine.sensors)
        if not (unknown and turned and seeing):
            return scene
        best = self.stand(scene, ("base",), quick=True)
        for name in unknown:
            if best.misfit <= ABSURD * motion(self, best):
                break
            for away in ZEROS:
                p = scene.p.copy()
                p[self.names.index(name)] += away
                tried = self.stand(replace(scene, p=p), ("base",), quick=True)
                best = min(best, tried, key=lambda stand: stand.misfit)
            scene = best.scene
        return scene

    def tolerances(self, scene: Scene, free: Sequence[str] = ()) -> Array:
        """(np,) tolerances as a hypothesis has them, mm or rad; none for the frames ``free``."""
        grown = np.where(self.lengths, scene.stated, np.where(self.angles, scene.turned, 1.0))
        tolerance: Array = grown * self.tolerance
        if scene.exchanged:
            base, tool = (self.at[frame] for frame in FRAMES)
            tolerance[base], tolerance[tool] = tolerance[tool], tolerance[base].copy()
        for frame in free:
            tolerance[self.at[frame]] = np.inf
        return tolerance

    def scale(self, scene: Scene) -> Array:
        """(m,) by what a hypothesis multiplies whitened residuals: those of another sigma."""
        return np.where(self.long, 1.0 / scene.coarse, np.where(self.wide, 1.0 / scene.turned, 1.0))

    def frames_of(self, p: Array) -> Frames:
        """Base and tool (4, 4) that constants have."""
        base, tool = (transform(p[self.at[frame]]) for frame in FRAMES)
        return base, tool

    def with_frames(self, p: Array, frames: Sequence[Array]) -> Array:
        """Constants with base and tool there."""
        out = p.copy()
        for frame, pose in zip(FRAMES, frames, strict=True):
            turns = _nearest(lie.rpy_of(pose[:3, :3]), p[self.at[frame][3:]])
            out[self.at[frame]] = [*pose[:3, 3], *turns]
        return out

    def stand(
        self,
        scene: Scene | None = None,
        free: tuple[str, ...] = FRAMES,
        *,
        quick: bool = False,
        also: Sequence[Frames] = (),
        held: tuple[str, ...] = (),
    ) -> Stand:
        """The best fit of the frames ``free``, wherever they are, others within their tolerance, also from closed forms.

        ``quick``: a few steps only, none where a closed form has it; ``also``: frames to start from beside those;
        ``held``: frames that stay where the scene has them.
        """
        scene = scene or self.scene
        rows = chosen(self.machine, scene)
        here = self.predictor.over(scene.rows.subset(rows))
        flange, good = self._flanges(here, scene)
        nothing = Stand(scene.p, float("inf"), None, np.zeros((0, len(self.long))), rows, scene)
        if len(rows) == 0 or good.mean() < 0.5:
            return nothing
        stated, tolerance = self.frames_of(scene.p), self.tolerances(scene)
        fit = FrameFit(self, tolerance, here, flange, good, scene)
        loose = [f for f in FRAMES if f in free or not np.isfinite(tolerance[self.at[f]]).all()]
        wide = [f for f in loose if f not in held]
        points, begins = self._points(scene.p), [stated]
        if "base" in wide:
            begins = list(starts(self.machine, here.recording, flange, stated, points))
        elif "tool" in wide:
            found = tools(self.machine, here.recording, stated[0] @ flange, points)
            begins += [(stated[0], tool) for tool in found]
        starting = [
            (base if "base" in wide else stated[0], tool if "tool" in wide else stated[1])
            for base, tool in (*begins, *also)
        ]
        if "base" in wide and "tool" not in (*wide, *held):
            starting += [one for one in begins if self._is_inside(one[1], stated[1], tolerance)]
        costs = [fit.cost(base, tool, scene.p) for base, tool in starting]
        if not np.isfinite(min(costs)):
            return nothing
        steps = (0 if self.closed_form and len(wide) == len(FRAMES) else FEW) if quick else STEPS
        several = 1 if quick or self.closed_form else _STARTS
        stands = [
            fit.descended(self.with_frames(scene.p, starting[k]), free, rows, steps, held)
            for k in np.argsort(costs, kind="stable")[:several].tolist()
            if np.isfinite(costs[k])
        ]
        return min(stands, key=lambda one: one.misfit)

    def _is_inside(self, tool: Array, stated: Array, tolerance: Array) -> bool:
        """Whether a tool (4, 4) is where tolerances (np,) let it be."""
        off = [*(tool[:3, 3] - stated[:3, 3]), *lie.log_so3(stated[:3, :3].T @ tool[:3, :3])]
        return bool((np.abs(off) <= 3.0 * tolerance[self.at["tool"]]).all())

    def frames_for(self, rows: Index, poses: Array) -> Iterator[Frames]:
        """Yield base and tool with which the machine as it stands has tool poses (n, 4, 4) at some rows (n,)."""
        here = self.predictor.over(self.recording.subset(rows))
        flange, good = self._flanges(here, self.scene)
        if good.sum() >= 3:
            yield from frames_from_poses(flange[good], poses[good], self.frames_of(self.scene.p)[1])

    def assembled(self, here: Predictor, p: Array, scene: Scene) -> tuple[Array, Mask]:
        """Passive coordinates (n, nx) with constants p (np,), and which rows could be assembled; rows out of Newton's reach
        are given up."""
        return here.assemble(p, follow=False, larger=scene.drawn)

    def residual(self, here: Predictor, p: Array, scene: Scene) -> tuple[Array, Mask]:
        """Whitened residuals (n, m) with constants p (np,), and which rows could be assembled."""
        x, good = self.assembled(here, p, scene)
        return np.concatenate([block.residual for block in here.blocks(p, x)]), good

    def _points(self, p: Array) -> Array | None:
        for sensor in self.machine.sensors:
            if isinstance(sensor, Targets):
                return p[[self.names.index(q.name) for q in sensor.parameters]].reshape(-1, 3)
        return None

    def _flanges(self, here: Predictor, scene: Scene) -> tuple[Array, Mask]:
        bare = scene.p.copy()
        for frame in FRAMES:
            bare[self.at[frame]] = 0.0
        arrays = (bare, here.q, here.z, here.origin)
        key = (scene.drawn, *(None if a is None else a.tobytes() for a in arrays))
        if key not in self._stood:
            x, good = self.assembled(here, bare, scene)
            self._stood[key] = here.poses(bare, x)[0], good
        return self._stood[key]


def _nearest(rpy: Array, stated: Array) -> Array:
    """Of the triples that mean the same rotation, the one nearest to the one that a file states."""
    roll, pitch, yaw = rpy
    same = [np.array([roll, pitch, yaw]), np.array([roll + np.pi, np.pi - pitch, yaw + np.pi])]
    same = [stated + (triple - stated + np.pi) % (2 * np.pi) - np.pi for triple in same]
    return min(same, key=lambda triple: float(np.linalg.norm(triple - stated)))


def motion(rig: Rig, stand: Stand) -> float:
    """Whitened rms of the readings about their mean over the rows judged."""
    rows = stand.scene.rows.subset(stand.rows)
    spread = [
        np.nanstd(rows.observations[c]) / channel.sigma
        for s in rig.machine.sensors
        for c, channel in zip(s.columns, s.channels, strict=False)
        if c in rows.observations
    ]
    return float(np.sqrt(np.mean(np.square(spread)))) if spread else float("inf")
