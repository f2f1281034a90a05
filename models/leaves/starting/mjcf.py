"""A machine to start from in an MJCF: what leads to a body, with its loops, written out as a graph with masses and gravity.

MuJoCo itself reads the file, so that defaults, includes, angles and the masses of shapes are what it takes them for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.leaves.starting.compiled_mjcf import Compiled, compiled
from truepose.models.leaves.starting.mjcf_graph import (
    Coupling,
    MjcfGraph,
    PartBody,
    PartJoint,
    Parts,
    Tie,
    Tip,
    choose,
)
from truepose.models.leaves.starting.start import Start, unranged
from truepose.models.lie import inverse_pose, pose_of
from truepose.models.machine.mechanism import JointKind
from truepose.wording import close_matches, cut, shortened

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
    at_joints = np.isin(model.actuator_trntype, _AT_A_JOINT)
    driven = {names[int(joint)] for joint in model.actuator_trnid[at_joints, 0]}
    ties, couplings, unread = [], [], []
    for k in range(model.neq):
        name = model.equality(k).name or f"equality{k + 1}"
        why = _unread_constraint(model, k)
        if why:
            unread.append(f"equality {name!r}, {why}")
        elif model.eq_type[k] == _JOINT:
            couplings.append(_coupling(model, k, names, driven))
        else:
            ties.append(_tie(model, k, name))
    unread += [
        f"actuator {model.actuator(k).name or f'actuator{k + 1}'!r}, which drives no single joint"
        for k in np.flatnonzero(~at_joints).tolist()
    ]
    sites = tuple(
        Tip(int(model.site_bodyid[k]), model.site(k).name, _site_frame(model, k))
        for k in range(model.nsite)
        if model.site(k).name
    )
    stated = frozenset(driven) if model.nu else None
    return Parts(bodies, tuple(ties), tuple(couplings), stated, tuple(unread), sites)


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Return the name of a body, or one by its number."""
    return model.body(body).name or f"body{body}"


def _body(model: mujoco.MjModel, body: int) -> PartBody:
    """Return a body with its joints; one without a name is called after the body, with a number before further ones."""
    name, count, first = body_name(model, body), int(model.body_jntnum[body]), int(model.body_jntadr[body])
    joints = []
    for place, k in enumerate(range(first, first + count), start=1):
        usual = f"{name}{'' if place == count else f'.{place}'}_joint"
        kind = _KINDS[int(model.jnt_type[k])]
        unit, one = _unit(model, k), kind in ("prismatic", "revolute")
        reference = unit * float(model.qpos0[model.jnt_qposadr[k]]) if one else 0.0
        low, high = (unit * float(v) for v in model.jnt_range[k])
        limits = (low, high) if one and model.jnt_limited[k] else None
        axis, anchor = np.array(model.jnt_axis[k]), MM_PER_M * np.array(model.jnt_pos[k])
        joints.append(PartJoint(model.joint(k).name or usual, kind, axis, anchor, reference, limits))
    frame = placed_frame(model.body_pos[body], model.body_quat[body])
    return PartBody(name, int(model.body_parentid[body]), frame, tuple(joints))


def _unit(model: mujoco.MjModel, joint: int) -> float:
    """Return the mm in a joint's metre, or the rad in its rad."""
    return MM_PER_M if _KINDS[int(model.jnt_type[joint])] == "prismatic" else 1.0


def _unread_constraint(model: mujoco.MjModel, k: int) -> str:
    """Return why a constraint is not read; empty where it is."""
    import mujoco

    if not model.eq_active0[k]:
        return "which is not active"
    kind = int(model.eq_type[k])
    if kind not in (_CONNECT, _WELD, _JOINT):
        return f"which is of kind {mujoco.mjtEq(kind).name.removeprefix('mjEQ_').lower()}"
    led = [] if kind == _JOINT else [b for b in _tie(model, k, "").bodies if model.body_mocapid[b] >= 0]
    return f"which the mocap body {body_name(model, led[0])!r} leads" if led else ""


