"""The drawing on a report's first page as data: what ``scene.js`` turns, and what a click tells.

Coordinates are whole numbers, ``STEPS`` of them from the middle of the machine to its edge: fine enough for a screen, short
enough for a page.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from truepose.arrays import Array, Index
from truepose.errors import TrueposeError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.drivers import reading_unit
from truepose.identification.report.numbers import measure
from truepose.identification.report.scene.guilt import pieces_of
from truepose.identification.report.scene.sights import Sights, sights
from truepose.models.machine.machine import Machine
from truepose.models.machine.skeleton import Skeleton, skeleton
from truepose.shown.document import Guilty, Scene

POSES, POINTS = 150, 1500
"""Most poses in which the whole machine is drawn, and most points."""
STEPS = 4000
"""From the middle of a drawing to its edge."""


def scene_of(
    before: Estimate, after: Estimate | None, recording: Recording, guilty: Sequence[Guilty]
) -> Scene | None:
    """The machine at its recorded poses, with the residuals of one or two fits; None where it cannot be drawn.

    Index without a finite residual are left out; of many rows some are drawn, evenly spread over the recording.
    """
    machine = before.nominal
    try:
        lines = skeleton(machine)
    except TrueposeError:
        return None
    good = np.flatnonzero(np.isfinite(before.residual).all(axis=1))
    if not len(good):
        return None
    last = before if after is None else after
    seen = [sights(fit, recording) for fit in ([before] if after is None else [before, after])]
    poses = thinned(good, POSES)
    drawn = lines.points(recording.q[poses], last.x[poses], last.p[: len(machine.parameters)])
    lines = lines.around(drawn[0])
    turn = upright(machine)
    frame = _Frame.around(drawn[:, _solid(lines)] @ turn.T, seen[-1].points[good] @ turn.T)
    pieces = [{"k": p.kind, "p": list(p.points), "c": p.kind == "plate"} for p in lines.pieces]
    places = [pieces_of(one.place, lines.pieces, machine) for one in guilty]
    data = {
        "size": frame.half,
        "steps": STEPS,
        "pieces": pieces,
        "guilty": places,
        "poses": [frame.whole(pose @ turn.T) for pose in _axes_scaled(drawn, lines, frame.half)],
        "poseRows": poses.tolist(),
        "first": _worst(before, poses),
        "up": "gravity" if machine.gravity and any(machine.gravity) else "base",
        **_points(seen, good, frame, turn),
        **_told_of_rows(machine, recording, before, after, poses),
    }
    return Scene(data, guilty, _told(machine, len(poses), len(recording), after is not None))


def _worst(fit: Estimate, poses: Index) -> int:
    """The pose that the fit misses most, of those that it was fitted to: the one that is shown first."""
    missed = np.sum(fit.residual[poses] ** 2, axis=1)
    return int(np.argmax(np.where(fit.used[poses], missed, -1.0)))


def thinned(rows: Index, most: int) -> Index:
    """At most ``most`` of some rows, evenly spread."""
    return rows if len(rows) <= most else rows[np.unique(np.linspace(0, len(rows) - 1, most).astype(np.intp))]


def upright(machine: Machine) -> Array:
    """(3, 3) turn of the base's frame that puts up on top: against gravity where it is known, else along z."""
    if not machine.gravity or not any(machine.gravity):
        return np.eye(3)
    up = -np.array(machine.gravity) / np.linalg.norm(machine.gravity)
    side = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = side - (side @ up) * up
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up]) if abs(up[2]) < 1.0 - 1e-9 else np.diag([1.0, up[2], up[2]])


def _solid(lines: Skeleton) -> list[int]:
    """Points of a skeleton but the ends of axes, whose length says nothing."""
    ends = {piece.points[1] for piece in lines.pieces if piece.kind == "axis"}
    return [k for piece in lines.pieces for k in piece.points if k not in ends]


def _axes_scaled(drawn: Array, lines: Skeleton, half: float) -> Array:
    """Axes as long as they read well: a thirtieth of the machine."""
    out = drawn.copy()
    for piece in lines.pieces:
        if piece.kind == "axis":
            start, end = piece.points
            out[:, end] = out[:, start] + (out[:, end] - out[:, start]) * half / 15.0
    return out


