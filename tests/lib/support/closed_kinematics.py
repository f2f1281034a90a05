"""Kinematics in closed form: links of a serial chain, inverses of hexapods, frames about them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from support.moving_machines import nominal
from support.plain_kinematics import frame_of, step
from truepose.arrays import Array
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Direction


def platform_pose(rng: np.random.Generator) -> tuple[Array, Array]:
    """A platform pose in the base frame: position and rotation."""
    return np.array([0, 0, 440.0]) + rng.uniform(-50, 50, 3), lie.exp_so3(rng.uniform(-0.25, 0.25, 3))


def leg_end(c: Mapping[str, float], leg: int, end: str) -> Array:
    return np.array([c[f"leg{leg}.{end}.{axis}"] for axis in "xyz"], dtype=float)


def ups_inverse(machine: Machine, position: Array, rotation: Array, c: Mapping[str, float]) -> Array:
    """Readings of a 6-UPS at a pose: distances of the leg ends."""
    out = []
    for leg in range(1, 7):
        distance = np.linalg.norm(position + rotation @ leg_end(c, leg, "b") - leg_end(c, leg, "a"))
        out.append((distance - c[f"leg{leg}.offset"]) / c[f"leg{leg}.gain"])
    return np.array(out)


def rail(machine: Machine, leg: int, c: Mapping[str, float]) -> Array:
    joint = next(j for j in machine.mechanism.joints if j.name == f"rho{leg}")
    assert isinstance(joint.axis, Direction)
    parts = [np.nan if name is None else c[name] for name in joint.axis.components]
    third = joint.axis.sign * np.sqrt(1 - np.nansum(np.square(parts)))
    return np.where(np.isnan(parts), third, parts)


def pus_inverse(machine: Machine, position: Array, rotation: Array, c: Mapping[str, float]) -> Array:
    """Readings of a 6-PUS at a pose, in closed form: the lower end of a leg on its rail, the lower of two."""
    out = []
    for leg in range(1, 7):
        u = rail(machine, leg, c)
        d = position + rotation @ leg_end(c, leg, "b") - leg_end(c, leg, "a")
        along = u @ d
        slide = along - np.sqrt(c[f"leg{leg}.length"] ** 2 - d @ d + along**2)
        out.append((slide - c[f"leg{leg}.offset"]) / c[f"leg{leg}.gain"])
    return np.array(out)


INVERSE = {"pus": pus_inverse, "ups": ups_inverse}


def readings(machine: Machine, rng: np.random.Generator, n: int = 4) -> Array:
    """Joint readings (n, nq) within half the ranges; of the hexapods, those of poses near home."""
    if machine.name == "ups":
        return np.array([ups_inverse(machine, *platform_pose(rng), nominal(machine)) for _ in range(n)])
    ranges = np.array([a.range for a in machine.mechanism.actuators], dtype=float)
    out: Array = ranges.mean(axis=1) + 0.25 * np.ptp(ranges, axis=1) * rng.uniform(-1, 1, (n, len(ranges)))
    return out


def base_to_flange(machine: Machine, world: Array, c: Mapping[str, float]) -> Array:
    """(n, 4, 4) flange in the base frame, out of the sensor's view of the tool."""
    out: Array = lie.inverse_pose(frame_of(c, "base")) @ world @ lie.inverse_pose(frame_of(c, "tool"))
    return out


def chain(machine: Machine, q: Array, c: Mapping[str, float]) -> list[Array]:
    """Poses of the links of a serial chain at one configuration."""
    links, here = [], np.eye(4)
    for joint, reading in zip(machine.mechanism.joints, q, strict=True):
        row = {key: c[f"{joint.name}.{key}"] for key in ("beta", "alpha", "d", "theta", "r")}
        row["theta" if joint.kind == "revolute" else "r"] += reading
        here = here @ step(list(row.values()))
        links.append(here)
    return links
