"""The drawing on a report's first page as data: what ``scene.js`` turns, and what a click tells.

Points and arrows are in the base's frame: where a sensor read each point, and by how much the model misses it there.
Coordinates are whole numbers, ``STEPS`` of them from the middle of the machine to its edge: fine enough for a screen, short
enough for a page.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.errors import TrueposeError
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.report.curves import reading_unit
from truepose.identification.report.phrases import measure
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES, element_of
from truepose.models.machine.skeleton import Piece, Skeleton, skeleton
from truepose.shown.document import Guilty, Scene

POSES, POINTS = 150, 1500
"""Most poses in which the whole machine is drawn, and most points."""
STEPS = 4000
"""From the middle of a drawing to its edge."""


def scene_of(
    before: Estimate, after: Estimate | None, recording: Recording, guilty: Sequence[Guilty]
) -> Scene | None:
    """Return the machine at its recorded poses with the residuals of one or two fits; None where it cannot be drawn.

    Rows without a finite residual are left out; of many rows some are drawn, evenly spread over the recording.
    """
    machine = before.nominal
    try:
        lines = skeleton(machine)
    except TrueposeError:
        return None
    good = np.flatnonzero(np.isfinite(before.residual).all(axis=1))
    if not len(good):
        return None
    fits = [before] if after is None else [before, after]
    seen = [sights(fit, recording) for fit in fits]
    poses = thinned(good, POSES)
    drawn = lines.points(recording.q[poses], fits[-1].x[poses], fits[-1].p[: len(machine.parameters)])
    lines = lines.around(drawn[0])
    turn = upright(machine)
    middle, half = _around(drawn[:, _solid(lines)] @ turn.T, seen[-1].points[good] @ turn.T)

    def whole(points: Array) -> list[int]:
        """Return (k, 3) points as a flat list of whole numbers."""
        return [int(v) for v in np.round(np.nan_to_num((points - middle) * STEPS / half)).ravel()]

    missed = np.where(before.used[poses], np.sum(before.residual[poses] ** 2, axis=1), -1.0)
    data: dict[str, Any] = {
        "size": half,
        "steps": STEPS,
        "pieces": [{"k": p.kind, "p": list(p.points), "c": p.kind == "plate"} for p in lines.pieces],
        "guilty": [pieces_of(one.place, lines.pieces, machine) for one in guilty],
        "poses": [whole(pose @ turn.T) for pose in _axes_scaled(drawn, lines, half)],
        "poseRows": poses.tolist(),
        "first": int(np.argmax(missed)),  # the pose that the fit misses most
        "up": "gravity" if machine.gravity and any(machine.gravity) else "base",
        **_points(seen, good, whole, turn),
        **_row_texts(machine, recording, fits, poses),
    }
    some = f"{len(poses)} of its {len(recording):,}" if len(poses) < len(recording) else f"its {len(poses)}"
    told = f"{machine.name} at {some} recorded poses, drawn by its own kinematics"
    if data["points"]:
        when = "of the calibration" if after is None else "before and after"
        told += (
            ", the points that were measured, and arrows from where the model has them to where they were measured"
            f" ({when}), enlarged"
        )
    return Scene(data, guilty, f"{told}.")


def thinned(rows: Index, most: int) -> Index:
    """Return at most ``most`` of some rows, evenly spread."""
    return rows if len(rows) <= most else rows[np.unique(np.linspace(0, len(rows) - 1, most).astype(np.intp))]


def upright(machine: Machine) -> Array:
    """Return the (3, 3) turn of the base's frame that puts up on top: against gravity where it is known, else along z."""
    if not machine.gravity or not any(machine.gravity):
        return np.eye(3)
    up = -np.array(machine.gravity) / np.linalg.norm(machine.gravity)
    side = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = side - (side @ up) * up
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(up, x), up]) if abs(up[2]) < 1.0 - 1e-9 else np.diag([1.0, up[2], up[2]])


def _solid(lines: Skeleton) -> list[int]:
    """Return the points of a skeleton but the ends of axes, whose length says nothing."""
    ends = {piece.points[1] for piece in lines.pieces if piece.kind == "axis"}
    return [k for piece in lines.pieces for k in piece.points if k not in ends]


def _axes_scaled(drawn: Array, lines: Skeleton, half: float) -> Array:
    """Return the points with axes as long as they read well: a thirtieth of the machine."""
    out = drawn.copy()
    for piece in lines.pieces:
        if piece.kind == "axis":
            start, end = piece.points
            out[:, end] = out[:, start] + (out[:, end] - out[:, start]) * half / 15.0
    return out


def _around(drawn: Array, points: Array) -> tuple[Array, float]:
    """Return the middle of what is drawn, mm, and half its size."""
    every = np.concatenate([drawn.reshape(-1, 3), points.reshape(-1, 3)])
    every = every[np.isfinite(every).all(axis=1)]
    low, high = every.min(axis=0), every.max(axis=0)
    return 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low)) or 1.0


@dataclass(frozen=True)
class Sights:
    """Points (n, k, 3), mm, in the base's frame, and arrows (n, k, 3), mm, from where the model has each point to where it was
    measured; NaN where nothing was read. k is 0 where no sensor reads points."""

    points: Array
    arrows: Array