def _coupling(model: mujoco.MjModel, k: int, names: Sequence[str], driven: Collection[str]) -> Coupling:
    """Return what a joint does where another one leads; a line is turned round if only the joint is driven."""
    joint, lead = int(model.eq_obj1id[k]), int(model.eq_obj2id[k])
    own = _unit(model, joint)
    if lead < 0:
        return Coupling(names[joint], "", (float(own * model.eq_data[k, 0]),))
    other = _unit(model, lead)
    shift, slope, *more = (float(own * value / other**n) for n, value in enumerate(model.eq_data[k, :5]))
    if names[joint] in driven and names[lead] not in driven and slope and not any(more):
        return Coupling(names[lead], names[joint], (-shift / slope, 1.0 / slope))
    return Coupling(names[joint], names[lead], (shift, slope, *more))


def _tie(model: mujoco.MjModel, k: int, name: str) -> Tie:
    """Return a constraint between two bodies, or between sites of two."""
    import mujoco

    ends = (int(model.eq_obj1id[k]), int(model.eq_obj2id[k]))
    data, straight = model.eq_data[k], np.array([1.0, 0.0, 0.0, 0.0])
    kind: JointKind = "spherical" if int(model.eq_type[k]) == _CONNECT else "fixed"
    if int(model.eq_objtype[k]) == int(mujoco.mjtObj.mjOBJ_SITE):
        one, other = (_site_frame(model, site) for site in ends)
        ends = (int(model.site_bodyid[ends[0]]), int(model.site_bodyid[ends[1]]))
    elif kind == "spherical":
        one, other = placed_frame(data[:3], straight), placed_frame(data[3:6], straight)
    else:
        one, other = placed_frame(data[3:6], data[6:10]), placed_frame(data[:3], straight)
    return Tie(name, kind, ends, (one, other))


def _site_frame(model: mujoco.MjModel, k: int) -> Array:
    return placed_frame(model.site_pos[k], model.site_quat[k])


def placed_frame(position: ArrayLike, quaternion: ArrayLike) -> Array:
    """Return the frame (4, 4) mm of a position (m) and a quaternion (w, x, y, z)."""
    turn = Rotation.from_quat(np.roll(np.asarray(quaternion), -1)).as_matrix()
    return pose_of(turn, MM_PER_M * np.asarray(position))


WEIGHTLESS = 1e-6
"""kg: what files give bodies that have no mass, as MuJoCo asks; a milligram."""
_NAMED = 4


def mjcf_start(path: Path, tip: str = "") -> Start:
    """Return the start of an MJCF; empty ``tip``: the one last body of its chain; else a body or a site.

    Raises InputError where MuJoCo is missing or refuses the file, and for a machine that no graph holds.
    """
    found = compiled(path)
    model = found.model
    bare = next((k for k in range(model.njnt) if not 0.5 < np.linalg.norm(model.jnt_axis[k]) < 2.0), None)
    if bare is not None:
        raise InputError(
            f"{path}: joint {bare + 1}: found an axis that MuJoCo takes for none, expected a direction"
        )
    try:
        parts = parts_of(model)
    except UnicodeDecodeError:
        raise InputError(f"{path}: found a name that is no text, expected UTF-8") from None
    end = _named_tip(parts, tip, path) if tip else _only_end(parts, path)
    graph = choose(parts, end, str(path))
    section, sites = graph.section(), _site_names(parts, end.site)
    masses, light = _masses(model, graph)
    x, y, z = (
        round(float(v), 9) + 0.0 for v in parts.poses[graph.base][:3, :3].T @ np.array(model.opt.gravity)
    )
    return Start(
        path.stem,
        f"The MJCF {path.name}",
        section,
        (*_notes(graph, path), *unranged(section["joints"]), *_mass_notes(light, found)),
        gravity=(x, y, z),
        masses=masses,
        left_out=(*graph.left_out(), *([f"sites, each of which --tip takes: {sites}"] if sites else [])),
    )


