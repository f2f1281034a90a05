"""A machine of linear axes X Y Z and rotary ones A B C as errors of each axis by itself, after ISO 230-1.

With the other axes at their reference, axis i takes the tool from T(q0) to X_i(q_i) T(q0). Of this an axis without errors does
D_i, and the rest, X_i = D_i C_i E_i C_i^-1, is the table: three translations and a rotation vector, told at the point that C_i
moves the origin to. Together, in the order of the chain from the base to the tool,

    T(q) = X_1(q_1) X_2(q_2) ... X_n(q_n) T(q0).

That is exact where each axis has errors by its own reading only. What couples axes (loads, a column that bends under the
ram), and what is curved between two positions of a table, it cannot hold: ``Table.lost``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.export.links import check_uncoupled
from truepose.models.lie import exp_so3, inverse_pose, pose_of
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Actuator

POINTS = 41
"""Positions of each axis in a table, evenly over its range: the 1 m of a machine tool every 25 mm, as it is measured."""
CHECKED = 256
"""Places between the positions at which the whole table is compared with the machine."""
SLANT = np.radians(5.0)
"""Largest angle between an axis and the direction that it is named after."""
_LINEAR, _ROTARY = "XYZ", "ABC"
_SEED = 1


@dataclass(frozen=True)
class Poses:
    """Poses (n, 4, 4) of the tool in the base at readings (n, nq) and constants (np,), drivers at their defaults."""

    model: SymbolicModel
    function: ca.Function

    @classmethod
    def of(cls, machine: Machine) -> Poses:
        model = symbolic_model(machine, machine.effects)
        return cls(model, ca.Function("pose", [model.q, model.z, model.p], [ca.vec(model.pose)]))

    def __call__(self, q: Array, p: Array) -> Array:
        z = np.tile(self.model.z_home[:, None], len(q))
        rows = self.function.map(len(q))(q.T, z, np.tile(p[:, None], len(q)))
        return np.array(rows).T.reshape(len(q), 4, 4).transpose(0, 2, 1)


@dataclass(frozen=True)
class Axis:
    """An axis of the machine: letter, joint, kind (mm or rad), and D(q) along or about ``sign`` times the letter's direction.

    ``centre`` (3,) mm is a point that errors are told at: the origin of the base for linear axes, a point of the nominal axis
    for rotary ones. ``positions`` (k,) and ``errors`` (k, 6), mm and rad, are the table; ``reference`` is the reading where
    they are 0.
    """

    letter: str
    joint: str
    unit: str
    sign: float
    centre: Array
    reference: float
    positions: Array
    errors: Array

    def motion(self, q: Array) -> Array:
        """(n, 4, 4) X(q) by the table, interpolated on straight lines; q (n,)."""
        error = np.column_stack([np.interp(q, self.positions, column) for column in self.errors.T])
        return _nominal(self, q) @ _told_at(self.centre, pose_of(exp_so3(error[:, 3:]), error[:, :3]))


@dataclass(frozen=True)
class Table:
    """Axes in the order of the chain from the base, and the tool (4, 4) at their reference in the base's frame."""

    axes: tuple[Axis, ...]
    home: Array

    def pose(self, q: Array) -> Array:
        """Return the tool (n, 4, 4) in the nominal frame of the base, mm, at readings (n, nq)."""
        out = np.broadcast_to(np.eye(4), (len(q), 4, 4))
        for k, axis in enumerate(self.axes):
            out = out @ axis.motion(q[:, k])
        return np.asarray(out @ self.home)


@dataclass(frozen=True)
class Losses:
    """What a table leaves of a machine, and of its errors, at ``CHECKED`` places.

    ``lost`` is the largest distance (mm) and angle (rad) between machine and table, ``uncompensated`` the same between the
    machine and axes without errors; ``each`` is the part (mm) of the distance that single effects make.
    """

    lost: tuple[float, float]
    uncompensated: tuple[float, float]
    each: Mapping[str, float]


