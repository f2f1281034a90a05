"""The hybrid 3UPS-UP + 3R closed at its three ball centres: nine passive joints, nine coordinates; mm and rad.

Joints stand in frames Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll) behind their predecessors. A limb is two crossed
revolutes, a slide and a ball; the middle limb two crossed revolutes and a slide that carries the platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .base import Array
from .mechanism_frames import error_motion, fixed
from .motions import applied, rotation, shift
from .ported import Work

LIMBS = (1, 2, 3)
PASSIVE = ("up1", "up2", "up3", *(f"u{k}{side}" for k in LIMBS for side in "ab"))
"""Order of the unknowns: the middle limb's x, y, slide; then x and y of each limb."""
NEWTON, CLOSED = 60, 1e-11


@dataclass(frozen=True)
class Assembled:
    """Solved rows in the base frame. passive (n, 9): values of ``PASSIVE``; platform, tool (n, 4, 4);
    axes (n, 3, 6): twists [v; w] of the platform at the base origin for a unit stretch of each limb;
    wrist (n, 3, 2, 3): axis and a point of q4, q5, q6."""

    passive: Array
    platform: Array
    tool: Array
    axes: Array
    wrist: Array


def driven(work: Work, names: Sequence[str]) -> Array:
    """(n, 6) true displacements: reading, offset, and what physics adds."""
    offsets = work.stacked(tuple(f"{name}.offset" for name in names))
    return np.asarray(work.campaign.q + offsets + work.moved)


def assembled(work: Work, names: Sequence[str], reach: float) -> Assembled:
    """Close the loops in every row by Newton's method. ``reach``: base radius less platform radius, for the start.

    Raises ValueError where the limbs cannot meet the platform.
    """
    q = driven(work, names)
    frames = {name: fixed(work, name) for name in (*PASSIVE, *names)}
    balls = [work.stacked(tuple(f"s{k}.{c}" for c in "xyz")) for k in LIMBS]
    seats = [work.stacked(tuple(f"mount{k}.{c}" for c in "xyz")) for k in LIMBS]
    length = np.mean(q[:, :3], axis=1)
    lean = -np.arcsin(reach / length)
    x = np.zeros((len(work), 9))
    x[:, 2] = length * np.cos(lean)
    x[:, 4::2] = lean[:, None]
    for _ in range(NEWTON):
        platform, screws = _middle(frames, x)
        gaps, slopes, pull = np.zeros((len(x), 9)), np.zeros((len(x), 9, 9)), np.zeros((len(x), 9, 3))
        for k in range(3):
            rows = slice(3 * k, 3 * k + 3)
            seat = applied(platform, seats[k])
            rod, own = _limb(frames, x, q, k)
            rod = rod @ error_motion(work, f"q{k + 1}")
            ball = applied(rod, balls[k])
            gaps[:, rows] = seat - ball
            slopes[:, rows, :3] = _velocity(screws, seat)
            moving = _velocity(own, ball)
            slopes[:, rows, 3 + 2 * k : 5 + 2 * k] = -moving[..., :2]
            pull[:, rows, k] = moving[..., 2]
        step = np.linalg.solve(slopes, gaps[..., None])[..., 0]
        x = x - step
        if np.max(np.abs(step)) < CLOSED:
            rates = np.linalg.solve(slopes, pull)[:, :3]
            return _finished(work, frames, x, q, np.einsum("nsj,njk->nks", screws, rates))
    raise ValueError("the limbs cannot meet the platform: are these lengths within reach?")


def _middle(frames: dict[str, Array], x: Array) -> tuple[Array, Array]:
    """Platform (n, 4, 4) and screws (n, 6, 3) [v; w] at the base origin of the middle limb."""
    one = frames["up1"]
    two = one @ rotation(0, x[:, 0]) @ frames["up2"]
    three = two @ rotation(1, x[:, 1]) @ frames["up3"]
    screws = np.stack([_screw(one, 0), _screw(two, 1), _screw(three, 2, slides=True)], axis=-1)
    return three @ shift(2, x[:, 2]), screws


def _limb(frames: dict[str, Array], x: Array, q: Array, k: int) -> tuple[Array, Array]:
    """Rod (n, 4, 4) of limb k and screws (n, 6, 3) of its two turns and its slide."""
    one = frames[f"u{k + 1}a"]
    two = one @ rotation(0, x[:, 3 + 2 * k]) @ frames[f"u{k + 1}b"]
    three = two @ rotation(1, x[:, 4 + 2 * k]) @ frames[f"q{k + 1}"]
    screws = np.stack([_screw(one, 0), _screw(two, 1), _screw(three, 2, slides=True)], axis=-1)
    return three @ shift(2, q[:, k]), screws


def _screw(frame: Array, axis: int, *, slides: bool = False) -> Array:
    """(n, 6) twist [v; w] at the base origin of a unit motion about, or along, an axis of a frame."""
    along = frame[:, :3, axis]
    if slides:
        return np.concatenate([along, np.zeros_like(along)], axis=1)
    return np.concatenate([np.cross(frame[:, :3, 3], along), along], axis=1)


def _velocity(screws: Array, point: Array) -> Array:
    """(n, 3, k) velocities of a point (n, 3) that moves with twists (n, 6, k)."""
    turned = np.cross(np.moveaxis(screws[:, 3:], 1, 2), point[:, None, :])
    return np.asarray(screws[:, :3] + np.moveaxis(turned, 1, 2))


def _finished(work: Work, frames: dict[str, Array], x: Array, q: Array, axes: Array) -> Assembled:
    platform = _middle(frames, x)[0]
    pose, wrist = platform, []
    for axis, name in zip((2, 1, 0), ("q4", "q5", "q6"), strict=True):
        pose = pose @ frames[name]
        wrist.append(np.stack([pose[:, :3, axis], pose[:, :3, 3]], axis=1))
        pose = pose @ rotation(axis, q[:, int(name[1]) - 1]) @ error_motion(work, name)
    tool = pose @ error_motion(work, "tool") @ fixed(work, "tool")
    return Assembled(x, platform, tool, axes, np.stack(wrist, axis=1))


__all__ = ["LIMBS", "PASSIVE", "Assembled", "assembled", "driven"]
