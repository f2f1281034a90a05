"""Pose errors by screw theory: the twist of the tool by every error of every joint and link, limb by limb.

For serial limbs between the base and one platform, and a serial part (a wrist) behind it. The passive joints of a
limb are eliminated by the wrenches that do no work on them, its wrenches of actuation and constraint: Huang, Zhao,
Yin, Tian and Chetwynd (2019), eqs. (1)-(8) and appendix A.

Nothing here is differentiated: frames are placed by numbers and every error is a screw at its frame. It is a second
way to derivatives that the symbolic model takes by the implicit function theorem; tests hold the two together.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import InputError
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE, COORDINATES, Direction, Joint, Mechanism, Step

Array = NDArray[np.float64]
Limb = tuple[tuple[Joint, float], ...]
"""Joints from base to platform, with -1 for those that are passed from child to parent."""
SINGULAR = 1e-9
"""Twists of a limb, or wrenches of all limbs, are dependent below this singular value (lengths in parts of the reach)."""
_FRAME = tuple(zip(("tx", "ty", "tz", "rz", "ry", "rx"), ("x", "y", "z", "rz", "ry", "rx"), strict=True))
"""Steps of ``base`` and ``tool``: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)."""


@dataclass(frozen=True)
class ScrewModel:
    """Screws at n configurations, in the axes of the sensor's frame at the tool's origin: [v; w], [force; moment].

    error (n, 6, np): twist of the tool by each parameter of the machine, the B of eq. (7), mm and rad; wrenches:
    each limb's (n, 6, k), of actuation and constraint together; platform (n, 6, 6): all of them as rows, the J_P of
    eq. (5), ordered as ``wrenches``; tool (n, 4, 4): pose of the tool.
    """

    names: tuple[str, ...]
    error: Array
    wrenches: Mapping[str, Array]
    platform: Array
    tool: Array


def screw_model(machine: Machine, q: Array, x: Array, p: Array | None = None) -> ScrewModel:
    """Screws at readings ``q`` (n, nq) with passive coordinates ``x`` (n, nx) that close the loops.

    ``p`` are the machine's parameters (default: its own); its effects are left out. Raises InputError where the
    mechanism is not of serial limbs between base and one platform, or where wrenches do not hold the platform.
    """
    parameters = machine.parameters
    values = [parameter.nominal for parameter in parameters] if p is None else p[: len(parameters)]
    names = tuple(parameter.name for parameter in parameters)
    placed = _Placed(machine, dict(zip(names, map(float, values), strict=True)), q, x)
    platform, limbs = _limbs(machine.mechanism)
    behind = [
        placed.joints[joint.name] for joint in _path(machine.mechanism, platform, machine.mechanism.flange)
    ]
    if any(joint.passive for joint in behind):
        raise InputError(f"{machine.name}: found a passive joint behind {platform}, expected driven ones")
    error: dict[str, Array] = {}
    for part in (placed.base, *behind, placed.mount):
        error |= part.errors
    wrenches = {name: _reciprocal(placed, limb, name) for name, limb in limbs.items()}
    rows = _stacked(wrenches, placed) if limbs else np.zeros((len(placed.tool), 0, 6))
    start = 0
    for name, limb in limbs.items():
        size = wrenches[name].shape[2]
        share = np.linalg.inv(rows)[:, :, start : start + size] @ wrenches[name].transpose(0, 2, 1)
        start += size
        for joint, sign in limb:
            for parameter, twist in placed.joints[joint.name].errors.items():
                error[parameter] = error.get(parameter, 0.0) + sign * np.einsum("nij,nj->ni", share, twist)
    still = np.zeros((len(placed.tool), 6))
    return ScrewModel(
        names, np.stack([error.get(name, still) for name in names], axis=2), wrenches, rows, placed.tool
    )


@dataclass(frozen=True)
class _Screws:
    """Twists (n, 6) of one joint: by each parameter of its frame and drive, and by each passive coordinate."""

    errors: Mapping[str, Array]
    passive: tuple[Array, ...] = ()


class _Placed:
    """Frames of all bodies by numbers, and the screws of all joints, at the tool's origin."""

    def __init__(self, machine: Machine, values: Mapping[str, float], q: Array, x: Array) -> None:
        mechanism = machine.mechanism
        _supported(machine)
        self._values, self._n = values, len(q)
        self._actuators = {actuator.drives: actuator for actuator in mechanism.actuators}
        self._q = dict(zip(mechanism.readings, q.T, strict=True))
        ends = np.cumsum([0, *(COORDINATES[joint.kind] for joint in mechanism.passive)])
        self._x = {joint.name: x[:, ends[k] : ends[k + 1]] for k, joint in enumerate(mechanism.passive)}
        world = np.broadcast_to(np.eye(4), (self._n, 4, 4))
        base, self.base = self._frame("base", world)
        self.bodies, self.joints = {BASE: base}, dict[str, _Screws]()
        for joint in mechanism.tree:
            self.bodies[joint.child], self.joints[joint.name] = self._joint(joint)
        for joint in mechanism.closing:
            _, self.joints[joint.name] = self._joint(joint)
        self.tool, self.mount = self._frame("tool", self.bodies[mechanism.flange])
        self.reach = float(
            np.max([np.linalg.norm(_at(self.tool, pose), axis=1) for pose in self.bodies.values()])
        )
        self.base, self.mount = self._moved(self.base), self._moved(self.mount)
        self.joints = {name: self._moved(screws) for name, screws in self.joints.items()}

    def _moved(self, screws: _Screws) -> _Screws:
        """The same twists at the tool's origin instead of the sensor frame's."""
        at = self.tool[:, :3, 3]

        def here(twist: Array) -> Array:
            return np.hstack([twist[:, :3] + np.cross(twist[:, 3:], at), twist[:, 3:]])

        return _Screws({name: here(t) for name, t in screws.errors.items()}, tuple(map(here, screws.passive)))

    def _frame(self, name: str, parent: Array) -> tuple[Array, _Screws]:
        return self._steps(parent, [Step(kind, f"{name}.{axis}") for kind, axis in _FRAME])

    def _steps(self, pose: Array, steps: Sequence[Step]) -> tuple[Array, _Screws]:
        """The pose behind elementary steps, and the screw of each step's parameter."""
        errors = {}
        for step in steps:
            axis = np.eye(3)["xyz".index(step.kind[1])]
            turns = step.kind[0] == "r"
            errors[step.parameter] = _screw(pose, axis, turns)
            pose = pose @ _motion(axis, np.full(self._n, self._values[step.parameter]), turns)
        return pose, _Screws(errors)

    def _joint(self, joint: Joint) -> tuple[Array, _Screws]:
        """The child's pose as this joint gives it, and the joint's screws; of a closing joint the child stands."""
        pose, screws = self._steps(self.bodies[joint.parent], joint.placement)
        if joint.name in self._actuators:
            return self._driven(joint, pose, screws)
        if joint.kind == "fixed":
            return pose, screws
        if joint.kind == "spherical":
            passive = tuple(_screw(pose, axis, True) for axis in np.eye(3))
            turn = np.broadcast_to(np.eye(4), pose.shape).copy()
            if joint.name in self._x:
                turn[:, :3, :3] = Rotation.from_mrp(self._x[joint.name]).as_matrix()
            return pose @ turn, _Screws(screws.errors, passive)
        if joint.kind == "universal":
            return self._universal(joint, pose, screws)
        axis, turns = np.array(joint.axis), joint.kind == "revolute"
        passive = (_screw(pose, axis, turns),)
        if joint.name in self._x:
            pose = pose @ _motion(axis, self._x[joint.name][:, 0], turns)
        return pose, _Screws(screws.errors, passive)

    def _driven(self, joint: Joint, pose: Array, screws: _Screws) -> tuple[Array, _Screws]:
        """A driven joint: its reading's offset and gain are errors along or about its axis."""
        actuator, axis, turns = self._actuators[joint.name], np.array(joint.axis), joint.kind == "revolute"
        own, reading = _screw(pose, axis, turns), self._q[self._actuators[joint.name].reading]
        offset = self._values[actuator.offset] if actuator.offset else 0.0
        gain = self._values[actuator.gain] if actuator.gain else 1.0
        errors = dict(screws.errors)
        if actuator.offset:
            errors[actuator.offset] = own
        if actuator.gain:
            errors[actuator.gain] = own * reading[:, None]
        return pose @ _motion(axis, offset + gain * reading, turns), _Screws(errors)

    def _universal(self, joint: Joint, pose: Array, screws: _Screws) -> tuple[Array, _Screws]:
        """Turns about x, then y; where it closes a loop the second axis is the child's y."""
        first = _screw(pose, np.eye(3)[0], True)
        if joint.name not in self._x:
            child = pose.copy()
            child[:, :3, :3] = self.bodies[joint.child][:, :3, :3]
            return child, _Screws(screws.errors, (first, _screw(child, np.eye(3)[1], True)))
        pose = pose @ _motion(np.eye(3)[0], self._x[joint.name][:, 0], True)
        second = _screw(pose, np.eye(3)[1], True)
        pose = pose @ _motion(np.eye(3)[1], self._x[joint.name][:, 1], True)
        return pose, _Screws(screws.errors, (first, second))