def _notes(graph: MjcfGraph, path: Path) -> Iterator[str]:
    """Yield where the machine begins and ends, and joints that only the absence of a drive could be read from."""
    bodies, driven = graph.parts.bodies, graph.parts.driven
    end = f"site {graph.tip.site}" if graph.tip.site else f"body {bodies[graph.tip.body].name}"
    yield f"Source: {path.name}, from the body {bodies[graph.base].name} to the {end}."
    bare = [joint.name for joint in graph.drives if driven is not None and joint.name not in driven]
    if bare:
        names = shortened(bare, _NAMED)
        yield f"CHECK joints without an actuator and outside loops, taken as read by the recording: {names}."
    if graph.ties:
        yield "CHECK home: loops are closed from where the file has the machine; a singular pose is a bad start."


def _mass_notes(light: Sequence[str], found: Compiled) -> Iterator[str]:
    """Yield which bodies weigh nothing, and what MuJoCo warns of."""
    if light:
        why = "whose meshes were not at hand" if found.bare else "as the source says"
        yield f"Note: bodies without mass, {why}: {shortened(list(light), _NAMED)}. CHECK masses."
    yield from (f"Note: MuJoCo: {said}" for said in found.warnings)


def _masses(model: mujoco.MjModel, graph: MjcfGraph) -> tuple[dict[str, Any], list[str]]:
    """Return masses by the body that carries them, joints off the machine as the file has them, and bodies without any."""
    parts, poses = graph.parts, graph.parts.poses
    sums = {body: np.zeros(4) for body in graph.kept}
    for body in range(1, model.nbody):
        carrier = next((b for b in reversed(parts.way(body)) if b in sums or b == graph.base), graph.base)
        if carrier != graph.base and model.body_mass[body] > WEIGHTLESS:
            centre = poses[body] @ [*(MM_PER_M * model.body_ipos[body]), 1.0]
            local = (inverse_pose(poses[carrier]) @ centre)[:3] - graph.shifts[carrier]
            sums[carrier] += model.body_mass[body] * np.array([1.0, *local])
    heavy = {body: s for body, s in sums.items() if s[0]}
    masses = {
        graph.names[body]: {"kg": float(s[0]), "com": (s[1:] / s[0]).tolist(), "in": graph.names[body]}
        for body, s in heavy.items()
    }
    return masses, [graph.names[b] for b in graph.kept if b not in heavy and parts.bodies[b].joints]


def _named_tip(parts: Parts, name: str, path: Path) -> Tip:
    """Return the body or the site of a name."""
    tips = {site.site: site for site in reversed(parts.sites)}
    tips |= {body.name: Tip(k) for k, body in enumerate(parts.bodies)}
    if name not in tips:
        raise InputError(
            f"--tip: found {cut(name)!r}, no body or site of {path}; {close_matches(name, list(tips))}"
        )
    return tips[name]


def _only_end(parts: Parts, path: Path) -> Tip:
    """Return the one body without others beyond that a hinge, slide or ball leads to."""
    moving = [
        any(parts.bodies[b].joints and not parts.bodies[b].free for b in parts.way(k))
        for k in range(len(parts.bodies))
    ]
    carrying = {body.parent for body in parts.bodies}
    ends = [k for k, moved in enumerate(moving) if moved and k not in carrying]
    if len(ends) != 1:
        names = shortened([cut(parts.bodies[k].name, 60) for k in ends], 10) or "none with joints"
        sites = f" (sites: {_site_names(parts)})" if parts.sites else ""
        raise InputError(
            f"{path}: found several ends of a chain: {names}{sites}, expected one: say which with --tip, which also takes a "
            "site, or a body before they part, such as the flange"
        )
    return Tip(ends[0])


def _site_names(parts: Parts, but: str = "") -> str:
    """Return the names of sites, up to ten, without the one that is the tip."""
    return shortened([cut(site.site, 60) for site in parts.sites if site.site != but], 10)
