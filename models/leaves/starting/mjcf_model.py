"""The parts of a model that MuJoCo compiled: defaults, includes, angles and shapes are what MuJoCo takes them for.

Source: MuJoCo documentation, XML reference (``joint``, ``equality``, ``actuator``), and ``mj_instantiateEquality``, which says
what the numbers of a constraint mean.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.models.leaves.starting.mjcf_parts import Coupling, PartBody, PartJoint, Parts, Tie, Tip
from truepose.models.lie import pose_of
from truepose.models.machine.mechanism import JointKind

if TYPE_CHECKING:
    import mujoco

MM_PER_M = 1000.0
_KINDS: tuple[JointKind, ...] = ("free", "spherical", "prismatic", "revolute")
"""In the order of MuJoCo's mjtJoint."""
_CONNECT, _WELD, _JOINT = range(3)
"""The first of MuJoCo's mjtEq."""
_AT_A_JOINT = (0, 1)
"""Of MuJoCo's mjtTrn: in the joint's child, in its parent."""


def parts_of(model: mujoco.MjModel) -> Parts:
    """Return the parts of a compiled model."""
    bodies = tuple(_body(model, k) for k in range(model.nbody))
    names = [joint.name for body in bodies for joint in body.joints]  # in MuJoCo's order
    ties, couplings, unread = [], [], []
    for k in range(model.neq):
        kind, name = int(model.eq_type[k]), model.equality(k).name or f"equality{k + 1}"
        why = _unread_constraint(model, k)
        if why:
            unread.append(f"equality {name!r}, {why}")
        elif kind == _JOINT:
            couplings.append(_coupling(model, k, names))
        else:
            ties.append(_tie(model, k, name))
    at_joints = np.isin(model.actuator_trntype, _AT_A_JOINT)
    driven = {names[int(joint)] for joint in model.actuator_trnid[at_joints, 0]}
    unread += [
        f"actuator {model.actuator(k).name or f'actuator{k + 1}'!r}, which drives no single joint"
        for k in np.flatnonzero(~at_joints).tolist()
    ]
    stated = frozenset(driven) if model.nu else None
    sites = tuple(
        Tip(int(model.site_bodyid[k]), model.site(k).name, _site_frame(model, k))
        for k in range(model.nsite)
        if model.site(k).name
    )
    return Parts(bodies, tuple(ties), tuple(couplings), stated, tuple(unread), sites).led_by_drives()


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body, or one by its number."""
    return model.body(body).name or f"body{body}"


def _body(model: mujoco.MjModel, k: int) -> PartBody:
    frame = placed_frame(model.body_pos[k], model.body_quat[k])
    return PartBody(body_name(model, k), int(model.body_parentid[k]), frame, tuple(_joints(model, k)))


def _joints(model: mujoco.MjModel, body: int) -> Iterator[PartJoint]:
    """Yield the joints of a body; one without a name is called after the body, with a number before further ones."""
    count, first = int(model.body_jntnum[body]), int(model.body_jntadr[body])
    for place, k in enumerate(range(first, first + count), start=1):
        usual = f"{body_name(model, body)}{'' if place == count else f'.{place}'}_joint"
        kind = _KINDS[int(model.jnt_type[k])]
        unit = MM_PER_M if kind == "prismatic" else 1.0
        one = kind in ("prismatic", "revolute")
        reference = unit * float(model.qpos0[model.jnt_qposadr[k]]) if one else 0.0
        low, high = (unit * float(v) for v in model.jnt_range[k])
        limits = (low, high) if one and model.jnt_limited[k] else None
        axis, anchor = np.array(model.jnt_axis[k]), MM_PER_M * np.array(model.jnt_pos[k])
        yield PartJoint(model.joint(k).name or usual, kind, axis, anchor, reference, limits)


def _unread_constraint(model: mujoco.MjModel, k: int) -> str:
    """Return why a constraint is not read; empty where it is."""
    import mujoco

    if not model.eq_active0[k]:
        return "which is not active"
    kind = int(model.eq_type[k])
    if kind not in (_CONNECT, _WELD, _JOINT):
        return f"which is of kind {mujoco.mjtEq(kind).name.removeprefix('mjEQ_').lower()}"
    led = [] if kind == _JOINT else [b for b in _ends(model, k) if model.body_mocapid[b] >= 0]
    return f"which the mocap body {body_name(model, led[0])!r} leads" if led else ""


def _coupling(model: mujoco.MjModel, k: int, names: list[str]) -> Coupling:
    joint, lead = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    own, other = (MM_PER_M if _KINDS[int(model.jnt_type[j])] == "prismatic" else 1.0 for j in (joint, lead))
    terms = [float(own * value / other**n) for n, value in enumerate(model.eq_data[k, :5])]
    return (
        Coupling(names[joint], names[lead], tuple(terms))
        if lead >= 0
        else Coupling(names[joint], "", (terms[0],))
    )


def _ends(model: mujoco.MjModel, k: int) -> tuple[int, int]:
    """Return the bodies at both ends of a constraint between bodies or sites."""
    one, other = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    if _between_sites(model, k):
        return int(model.site_bodyid[one]), int(model.site_bodyid[other])
    return one, other


def _between_sites(model: mujoco.MjModel, k: int) -> bool:
    import mujoco

    return int(model.eq_objtype[k]) == int(mujoco.mjtObj.mjOBJ_SITE)


def _tie(model: mujoco.MjModel, k: int, name: str) -> Tie:
    data, straight = model.eq_data[k], np.array([1.0, 0.0, 0.0, 0.0])
    kind: JointKind = "spherical" if int(model.eq_type[k]) == _CONNECT else "fixed"
    if _between_sites(model, k):
        sites = (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]))
        one, other = (_site_frame(model, site) for site in sites)
    elif kind == "spherical":
        one, other = placed_frame(data[:3], straight), placed_frame(data[3:6], straight)
    else:
        one, other = placed_frame(data[3:6], data[6:10]), placed_frame(data[:3], straight)
    return Tie(name, kind, _ends(model, k), (one, other))


def _site_frame(model: mujoco.MjModel, k: int) -> Array:
    return placed_frame(model.site_pos[k], model.site_quat[k])


def placed_frame(position: ArrayLike, quaternion: ArrayLike) -> Array:
    """Return the frame (4, 4) mm of a position (m) and a quaternion (w, x, y, z)."""
    turn = Rotation.from_quat(np.roll(np.asarray(quaternion), -1)).as_matrix()
    return pose_of(turn, MM_PER_M * np.asarray(position))