def table_of(machine: Machine) -> tuple[Poses, Table]:
    """Return the volumetric table of a machine, drivers of its effects at their defaults, and the poses that it is of.

    Raises InputError where it can have none.
    """
    _check(machine)
    poses = Poses.of(machine)
    axes = _axes(machine, poses, _drawn(machine, poses.model))
    return poses, _tabled(machine, poses, poses.model.p_home, axes)


def losses_of(machine: Machine, poses: Poses, table: Table) -> Losses:
    """Return what a table leaves of its machine, and what each effect has of it."""
    model, real = poses.model, poses.model.p_home
    low, high = np.transpose([a.range or (0.0, 0.0) for a in machine.mechanism.actuators])
    q = np.random.default_rng(_SEED).uniform(low, high, (CHECKED, len(low)))
    bare = [replace(axis, errors=np.zeros_like(axis.errors)) for axis in table.axes]
    ideal = replace(table, axes=tuple(bare))
    lost, uncompensated = (_apart(poses(q, real), other.pose(q)) for other in (table, ideal))
    of_effect = {e.label: np.isin(model.names, e.parameter_names) for e in machine.effects}
    every = np.any([*of_effect.values(), np.zeros(len(model.names), dtype=bool)], axis=0)

    def lost_with(p: Array) -> Array:
        """Return the distances (n, 3) between machine and table with other constants."""
        return poses(q, p)[:, :3, 3] - _tabled(machine, poses, p, table.axes).pose(q)[:, :3, 3]

    none = lost_with(np.where(every, 0.0, real))
    each = {
        label: float(np.max(np.linalg.norm(lost_with(np.where(every & ~own, 0.0, real)) - none, axis=1)))
        for label, own in of_effect.items()
    }
    return Losses(lost, uncompensated, each)


def _check(machine: Machine) -> None:
    mechanism = machine.mechanism
    if mechanism.rods or mechanism.closing:
        raise InputError(
            f"{machine.name}: found a mechanism with loops, expected one chain: a volumetric table has errors axis by axis"
        )
    joints = mechanism.actuators
    if not any(a.unit == "mm" for a in joints):
        raise InputError(
            f"{machine.name}: found no linear axis (joints {', '.join(a.reading for a in joints)} all turn), expected linear "
            "axes, and rotary ones beside them: an arm has no volumetric table"
        )
    for actuator in joints:
        check_uncoupled(machine, actuator, "a volumetric table")
    odd = [a.reading for a in joints if a.reading_unit not in ("mm", "rad")]
    if odd:
        raise InputError(f"{machine.name}: joint {odd[0]!r}: found readings in turns, expected mm or deg")
    free = [a.reading for a in joints if a.range is None]
    if free:
        raise InputError(
            f"{machine.name}: joint {free[0]!r}: found no range, expected one: a table has positions from end to end"
        )


def _axes(machine: Machine, poses: Poses, drawn: Array) -> list[Axis]:
    """Return the axes without errors, named by their nominal directions; a reference is 0, or the middle of a range without."""
    actuators = machine.mechanism.actuators
    ends = [actuator.range or (0.0, 0.0) for actuator in actuators]
    reference = np.array([0.0 if low <= 0.0 <= high else (low + high) / 2 for low, high in ends])
    home = poses(reference[None], drawn)[0]
    out: dict[str, Axis] = {}
    for k, actuator in enumerate(actuators):
        moved = reference.copy()
        moved[k] += 1.0
        motion = poses(moved[None], drawn)[0] @ inverse_pose(home)
        turn = Rotation.from_matrix(motion[:3, :3]).as_rotvec()
        rotary = actuator.unit == "rad"
        along = turn if rotary else motion[:3, 3]
        letter, sign = _named(machine, actuator, along / np.linalg.norm(along))
        if letter in out:
            raise InputError(
                f"{machine.name}: found several axes {letter} ({out[letter].joint}, {actuator.reading}), expected one of each "
                "letter: a table is told by letter"
            )
        centre, nothing = _centre(motion, turn) if rotary else np.zeros(3), np.zeros((0, 6))
        start = float(reference[k])
        out[letter] = Axis(
            letter, actuator.reading, actuator.unit, sign, centre, start, nothing[:, 0], nothing
        )
    return list(out.values())


