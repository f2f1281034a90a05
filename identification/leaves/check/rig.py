"""A drawn machine set against readings by moving base and tool alone: the cheap fit that every hypothesis is judged by.

Flange poses are worked out once for a hypothesis; only the two frames (and the constants of the instrument) then move, by
damped Gauss-Newton steps over a few dozen rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.align import ZEROS, unknown_zeros
from truepose.identification.leaves.check.alignment import Frames, frames_from_poses, starts, tools
from truepose.identification.leaves.check.frame_fit import FEW, KEPT, STEPS, Ends, FrameFit, transform
from truepose.identification.leaves.check.scene import Array, Mask, Scene, Stand, chosen, differs
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.sensor_rows import sights
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import FRAME_OF, FRAMES, Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.sensors.direction import Direction
from truepose.models.sensors.pose import Pose
from truepose.models.sensors.targets import Targets

ABSURD = 0.02
"""Share of what the tool moves that no drawing is wrong by."""
_STARTS = 4
"""Places of base and tool that a fit starts from, the nearest first, where readings show no whole pose."""


class Rig:
    """One machine and the rows that hypotheses about it are judged by.

    long (m,): which channels are lengths; lengths (np,): which constants grow with the machine, mm or mm a turn.
    """

    def __init__(self, machine: Machine, recording: Recording) -> None:
        self.machine, self.recording = machine, recording
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
        seen = [*FRAME_OF, *(p.name for s in machine.sensors for p in s.parameters)]
        places = np.array([self.names.index(name) for name in seen])
        self.ends = Ends(machine, seen, places, self.tolerance[places], sights(machine, seen, 1), self.long)
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

    def tolerances(self, scene: Scene) -> Array:
        """(np,) tolerances as a hypothesis has them, mm or rad."""
        grown = np.where(self.lengths, scene.stated, np.where(self.angles, scene.turned, 1.0))
        tolerance: Array = grown * self.tolerance
        if scene.exchanged:
            base, tool = (self.at[frame] for frame in FRAMES)
            tolerance[base], tolerance[tool] = tolerance[tool], tolerance[base].copy()
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
        ends = replace(self.ends, tolerance=self.tolerances(scene)[self.ends.places])
        fit = FrameFit(ends, here, flange, good, scene, self.scale(scene))
        stated = self.frames_of(scene.p)
        tolerance = self.tolerances(scene)
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

    def frames_for(self, rows: NDArray[np.intp], poses: Array) -> Iterator[Frames]:
        """Yield base and tool with which the machine as it stands has tool poses (n, 4, 4) at some rows (n,)."""
        here = self.predictor.over(self.recording.subset(rows))
        flange, good = self._flanges(here, self.scene)
        if good.sum() >= 3:
            yield from frames_from_poses(flange[good], poses[good], self.frames_of(self.scene.p)[1])

    def assembled(self, here: Predictor, p: Array, scene: Scene) -> tuple[Array, Mask]:
        """Passive coordinates (n, nx) with constants p (np,), and which rows could be assembled; rows out of Newton's reach
        are given up."""
        return here.assemble(p, follow=False, larger=scene.drawn)

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


__all__ = ["ABSURD", "KEPT", "Rig", "Scene", "Stand", "motion"]
