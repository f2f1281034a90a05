"""Where the platform stands on legs of given length, and the forces in them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import rigid
from .base import Array
from .ported import Work
from .stewart_drawing import (
    AXES,
    GRAVITY,
    HEIGHT,
    LEGS,
    PAYLOAD_COM,
    PLATFORM_COM,
    PLATFORM_KG,
)

STEPS, CLOSED = 60, 1e-12


@dataclass(frozen=True)
class StewartPose:
    """``rotation`` (n, 3, 3), ``position`` (n, 3) of the platform in the base frame; ``units`` (n, 6, 3) along the legs
    upwards, ``arms`` (n, 6, 3) from the platform's origin to their ends, base axes; ``lengths`` (n, 6); ``forces``
    (n, 6) N, tension positive; ``tool`` (n, 4, 4) in the world."""

    rotation: Array
    position: Array
    units: Array
    arms: Array
    lengths: Array
    forces: Array
    tool: Array


def pose(work: Work) -> StewartPose:
    """The platform in every row. Raises ValueError where it cannot be assembled."""
    a, b, lengths = points(work, "a"), points(work, "b"), leg_lengths(work)
    R, p = closed(a, b, lengths)
    arms = np.einsum("nij,nkj->nki", R, b)
    legs = p[:, None] + arms - a
    units = legs / np.linalg.norm(legs, axis=-1, keepdims=True)
    world = _mount(work, "base") @ _motion(work, "base")
    hand = _motion(work, "tool") @ _mount(work, "tool")
    tool = world @ rigid.frame(R, p) @ hand
    forces = balanced(units, arms, _weight(work, R, hand))
    return StewartPose(R, p, units, arms, lengths, forces, tool)


def points(work: Work, end: str) -> Array:
    """(n, 6, 3) joint centres ``a`` in the base frame or ``b`` in the platform's."""
    return np.stack([work.stacked(tuple(f"{leg}.{end}.{x}" for x in "xyz")) for leg in LEGS], axis=1)


def leg_lengths(work: Work) -> Array:
    """(n, 6) offset + gain * reading + what else moved."""
    offset, gain = (work.stacked(tuple(f"{leg}.{f}" for leg in LEGS)) for f in ("offset", "gain"))
    return np.asarray(offset + gain * (work.campaign.q + work.moved))


def closed(a: Array, b: Array, lengths: Array) -> tuple[Array, Array]:
    """Rotation (n, 3, 3) and position (n, 3) at which |p + R b - a| = lengths (n, 6), by Newton's method from home."""
    n = len(lengths)
    R, p = np.tile(np.eye(3), (n, 1, 1)), np.tile([0.0, 0.0, HEIGHT], (n, 1))
    for _ in range(STEPS):
        arms = np.einsum("nij,nkj->nki", R, b)
        legs = p[:, None] + arms - a
        now = np.linalg.norm(legs, axis=-1)
        units = legs / now[..., None]
        J = np.concatenate([units, np.cross(arms, units)], axis=-1)
        step = np.linalg.solve(J, (lengths - now)[..., None])[..., 0]
        p, R = p + step[:, :3], rigid.moved(step)[:, :3, :3] @ R
        if not np.max(np.abs(step)) < 1e4:
            break
        if np.max(np.abs(step)) < CLOSED * HEIGHT:
            return R, p
    raise ValueError("stewart: the platform cannot be assembled on legs of these lengths")


def balanced(units: Array, arms: Array, wrench: Array) -> Array:
    """(n, 6) tensions that hold an outer wrench (n, 6), force and moment about the platform's origin, N and N*mm."""
    pull = np.concatenate([units, np.cross(arms, units)], axis=-1)  # a leg in tension pulls the platform down
    tension: Array = np.linalg.solve(np.swapaxes(pull, 1, 2), wrench[..., None])[..., 0]
    return tension


def _weight(work: Work, R: Array, hand: Array) -> Array:
    """(n, 6) of platform and payload about the platform's origin, base axes."""
    down = np.array(GRAVITY)
    body = R @ np.array(PLATFORM_COM)
    load = np.einsum("nij,nj->ni", R, hand[:, :3, :3] @ np.array(PAYLOAD_COM) + hand[:, :3, 3])
    weights = PLATFORM_KG * np.tile(down, (len(work), 1)), work.campaign.payload[:, None] * down
    moment = np.cross(body, weights[0]) + np.cross(load, weights[1])
    return np.hstack([weights[0] + weights[1], moment])


def _mount(work: Work, name: str) -> Array:
    R = rigid.roll_pitch_yaw(*(work.value(f"{name}.{x}") for x in AXES[3:]))
    return rigid.frame(R, work.stacked(tuple(f"{name}.{x}" for x in AXES[:3])))


def _motion(work: Work, name: str) -> Array:
    return rigid.moved(work.stacked(tuple(f"{name}.motion.{x}" for x in AXES)))