def sights(fit: Estimate, recording: Recording) -> Sights:
    """Return what sensors of points saw in all rows of a fit, and what the fit misses there."""
    base = base_pose(fit)
    points, arrows, first = [], [], 0
    for sensor in fit.nominal.sensors:
        own = slice(first, first + len(sensor.channels))
        first = own.stop
        missed = -fit.residual[:, own] * [channel.sigma for channel in sensor.channels]
        if fit.lost is not None:
            missed = np.where(fit.lost[:, own], np.nan, missed)
        if sensor.view.relative or sensor.joints:  # its readings are in a frame that moves, or in none
            continue
        for point in dict.fromkeys(f"{c.kind}.{c.point}" for c in sensor.channels if c.unit == "mm"):
            at = [
                k for k, c in enumerate(sensor.channels) if f"{c.kind}.{c.point}" == point and c.unit == "mm"
            ]
            axes = [sensor.channels[k].name for k in at]
            if len(at) == 3 and all(name in recording.observations for name in axes):
                read = np.column_stack([recording.observations[name] for name in axes])
                arrow = np.where(np.isnan(read).any(axis=1, keepdims=True), np.nan, missed[:, at])
                points.append((read - base[:3, 3]) @ base[:3, :3])
                arrows.append(arrow @ base[:3, :3])
    empty = np.zeros((len(recording), 0, 3))
    return Sights(np.stack(points, axis=1), np.stack(arrows, axis=1)) if points else Sights(empty, empty)


def base_pose(fit: Estimate) -> Array:
    """Return the (4, 4) pose of the base in the sensor's frame."""
    values = dict(zip(fit.prior.names, fit.p.tolist(), strict=True))
    numbers = [ca.SX(values[f"base.{axis}"]) for axis in AXES]
    return np.array(ca.evalf(lie.rpy_transform(numbers[:3], numbers[3:])))


def _points(
    seen: Sequence[Sights], good: Index, whole: Callable[[Array], list[int]], turn: Array
) -> dict[str, Any]:
    """Return points, the row of each, and the arrows of both fits in nanometres."""
    count = seen[-1].points.shape[1]
    if not count:
        return {"points": [], "pointRows": [], "arrows": []}
    rows = thinned(good, max(POINTS // count, 1))
    place = seen[-1].points[rows].reshape(-1, 3)
    arrows = [one.arrows[rows].reshape(-1, 3) for one in seen]
    known = np.isfinite(place).all(axis=1) & np.all([np.isfinite(a).all(axis=1) for a in arrows], axis=0)
    told = [[int(v) for v in np.round(1e6 * (a[known] @ turn.T)).ravel()] for a in arrows]
    return {
        "points": whole(place[known] @ turn.T),
        "pointRows": np.repeat(rows, count)[known].tolist(),
        "arrows": told,
    }


def pieces_of(place: Sequence[str], pieces: Sequence[Piece], machine: Machine) -> list[int]:
    """Return the pieces that a place's names mean; none for a place that is not of the mechanism, such as a sensor.

    A name means, nearest first: itself, the part that it is of, the joint of a length that heats up.
    """
    found: list[int] = []
    for name in place:
        parts = [element_of(port) for port in machine.mechanism.lengths.get(name, ())]
        pools = (
            [k for k, piece in enumerate(pieces) if one in piece.names]
            for one in (name, element_of(name), *parts)
        )
        found += next((at for at in pools if at), [])
    return list(dict.fromkeys(found))


def _row_texts(
    machine: Machine, recording: Recording, fits: Sequence[Estimate], poses: Index
) -> dict[str, Any]:
    """Return what a click on a pose tells: file and row, joints, error of each fit."""
    units = [reading_unit(machine, name) for name in recording.joints]
    factors = np.array([factor for factor, _ in units])
    return {
        "joints": [f"{name} {unit}" for name, (_, unit) in zip(recording.joints, units, strict=True)],
        "q": [[float(f"{v:.5g}") for v in row] for row in (recording.q[poses] * factors).tolist()],
        "where": [
            f"{Path(recording.files[recording.source_file[k]]).name}, row {recording.source_row[k]}"
            for k in poses
        ],
        "errors": [[error_words(machine, fit, int(k)) for fit in fits] for k in poses],
    }


def error_words(machine: Machine, fit: Estimate, row: int) -> str:
    """Return a row's residual by kind of reading, of what was read: ``position 12.1 um, rotation 3.2 urad``."""
    said = []
    gone = np.zeros(len(machine.channels), dtype=bool) if fit.lost is None else fit.lost[row]
    for kind in dict.fromkeys(channel.kind for channel in machine.channels):
        at = [k for k, channel in enumerate(machine.channels) if channel.kind == kind and not gone[k]]
        if not at:
            said.append(f"{kind} not read")
            continue
        sigma = np.array([machine.channels[k].sigma for k in at])
        points = max(len({machine.channels[k].point for k in at}), 1)
        size = float(np.sqrt(np.sum((fit.residual[row, at] * sigma) ** 2) / points))
        said.append(f"{kind} {measure(size, machine.channels[at[0]].unit)}")
    return ", ".join(said)