def _named(machine: Machine, actuator: Actuator, direction: Array) -> tuple[str, float]:
    """Letter of an axis, and the sign of its direction (3,)."""
    k = int(np.argmax(np.abs(direction)))
    letters = _ROTARY if actuator.unit == "rad" else _LINEAR
    if np.arccos(min(abs(direction[k]), 1.0)) > SLANT:
        told = ", ".join(f"{v:.3g}" for v in direction)
        raise InputError(
            f"{machine.name}: joint {actuator.reading!r}: found the direction ({told}) with all axes at their reference, "
            f"expected one along x, y or z of the base within {np.degrees(SLANT):g} deg"
        )
    return letters[k], float(np.sign(direction[k]))


def _centre(motion: Array, turn: Array) -> Array:
    """The point (3,) of a rotation's axis whose coordinate along it is 0."""
    k = int(np.argmax(np.abs(turn)))
    rest = [i for i in range(3) if i != k]
    out = np.zeros(3)
    fixed = np.eye(3) - motion[:3, :3]
    out[rest] = np.linalg.lstsq(fixed[:, rest], motion[:3, 3], rcond=None)[0]
    return np.where(np.abs(out) < 1e-9, 0.0, out)


def _tabled(machine: Machine, poses: Poses, p: Array, axes: Sequence[Axis]) -> Table:
    """Return the table of axes with the errors that constants ``p`` give them."""
    reference = references(axes)
    home = poses(reference[None], p)[0]
    out = []
    for k, (axis, actuator) in enumerate(zip(axes, machine.mechanism.actuators, strict=True)):
        low, high = actuator.range or (0.0, 0.0)
        positions = np.unique(np.append(np.linspace(low, high, POINTS), axis.reference))
        q = np.tile(reference, (len(positions), 1))
        q[:, k] = positions
        moved = inverse_pose(_nominal(axis, positions)) @ poses(q, p) @ inverse_pose(home)
        error = _told_at(-axis.centre, moved)
        vector = Rotation.from_matrix(error[:, :3, :3]).as_rotvec()
        out.append(replace(axis, positions=positions, errors=np.hstack([error[:, :3, 3], vector])))
    return Table(tuple(out), home)


def _nominal(axis: Axis, q: Array) -> Array:
    """(n, 4, 4) D(q) from the reference."""
    moved = axis.sign * (q - axis.reference)
    letters = _ROTARY if axis.unit == "rad" else _LINEAR
    along = moved[:, None] * np.eye(3)[letters.index(axis.letter)]
    if axis.unit == "mm":
        return pose_of(np.eye(3), along)
    return _told_at(axis.centre, pose_of(exp_so3(along), np.zeros(3)))


def _told_at(point: Array, motions: Array) -> Array:
    """Motions (n, 4, 4) that are told at a point, as motions of the whole space."""
    out = motions.copy()
    out[:, :3, 3] += point - motions[:, :3, :3] @ point
    return out


def references(axes: Sequence[Axis]) -> Array:
    return np.array([axis.reference for axis in axes])


def _apart(poses: Array, others: Array) -> tuple[float, float]:
    """Largest distance and angle of poses (n, 4, 4)."""
    turn = Rotation.from_matrix(poses[:, :3, :3] @ others[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return float(np.max(np.linalg.norm(poses[:, :3, 3] - others[:, :3, 3], axis=1))), float(np.max(turn))


def _drawn(machine: Machine, model: SymbolicModel) -> Array:
    """(np,) the drawing's joints and links with the calibrated frames, and no effect."""
    drawing = machine.file.nominal if machine.file else {}
    mechanism = {parameter.name for parameter in machine.mechanism.parameters}
    own = {name for effect in machine.effects for name in effect.parameter_names}
    pairs = zip(model.names, model.p_home.tolist(), strict=True)
    return np.array(
        [0.0 if n in own else drawing.get(n, v) if n in mechanism else v for n, v in pairs], dtype=float
    )