@dataclass(frozen=True)
class _Frame:
    """The middle of what is drawn, mm, and half its size."""

    middle: Array
    half: float

    @classmethod
    def around(cls, drawn: Array, points: Array) -> _Frame:
        every = np.concatenate([drawn.reshape(-1, 3), points.reshape(-1, 3)])
        every = every[np.isfinite(every).all(axis=1)]
        low, high = every.min(axis=0), every.max(axis=0)
        return cls(0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0)

    def whole(self, points: Array) -> list[int]:
        """(k, 3) points as a flat list of whole numbers."""
        scaled = (points - self.middle) * STEPS / self.half
        return [int(v) for v in np.round(np.nan_to_num(scaled)).ravel()]


def _points(seen: Sequence[Sights], good: Index, frame: _Frame, turn: Array) -> dict[str, Any]:
    """Points, the row of each, and the arrows of both fits in nanometres."""
    count = seen[-1].points.shape[1]
    if not count:
        return {"points": [], "pointRows": [], "arrows": []}
    rows = thinned(good, max(POINTS // count, 1))
    place = seen[-1].points[rows].reshape(-1, 3)
    arrows = [one.arrows[rows].reshape(-1, 3) for one in seen]
    known = np.isfinite(place).all(axis=1) & np.all([np.isfinite(a).all(axis=1) for a in arrows], axis=0)
    told = [[int(v) for v in np.round(1e6 * (a[known] @ turn.T)).ravel()] for a in arrows]
    return {
        "points": frame.whole(place[known] @ turn.T),
        "pointRows": np.repeat(rows, count)[known].tolist(),
        "arrows": told,
    }


def _told_of_rows(
    machine: Machine, recording: Recording, before: Estimate, after: Estimate | None, poses: Index
) -> dict[str, Any]:
    """What a click on a pose tells: file and row, joints, error before and after."""
    fits = [before] if after is None else [before, after]
    names = [f"{name} {reading_unit(machine, name)[1]}" for name in recording.joints]
    factors = np.array([reading_unit(machine, name)[0] for name in recording.joints])
    return {
        "joints": names,
        "q": [[float(f"{v:.5g}") for v in row] for row in (recording.q[poses] * factors).tolist()],
        "where": [
            f"{Path(recording.files[recording.source_file[k]]).name}, row {recording.source_row[k]}"
            for k in poses
        ],
        "errors": [[error_words(machine, fit, int(k)) for fit in fits] for k in poses],
    }


def error_words(machine: Machine, fit: Estimate, row: int) -> str:
    """A row's residual by kind of reading, of what was read: ``position 12.1 um, rotation 3.2 urad``."""
    said = []
    gone = np.zeros(len(machine.channels), dtype=bool) if fit.lost is None else fit.lost[row]
    for kind in dict.fromkeys(channel.kind for channel in machine.channels):
        every = [k for k, channel in enumerate(machine.channels) if channel.kind == kind]
        at = [k for k in every if not gone[k]]
        if not at:
            said.append(f"{kind} not read")
            continue
        sigma = np.array([machine.channels[k].sigma for k in at])
        points = max(len({machine.channels[k].point for k in at}), 1)
        size = float(np.sqrt(np.sum((fit.residual[row, at] * sigma) ** 2) / points))
        said.append(f"{kind} {measure(size, machine.channels[at[0]].unit)}")
    return ", ".join(said)


def _told(machine: Machine, poses: int, rows: int, two: bool) -> str:
    some = f"{poses} of its {rows:,} recorded poses" if poses < rows else f"its {poses} recorded poses"
    arrows = "before and after" if two else "of the calibration"
    return (
        f"{machine.name} at {some}, drawn by its own kinematics, the points that were measured, and arrows from where the"
        f" model has them to where they were measured ({arrows}), enlarged."
    )


__all__ = ["Scene", "error_words", "scene_of", "thinned", "upright"]
