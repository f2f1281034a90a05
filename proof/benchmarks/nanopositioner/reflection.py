"""The spot of light on the mirror of a ``distance`` sensor, and motions that hold it still.

Equations (28) and (29) of the nanopositioner paper give the point where the light meets the mirror; its control
scheme (Fig. 7) turns and shifts the mirror about that point, the joints following from the inverse model with all
identified constants. Lengths mm, angles rad; poses are those of the tool in the sensor's frame.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import InputError
from truepose.identification.compensation.inverse import Inverse, PoseSolver
from truepose.models import lie
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES
from truepose.models.sensors.distance import Distance

Array = NDArray[np.float64]
PARALLEL = 1e-6
"""Cosine between light and mirror normal below which the light runs inside the mirror's plane."""


@dataclass(frozen=True)
class Reflections:
    """For n poses: cavity length (n,), the point in the world (n, 3) and in the mirror (n, 3), whose z is 0; mm."""

    length: Array
    world: Array
    mirror: Array


def light_frame(machine: Machine, p: Array | None = None) -> Array:
    """(4, 4) frame of the fibre in the sensor's frame: the light leaves its origin along its z axis (eq. 13)."""
    value = _values(machine, p)
    out = np.eye(4)
    turn = Rotation.from_euler("XZ", [value["beam.rx"], value["beam.rz"]])
    out[:3, :3], out[:3, 3] = turn.as_matrix(), [value[f"beam.{a}"] for a in "xyz"]
    return out


def mirror_poses(machine: Machine, poses: Array, p: Array | None = None) -> Array:
    """(n, 4, 4) mirror in the sensor's frame, its plane xy, for poses (n, 4, 4) of the tool (eqs. 14, 19)."""
    sensor, value = _distance(machine), _values(machine, p)
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("XY", [value["mirror.rx"], value["mirror.ry"]]).as_matrix()
    out[2, 3] = value["mirror.z"]
    if sensor.on_flange:
        tool = np.eye(4)
        tool[:3, :3] = lie.rpy_matrix(np.array([value[f"tool.{a}"] for a in AXES[3:]]))
        tool[:3, 3] = [value[f"tool.{a}"] for a in AXES[:3]]
        out = lie.inverse_pose(tool) @ out
    return np.asarray(poses @ out)


def reflections(machine: Machine, poses: Array, p: Array | None = None) -> Reflections:
    """Where the light meets the mirror for poses (n, 4, 4) of the tool; ``p`` (np,) by default the machine's own.

    Raises InputError where the machine has no ``distance`` sensor or the light runs along the mirror.
    """
    fibre, mirror = light_frame(machine, p), mirror_poses(machine, poses, p)
    normal, origin, along = mirror[:, :3, 2], fibre[:3, 3], fibre[:3, 2]
    across = normal @ along
    if np.any(np.abs(across) < PARALLEL):
        row = int(np.argmin(np.abs(across)))
        raise InputError(
            f"poses[{row}]: found light that runs along the mirror, expected it to meet the mirror"
        )
    length = np.sum(normal * (mirror[:, :3, 3] - origin), axis=1) / across
    world = origin + length[:, None] * along
    own = np.einsum("nji,nj->ni", mirror[:, :3, :3], world - mirror[:, :3, 3])
    return Reflections(length, world, own)


@dataclass(frozen=True)
class Held:
    """Joints of a motion that should leave the cavity's length alone, one row a step.

    ``q`` (n, nq) is what the motion takes, whether the joints can go there or not; ``within`` counts the steps
    before the first that the joints cannot take, and ``saturated`` names what stops it (empty: nothing does).
    """

    steps: Array
    found: Inverse
    within: int
    saturated: tuple[str, ...]

    @property
    def q(self) -> Array:
        """(n, nq) readings, mm and rad."""
        return self.found.q


class ReflectionControl:
    """The scheme of Fig. 7 on one machine: poses about the reflection point, joints by the inverse model.

    ``p`` (np,) are the constants that the controller believes, by default the machine's own.
    """

    def __init__(self, machine: Machine, p: Array | None = None) -> None:
        self.machine, self.solver = machine, PoseSolver(machine, p)
        self.fibre = light_frame(machine, self.solver.p)

    def mirror(self, poses: Array) -> Array:
        """(n, 4, 4) where the controller believes the mirror to be, for poses (n, 4, 4) of the tool."""
        return mirror_poses(self.machine, poses, self.solver.p)

    def facing(self, q: Array) -> Array:
        """Readings (nq,) near ``q`` (nq,) at which the mirror stands square to the light, the spot where it was.

        Raises InputError where the joints cannot go there.
        """
        pose, _ = self.solver.forward(q)
        normal = self.mirror(pose)[0, :3, 2]
        light = self.fibre[:3, 2]
        towards = -light if normal @ light < 0 else light
        turn = Rotation.align_vectors(towards[None], normal[None])[0].as_rotvec()
        found = self.solver.inverse(self._turned(pose, turn[None]), q, restarts=0)
        if not found.solved[0]:
            who = ", ".join(found.saturated(0)) or "no joint reading"
            raise InputError(f"{self.machine.name}: the mirror cannot be set square to the light ({who})")
        return np.asarray(found.q[0])

    def turn(self, q: Array, axis: int, angles: Array) -> Held:
        """Turn the mirror about axis 0, 1 or 2 of the fibre through the reflection point, by ``angles`` (n,) rad."""
        pose, _ = self.solver.forward(q)
        turns = np.asarray(angles)[:, None] * self.fibre[:3, axis]
        return self._followed(q, self._turned(pose, turns), np.asarray(angles))

    def shift(self, q: Array, shifts: Array) -> Held:
        """Translate the mirror by ``shifts`` (n, 3) along the axes of its own plane (third component: normal), mm."""
        pose, _ = self.solver.forward(q)
        plane = self.mirror(pose)[0, :3, :3]
        poses = np.tile(pose, (len(shifts), 1, 1))
        poses[:, :3, 3] += np.asarray(shifts) @ plane.T
        return self._followed(q, poses, np.linalg.norm(shifts, axis=1))

    def _turned(self, pose: Array, turns: Array) -> Array:
        """(n, 4, 4) the pose (1, 4, 4) turned by rotation vectors (n, 3) about the reflection point."""
        point = reflections(self.machine, pose, self.solver.p).world[0]
        out = np.tile(pose, (len(turns), 1, 1))
        rotation = lie.exp_so3(np.asarray(turns))
        out[:, :3, :3] = rotation @ pose[0, :3, :3]
        out[:, :3, 3] = point + rotation @ (pose[0, :3, 3] - point)
        return out

    def _followed(self, q: Array, poses: Array, steps: Array) -> Held:
        found = self.solver.inverse(poses, q, restarts=0)
        bad = np.flatnonzero(~found.solved)
        first = int(bad[0]) if len(bad) else len(poses)
        return Held(steps, found, first, found.saturated(first) if len(bad) else ())


def _distance(machine: Machine) -> Distance:
    for sensor in machine.sensors:
        if isinstance(sensor, Distance):
            return sensor
    raise InputError(
        f"{machine.name}: sensor: found no distance sensor, expected one with a beam and a mirror"
    )


def _values(machine: Machine, p: Array | None) -> Mapping[str, float]:
    """Parameters by name, as given or as the machine has them."""
    names = [parameter.name for parameter in machine.parameters]
    own = [parameter.nominal for parameter in machine.parameters] if p is None else [float(v) for v in p]
    _distance(machine)
    return dict(zip(names, own, strict=False))


__all__ = ["Held", "ReflectionControl", "Reflections", "light_frame", "mirror_poses", "reflections"]
