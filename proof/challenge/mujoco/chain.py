"""A chain of hinges as rows of Khalil and Kleinfinger, exactly: common normals where axes are skew, feet where parallel.

T(i-1, i) = RotY(beta) RotX(alpha) TransX(d) RotZ(theta + q) TransZ(r). m and rad. Frame 0 stands with its z along the
first axis; what is left between the last frame and the tip is the tool's.
Source: Khalil and Kleinfinger 1986; Craig's modified convention with frames on the common normals.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from challenge.mujoco.packages import Package
from challenge.simulator.rigid import frame, turn
from truepose.errors import InputError

Array = NDArray[np.float64]
FIELDS = ("beta", "alpha", "d", "theta", "r")
PARALLEL, SKEW = 1e-12, 1e-3
"""Sine between axes up to which they are parallel, and from which on their common normal is well known."""


@dataclass(frozen=True)
class Chain:
    """base (4, 4): frame 0 in the world of the MJCF; rows (n, 5) as in ``FIELDS``; frames (n, 4, 4) of the links at
    zero, in frame 0; flange_tip (4, 4); down (3,): direction of gravity in frame 0."""

    base: Array
    rows: Array
    frames: Array
    flange_tip: Array
    down: Array


def fitted(package: Package) -> Chain:
    """The rows of a package's arm. Raises InputError where axes are parallel but not quite: no row is exact there."""
    axes, anchors, n = package.axes, package.anchors, len(package.axes)
    normals, feet, ahead = _normals(axes, anchors)
    tip = package.tip[:3, 3]
    origin = anchors[0] - axes[0] * (axes[0] @ anchors[0])
    x = _across(np.array([1.0, 0, 0]), axes[0])
    base = _placed(x, axes[0], origin)
    into = np.linalg.inv(base)
    rows, frames = np.zeros((n, 5)), np.zeros((n, 4, 4))
    for k in range(n):
        last = k == n - 1
        new_x, end = (
            (x, anchors[k] + axes[k] * (axes[k] @ (tip - anchors[k]))) if last else (normals[k], feet[k])
        )
        if k:
            d, alpha = (ahead[k - 1] - feet[k - 1]) @ x, _angle(axes[k - 1], axes[k], x)
            start = ahead[k - 1]
        else:
            d, alpha, start = 0.0, 0.0, origin
        new_x = _across(new_x, axes[k])
        rows[k] = 0.0, alpha, d, _angle(x, new_x, axes[k]), (end - start) @ axes[k]
        frames[k] = into @ _placed(new_x, axes[k], end)
        x = new_x
    flange = base @ frames[-1]
    return Chain(
        base, rows, frames, np.linalg.inv(flange) @ package.tip, base[:3, :3].T @ np.array([0, 0, -1.0])
    )


def transforms(rows: Array, q: Array) -> Array:
    """(n, 4, 4) from each frame to the one before it, joints (n,) rad."""
    beta, alpha, d, theta, r = rows.T
    tilt = turn(1, beta) @ turn(0, alpha)
    turned = frame(turn(2, theta + q), np.stack([0 * r, 0 * r, r], axis=-1))
    out: Array = frame(tilt, tilt[:, :, 0] * d[:, None]) @ turned
    return out


def pose(rows: Array, q: Array) -> Array:
    """(4, 4) of the last frame in frame 0."""
    out = np.eye(4)
    for step in transforms(rows, q):
        out = out @ step
    return out


def _normals(axes: Array, anchors: Array) -> tuple[Array, Array, Array]:
    """Of each pair of neighbours (n - 1, 3): direction of the common normal, its foot on the first and second axis."""
    normals, feet, ahead = [], [], []
    for k in range(len(axes) - 1):
        a, b, between = axes[k], axes[k + 1], anchors[k + 1] - anchors[k]
        cross = np.cross(a, b)
        size = float(np.linalg.norm(cross))
        if size < PARALLEL:
            across = between - a * (a @ between)
            normal, foot, other = across / np.linalg.norm(across), anchors[k + 1] - across, anchors[k + 1]
        elif size > SKEW:
            normal = cross / size
            s, t = np.linalg.lstsq(np.column_stack([a, -b]), between, rcond=None)[0]
            foot, other = anchors[k] + s * a, anchors[k + 1] + t * b
        else:
            raise InputError(
                f"chain: found axes {k + 1} and {k + 2} parallel to {size:.1e} rad, expected exactly or not at all"
            )
        normals.append(normal)
        feet.append(foot)
        ahead.append(other)
    return np.array(normals), np.array(feet), np.array(ahead)


def _angle(start: Array, end: Array, about: Array) -> float:
    """From one direction to another, both across ``about``."""
    return float(np.arctan2(about @ np.cross(start, end), start @ end))


def _across(x: Array, z: Array) -> Array:
    """Direction of the part of ``x`` across ``z``."""
    out = x - z * (z @ x)
    return np.asarray(out / np.linalg.norm(out))


def _placed(x: Array, z: Array, origin: Array) -> Array:
    return frame(np.column_stack([x, np.cross(z, x), z]), origin)


__all__ = ["FIELDS", "Chain", "fitted", "pose", "transforms"]