def _at(tool: Array, pose: Array) -> Array:
    out: Array = pose[:, :3, 3] - tool[:, :3, 3]
    return out


def _screw(pose: Array, axis: Array, turns: bool) -> Array:
    """(n, 6) unit twist, at the sensor frame's origin, about or along an axis of a frame."""
    direction = pose[:, :3, :3] @ axis
    if turns:
        return np.hstack([np.cross(pose[:, :3, 3], direction), direction])
    return np.hstack([direction, np.zeros_like(direction)])


def _motion(axis: Array, amount: Array, turns: bool) -> Array:
    """(n, 4, 4) turns (rad) about, or shifts (mm) along, an axis."""
    out = np.broadcast_to(np.eye(4), (len(amount), 4, 4)).copy()
    if turns:
        out[:, :3, :3] = Rotation.from_rotvec(amount[:, None] * axis).as_matrix()
    else:
        out[:, :3, 3] = amount[:, None] * axis
    return out


def _reciprocal(placed: _Placed, limb: Limb, name: str) -> Array:
    """(n, 6, 6 - k) wrenches that do no work on the k passive twists of a limb."""
    twists = [twist for joint, _ in limb for twist in placed.joints[joint.name].passive]
    scale = np.array([placed.reach] * 3 + [1.0] * 3)
    columns = np.stack(twists, axis=2) / scale[:, None] if twists else np.zeros((len(placed.tool), 6, 0))
    if columns.shape[2] > 6:
        raise InputError(f"limb {name}: found {columns.shape[2]} passive freedoms, expected 6 at most")
    left, values, _ = np.linalg.svd(columns)
    if columns.shape[2] and np.min(values) < SINGULAR:
        raise InputError(f"limb {name}: found dependent passive joints, expected a pose that is not singular")
    wrench = left[:, :, columns.shape[2] :] / scale[:, None]
    out: Array = wrench * placed.reach
    return out


