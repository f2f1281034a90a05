"""Where base and tool must stand so that a drawn machine meets what was measured: closed forms to start a fit from.

Measured poses M_k = B F_k T of flange poses F_k give rotations from one null vector (M_k Y = B F_k with Y the inverse of T;
Shah, J. Mechanisms Robotics 5, 2013, in its linear form) and translations from one linear system. Points alone give B by
a rigid motion for the tool as it is stated, and directions alone as ``truepose.identification.fit.align`` has it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from truepose.arrays import Array, Mask
from truepose.identification.fit.align import base_of, station_of
from truepose.identification.recording.recording import Recording
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import TOOL_IN_WORLD, Sensor
from truepose.models.sensors.ballbar import BallBar
from truepose.models.sensors.direction import ORIGIN, Direction
from truepose.models.sensors.pose import Pose, Position
from truepose.models.sensors.targets import Targets

Frames = tuple[Array, Array]
"""Base and tool as transforms (4, 4), mm."""
_SWEEPS, _TURNS = 12, 40
_FLAT = 1e-3
"""Spread of points across a line, in parts of that along it, below which they show no attitude."""


def starts(
    machine: Machine, rows: Recording, flange: Array, stated: Frames, points: Array | None
) -> Iterator[Frames]:
    """Places of base and tool for flange poses (n, 4, 4): as stated, then as closed forms have them.

    ``points`` (m, 3): the targets of the tool, mm, where the sensor reads such.
    """
    yield stated
    for sensor, read, whole in _read(machine, rows):
        seen = flange[whole]
        if isinstance(sensor, Pose):
            poses = lie.pose_of(lie.exp_so3(read[:, 3:]), read[:, :3])
            yield from frames_from_poses(seen, poses, stated[1])
            yield _base_at(seen @ stated[1], poses), stated[1]
        elif isinstance(sensor, Position):
            # the tool as it is stated, none, and where the base is said to be: a wrong one leads into a false minimum
            for tool in (stated[1], np.eye(4), stated[0], *_far_tools(seen @ stated[1], read)):
                yield _by_points(seen, read[:, None], np.zeros((1, 3)), tool)
        elif isinstance(sensor, BallBar) and sensor.view == TOOL_IN_WORLD:
            yield from _by_lengths(sensor, seen, read[:, 0], stated)
        elif isinstance(sensor, Direction) and sensor.view == TOOL_IN_WORLD:
            yield from _by_directions(sensor, seen @ stated[1], read, stated)
        elif isinstance(sensor, Targets) and points is not None:
            clouds = read.reshape(len(read), -1, 3)
            yield _by_points(seen, clouds, points, stated[1])
            if _spread_out(points):
                yield from frames_from_poses(seen, _poses_of(clouds, points), stated[1])


def tools(machine: Machine, rows: Recording, carried: Array, points: Array | None) -> Iterator[Array]:
    """Yield tools (4, 4) with which flange poses (n, 4, 4) in the world, as the base is stated, have the poses measured.

    Where points alone are read it is not turned.
    """
    for sensor, read, whole in _read(machine, rows):
        flange = carried[whole]
        turned = not isinstance(sensor, Position)
        if isinstance(sensor, Pose):
            poses = lie.pose_of(lie.exp_so3(read[:, 3:]), read[:, :3])
        elif not turned:
            poses = lie.pose_of(np.eye(3), read)
        elif isinstance(sensor, Targets) and points is not None and _spread_out(points):
            poses = _poses_of(read.reshape(len(read), -1, 3), points)
        else:
            continue
        back = np.swapaxes(flange[:, :3, :3], 1, 2)
        shift = np.einsum("nij,nj->i", back, poses[:, :3, 3] - flange[:, :3, 3]) / len(read)
        turn = lie.nearest_rotation(np.sum(back @ poses[:, :3, :3], axis=0)) if turned else np.eye(3)
        yield lie.pose_of(turn, shift)


def _read(machine: Machine, rows: Recording) -> Iterator[tuple[Sensor, Array, Mask]]:
    """Yield sensors that were read in three rows or more, with these readings (k, m) and a mask (n,) of the rows."""
    for sensor in machine.sensors:
        columns = [rows.observations[name] for name in sensor.columns if name in rows.observations]
        if len(columns) != len(sensor.columns) or not columns:
            continue
        read = np.column_stack(columns)
        whole = np.asarray(np.isfinite(read).all(axis=1))
        if whole.sum() >= 3:
            yield sensor, read[whole], whole


def _by_lengths(sensor: BallBar, flange: Array, length: Array, stated: Frames) -> Iterator[Frames]:
    """Yield bases, turned as stated, from which bars have lengths (n,), for some tools, and for these moved in turns."""
    ball, centre = (
        np.array([p.nominal for p in part]) for part in (sensor.parameters[3:], sensor.parameters[:3])
    )
    turn = stated[0][:3, :3]
    for start in (stated[1], np.eye(4)):
        tool = start.copy()
        for last in (0, _SWEEPS):
            for _ in range(last):  # the ball from the centre and the centre from the ball
                found = next(_centres((flange @ tool)[:, :3] @ [*ball, 1.0], length))
                seen = np.einsum("nji,nj->ni", flange[:, :3, :3], found - flange[:, :3, 3])
                tool[:3, 3] = next(_centres(seen, length)) - tool[:3, :3] @ ball
            for found in _centres((flange @ tool)[:, :3] @ [*ball, 1.0], length):
                yield lie.pose_of(turn, centre - turn @ found), tool.copy()


def _centres(balls: Array, distance: Array) -> Iterator[Array]:
    """Yield the points (3,) at distances (n,) of others (n, 3): either side of their plane, where they lie in one.

    |u_k - c|^2 = d_k^2 less its mean is linear in c; what is left of the mean is the height above points in a plane.
    """
    middle = balls.mean(axis=0)
    apart, square = balls - middle, np.square(distance)
    right = np.sum(apart**2, axis=1) - square
    sizes, axes = np.linalg.svd(apart, full_matrices=False)[1:]
    seen = sizes > 10.0 * _FLAT * max(float(sizes[0]), 1e-12)
    along = np.linalg.lstsq(2.0 * apart @ axes[seen].T, right - right.mean(), rcond=None)[0] @ axes[seen]
    height = np.sqrt(max(float(np.mean(square - np.sum((apart - along) ** 2, axis=1))), 0.0))
    for side in (1.0, -1.0) if not seen.all() else (0.0,):
        yield middle + along + side * height * axes[-1]


def _base_at(drawn: Array, measured: Array) -> Array:
    """The base (4, 4) that brings drawn poses (n, 4, 4) next to measured ones."""
    turn = lie.nearest_rotation(np.einsum("nij,nkj->ik", measured[:, :3, :3], drawn[:, :3, :3]))
    shift = np.mean(measured[:, :3, 3] - drawn[:, :3, 3] @ turn.T, axis=0)
    return lie.pose_of(turn, shift)


def _far_tools(drawn: Array, read: Array) -> Iterator[Array]:
    """Yield tools (4, 4) on every side where points (n, 3) spread further than poses (n, 4, 4) of the stated tool."""
    apart = float(np.linalg.norm(np.std(read, axis=0)))
    if np.linalg.norm(np.std(drawn[:, :3, 3], axis=0)) < 0.5 * apart:
        yield from lie.pose_of(np.eye(3), apart * np.vstack([np.eye(3), -np.eye(3)]))


def _by_directions(sensor: Direction, tool: Array, read: Array, stated: Frames) -> Iterator[Frames]:
    """The base that turns poses (n, 4, 4) of the tool to the directions (n, k) read."""
    found = base_of(sensor, tool, read, station_of(p.nominal for p in sensor.parameters))
    if found is not None:
        base = found[0]
        if sensor.of != ORIGIN:
            base[:3, 3] = stated[0][:3, 3]
        yield base, stated[1]


def _spread_out(points: Array) -> bool:
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) if len(points) > 2 else np.zeros(3)
    return bool(sizes[1] > _FLAT * max(sizes[0], 1e-12))


def _poses_of(clouds: Array, points: Array) -> Array:
    """(n, 4, 4) poses of a body from its points (m, 3) as they were measured (n, m, 3)."""
    middle, centre = clouds.mean(axis=1), points.mean(axis=0)
    rotation = lie.nearest_rotation(np.einsum("nmi,mj->nij", clouds - middle[:, None], points - centre))
    return lie.pose_of(rotation, middle - rotation @ centre)


def _by_points(flange: Array, clouds: Array, points: Array, tool: Array) -> Frames:
    """The base that brings the points (m, 3) of a tool onto the measured ones (n, m, 3), and the tool's shift, in turns.

    All that a turn needs is linear in the tool's place t and in the base's rotation B, and is summed over the rows once.
    """
    tool, turned = tool.copy(), flange[:, :3, :3]
    held = np.einsum("nij,mj->nmi", turned @ tool[:3, :3], points) + flange[:, None, :3, 3]
    seen, drawn = clouds - clouds.mean(axis=(0, 1)), held - held.mean(axis=(0, 1))
    apart = turned - turned.mean(axis=0)
    fixed = np.einsum("nmi,nmj->ij", seen, drawn)
    moving = np.einsum("nmi,njk->ijk", seen, apart)  # Kabsch's matrix is fixed + moving t
    # in the base's axes the system is the same in every turn
    system = np.concatenate([turned, np.broadcast_to(np.eye(3), turned.shape)], axis=2).reshape(-1, 6)
    inverse = np.linalg.pinv(system, rcond=1e-6)[:3]
    by_base = np.einsum("anj,nl->alj", inverse.reshape(3, -1, 3), seen.mean(axis=1))
    by_tool, constant = inverse @ apart.reshape(-1, 3), inverse @ drawn.mean(axis=1).reshape(-1)
    enough = 0.1 * _FLAT * float(np.std(clouds))
    for last in range(_TURNS, -1, -1):
        place = tool[:3, 3]
        rotation = lie.nearest_rotation(fixed + moving @ place)
        step = np.einsum("alj,lj->a", by_base, rotation) - constant - by_tool @ place
        if not last or np.linalg.norm(step) < enough:
            break
        tool[:3, 3] += step
    middle = held.mean(axis=(0, 1)) + turned.mean(axis=0) @ tool[:3, 3]
    return lie.pose_of(rotation, clouds.mean(axis=(0, 1)) - rotation @ middle), tool


def frames_from_poses(flange: Array, measured: Array, tool: Array) -> Iterator[Frames]:
    """Base and tool from measured poses: by the null vector, and by turns from the tool as stated.

    With k_ijab = sum m_ij f_ab over the rows, the best base for a tool and the best tool for a base are nearest rotations.
    """
    f, m = flange[:, :3, :3], measured[:, :3, :3]
    k = (m.reshape(-1, 9).T @ f.reshape(-1, 9)).reshape(3, 3, 3, 3)
    base = turned = np.array([_turn_of_null_vector(f, m), tool[:3, :3]])  # both starts at once
    for _ in range(_SWEEPS):
        base = lie.nearest_rotation(np.einsum("ijab,sbj->sia", k, turned))
        fresh = lie.nearest_rotation(np.einsum("ijab,sia->sbj", k, base))
        done = np.abs(fresh - turned).max() < 1e-6
        turned = fresh
        if done:
            break
    axis = _common_axis(f)
    for one, other in zip(base, turned, strict=True):
        yield _with_shifts(flange, measured, one, other, tool[:3, 3])
        if axis is not None:
            both = _about_axis(axis, flange, measured, one, other)
            yield _with_shifts(flange, measured, *both, tool[:3, 3])


def _common_axis(flange: Array) -> Array | None:
    """(3,) the one axis about which all rotations (n, 3, 3) differ; None where there are several."""
    sizes, axes = np.linalg.svd(lie.log_so3(flange @ flange[0].T), full_matrices=False)[1:]
    return np.asarray(axes[0]) if sizes[1] < _FLAT * sizes[0] else None


def _about_axis(axis: Array, flange: Array, measured: Array, base: Array, tool: Array) -> tuple[Array, Array]:
    """Rotations (3, 3) of base and tool, turned against each other about an axis as positions have it.

    Turns about one axis leave this angle a open: B R(a) (p_k + F_k t) + b = y_k is linear in its cosine and sine, in R(a) t, b.
    """
    f, p = flange[:, :3, :3], flange[:, :3, 3]
    along = np.outer(p @ axis, axis)
    right = measured[:, :3, 3] - along @ base.T
    turning = [(p - along) @ base.T, np.cross(axis, p) @ base.T]
    eye = np.broadcast_to(np.eye(3), f.shape)
    system = np.concatenate([np.stack(turning, axis=2), base @ f @ f[0].T, eye], axis=2).reshape(-1, 8)
    cosine, sine = np.linalg.lstsq(system, right.reshape(-1), rcond=1e-6)[0][:2]
    turn = lie.exp_so3(axis * np.arctan2(sine, cosine))
    return base @ turn, f[0].T @ turn.T @ f[0] @ tool


def _turn_of_null_vector(flange: Array, measured: Array) -> Array:
    """(3, 3) rotation of the tool: M_k Y - B F_k = 0 for all k, least squares in Y = T' and B."""
    eye = np.eye(3)
    # row-major vec: vec(M Y) = (M x I) vec(Y), vec(B F) = (I x F') vec(B)
    left = np.einsum("nij,kl->nikjl", measured, eye).reshape(-1, 9)
    right = np.einsum("ij,nlk->nikjl", eye, flange).reshape(-1, 9)
    vector = np.linalg.svd(np.hstack([left, -right]), full_matrices=False)[2][-1]
    inverse = vector[:9].reshape(3, 3)
    return lie.nearest_rotation(inverse * (1.0 if np.linalg.det(inverse) >= 0 else -1.0)).T


def _with_shifts(flange: Array, measured: Array, base: Array, tool: Array, near: Array) -> Frames:
    """The linear part: B (R_k t + p_k) + b = y_k for t and b; t next to ``near`` where motions do not show it."""
    turn = base @ flange[:, :3, :3]
    right = measured[:, :3, 3] - np.einsum("ij,nj->ni", base, flange[:, :3, 3]) - turn @ near
    system = np.concatenate([turn, np.broadcast_to(np.eye(3), turn.shape)], axis=2).reshape(-1, 6)
    found = np.linalg.lstsq(system, right.reshape(-1), rcond=1e-6)[0]
    return lie.pose_of(base, found[3:]), lie.pose_of(tool, near + found[:3])