def _stacked(wrenches: Mapping[str, Array], placed: _Placed) -> Array:
    rows = np.concatenate(list(wrenches.values()), axis=2).transpose(0, 2, 1)
    if rows.shape[1] != 6:
        raise InputError(
            f"found {rows.shape[1]} wrenches of actuation and constraint on the platform, expected 6: "
            "fewer leave it loose, more are overconstrained"
        )
    scaled = rows * np.array([1.0] * 3 + [1.0 / placed.reach] * 3)
    if np.min(np.linalg.svd(scaled, compute_uv=False)) < SINGULAR:
        raise InputError("found wrenches that do not hold the platform, expected a pose that is not singular")
    return rows


def _supported(machine: Machine) -> None:
    if machine.mechanism.rods:
        raise InputError(
            f"{machine.name}: found a mechanism with rods, expected limbs of joints; write it as a graph"
        )
    for joint in machine.mechanism.joints:
        if isinstance(joint.axis, Direction) or joint.kind == "free":
            raise InputError(
                f"{machine.name}: joint {joint.name}: found a free joint or an axis with parameters, "
                "expected a fixed axis in the joint's frame"
            )


def _path(mechanism: Mechanism, top: str, body: str) -> list[Joint]:
    """Joints of the tree from body ``top`` down to ``body``."""
    above = {joint.child: joint for joint in mechanism.tree}
    out: list[Joint] = []
    while body != top:
        out.append(above[body])
        body = above[body].parent
    return out[::-1]


def _limbs(mechanism: Mechanism) -> tuple[str, dict[str, Limb]]:
    """The platform, and each limb by the name of its driven (else its last) joint; the base without loops."""
    spine = [BASE, *(joint.child for joint in _path(mechanism, BASE, mechanism.flange))]

    def root(body: str) -> str:
        return next(b for b in reversed(spine) if b == body or b in _above(mechanism, body))

    ends = {(root(joint.parent), root(joint.child)) for joint in mechanism.closing}
    found = {body for pair in ends for body in pair} - {BASE}
    if not ends:
        return BASE, {}
    if len(found) != 1 or any(BASE not in pair for pair in ends):
        raise InputError(
            f"found loops between bodies {', '.join(sorted(found | {BASE}))}, "
            "expected serial limbs between the base and one platform"
        )
    platform = found.pop()
    limbs = [tuple((joint, 1.0) for joint in _path(mechanism, BASE, platform))]
    for joint in mechanism.closing:
        down = root(joint.parent) == BASE
        near, far = (joint.parent, joint.child) if down else (joint.child, joint.parent)
        back = [(j, -1.0) for j in reversed(_path(mechanism, platform, far))]
        limbs.append(
            (*((j, 1.0) for j in _path(mechanism, BASE, near)), (joint, 1.0 if down else -1.0), *back)
        )
    return platform, {_limb_name(mechanism, limb): limb for limb in limbs}


def _above(mechanism: Mechanism, body: str) -> set[str]:
    return {joint.parent for joint in _path(mechanism, BASE, body)}


def _limb_name(mechanism: Mechanism, limb: Limb) -> str:
    driven = [
        actuator.reading
        for actuator in mechanism.actuators
        if any(actuator.drives == j.name for j, _ in limb)
    ]
    return driven[0] if driven else limb[-1][0].name


__all__ = ["ScrewModel", "screw_model"]
