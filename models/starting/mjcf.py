"""A machine to start from in an MJCF: the chain from the world to a body, written out as a graph with masses and gravity.

MuJoCo itself reads the file, so that defaults, includes, angles and the masses of shapes are what it takes them for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.models.starting.compiled_mjcf import Compiled, compiled
from truepose.models.starting.mujoco_child import LEAST
from truepose.models.starting.start import Start
from truepose.wording import close_matches, cut, shortened

if TYPE_CHECKING:
    import mujoco

Array = NDArray[np.float64]
_MM = 1000.0
CHAIN_MOST = 500
"""Bodies between the base and the tip."""
NAME_MOST = 200
"""Characters of a name."""
FARTHEST = 1e9
"""m, m/s^2, kg: what is larger in an MJCF is no robot's."""
_NAMED = 4


def mjcf_start(path: Path, tip: str = "") -> Start:
    """The start of an MJCF; empty ``tip``: the body at the end of the chain with the most joints.

    Raises InputError where MuJoCo is missing or refuses the file, and for a chain with ball or free joints.
    """
    found = compiled(path)
    model = found.model
    _check(model, path)
    body = _body(model, tip, path) if tip else _longest(model, path)
    chain = _chain(model, body, path)
    return _Written(model, chain, path).start(found)


@dataclass(frozen=True)
class _Written:
    """The chain of bodies ``chain`` (ids) of a model, the first of which stands still, as a graph."""

    model: mujoco.MjModel
    chain: Sequence[int]
    path: Path

    def start(self, found: Compiled) -> Start:
        """Where meshes were not at hand, bodies whose mass comes from them weigh nothing."""
        poses = _poses(self.model)
        bodies, shifts = [self._name(self.chain[0])], {self.chain[0]: np.zeros(3)}
        joints: list[dict[str, Any]] = []
        for above, body in zip(self.chain, self.chain[1:], strict=False):
            self._add(body, np.linalg.inv(poses[above]) @ poses[body], shifts, bodies, joints, above)
        if shifts[self.chain[-1]].any():
            joints.append(
                _joint("tip_joint", "fixed", bodies[-1], "tip", -shifts[self.chain[-1]], np.zeros(3))
            )
            bodies.append("tip")
        masses, light = self._masses(poses, shifts)
        turned = poses[self.chain[0]][:3, :3].T @ np.array(self.model.opt.gravity)
        gravity = tuple(float(round(v, 9)) + 0.0 for v in turned)
        notes = [
            f"Source: {self.path.name}, from the body {bodies[0]} to the body {self._name(self.chain[-1])}."
        ]
        if light:
            why = "whose meshes were not at hand" if found.bare else "as the source says"
            notes.append(f"Note: bodies without mass, {why}: {shortened(light, _NAMED)}. CHECK masses.")
        notes += [f"Note: MuJoCo: {said}" for said in found.warnings]
        mechanism = {"type": "graph", "bodies": bodies, "flange": bodies[-1], "joints": joints}
        return Start(
            self.path.stem,
            f"The MJCF {self.path.name}",
            mechanism,
            tuple(notes),
            gravity=(gravity[0], gravity[1], gravity[2]),
            masses=masses,
        )

    def _add(
        self,
        body: int,
        frame: Array,
        shifts: dict[int, Array],
        bodies: list[str],
        joints: list[dict[str, Any]],
        above: int,
    ) -> None:
        """A body's joints, each with a body of its own that stands where its anchor is; one without is fixed."""
        name, first, count = self._name(body), self.model.body_jntadr[body], self.model.body_jntnum[body]
        at, rpy = frame[:3, 3] - shifts[above], np.degrees(_rpy(frame[:3, :3]))
        if not count:
            joints.append(_joint(f"{name}_joint", "fixed", bodies[-1], name, at, rpy))
            bodies.append(name)
            shifts[body] = np.zeros(3)
            return
        here = np.zeros(3)
        for k in range(first, first + count):
            anchor = _MM * self.model.jnt_pos[k]
            place = at + frame[:3, :3] @ anchor if k == first else anchor - here
            child = name if k == first + count - 1 else f"{name}.{k - first + 1}"
            turned = rpy if k == first else np.zeros(3)
            joints.append(self._moving(k, bodies[-1], child, place, turned))
            bodies.append(child)
            here = anchor
        shifts[body] = here

    def _moving(self, k: int, parent: str, child: str, at: Array, rpy: Array) -> dict[str, Any]:
        import mujoco

        slides = int(self.model.jnt_type[k]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
        factor = _MM if slides else 180.0 / np.pi
        name = self.model.joint(k).name or f"{child}_joint"
        out = _joint(name, "prismatic" if slides else "revolute", parent, child, at, rpy)
        out |= {"axis": self.model.jnt_axis[k].tolist(), "actuated": True}
        zero = float(self.model.qpos0[self.model.jnt_qposadr[k]])
        if zero:
            out["offset"] = -factor * zero  # the file's pose is where the joint reads this much
        if self.model.jnt_limited[k]:
            out["range"] = (factor * self.model.jnt_range[k]).tolist()
        return out

    def _masses(self, poses: Array, shifts: Mapping[int, Array]) -> tuple[dict[str, Any], list[str]]:
        """Masses by the body of the chain that carries them, joints off the chain at zero; bodies without any."""
        own = set(self.chain[1:])
        sums = {body: np.zeros(4) for body in self.chain[1:]}
        com = _centres(self.model)
        for body in range(1, self.model.nbody):
            carrier = body
            while carrier and carrier not in own and carrier != self.chain[0]:
                carrier = int(self.model.body_parentid[carrier])
            if carrier in own:
                local = poses[carrier][:3, :3].T @ (com[body] - poses[carrier][:3, 3]) - shifts[carrier]
                sums[carrier] += self.model.body_mass[body] * np.array([1.0, *local])
        heavy = {body: s for body, s in sums.items() if s[0] > 10 * LEAST}
        masses = {
            self._name(body): {"kg": float(s[0]), "com": (s[1:] / s[0]).tolist(), "in": self._name(body)}
            for body, s in heavy.items()
        }
        light = [self._name(b) for b in self.chain[1:] if b not in heavy and self.model.body_jntnum[b]]
        return masses, light

    def _name(self, body: int) -> str:
        name = self.model.body(body).name or f"body{body}"
        return f"{name}_body" if name == "base" and body != self.chain[0] else name


def _joint(name: str, kind: str, parent: str, child: str, at: Array, rpy: Array) -> dict[str, Any]:
    return {
        "name": name,
        "kind": kind,
        "parent": parent,
        "child": child,
        "xyz": at.tolist(),
        "rpy": rpy.tolist(),
    }


def _rpy(rotation: Array) -> Array:
    """Roll, pitch, yaw of Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 where the pitch is 90 deg and only a sum is known."""
    across = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = np.arctan2(-rotation[2, 0], across)
    if across < 1e-9:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def _check(model: mujoco.MjModel, path: Path) -> None:
    """Refuse numbers that are no robot's, names that are no text, and axes that MuJoCo itself made nothing of."""
    sizes = {
        "position": model.body_pos, "joint's anchor": model.jnt_pos, "mass": model.body_mass, "gravity": model.opt.gravity,
        "centre of mass": model.body_ipos, "end of a joint's range": model.jnt_range[model.jnt_limited.astype(bool)],
        "joint's reference": model.qpos0,
    }  # fmt: skip
    for what, values in sizes.items():
        odd = [float(v) for v in np.ravel(values) if not abs(v) <= FARTHEST]
        if odd:
            raise InputError(f"{path}: found the {what} {odd[0]:g}, expected at most {FARTHEST:g}")
    try:
        names = [model.body(k).name for k in range(model.nbody)]
        names += [model.joint(k).name for k in range(model.njnt)]
    except UnicodeDecodeError:
        raise InputError(f"{path}: found a name that is no text, expected UTF-8") from None
    long = next((name for name in names if len(name) > NAME_MOST), None)
    if long is not None:
        found = f"the name {cut(long)!r} of {len(long)} characters"
        raise InputError(f"{path}: found {found}, expected at most {NAME_MOST}")
    bare = [k for k in range(model.njnt) if not 0.5 < np.linalg.norm(model.jnt_axis[k]) < 2.0]
    if bare:
        name = cut(model.joint(bare[0]).name)
        raise InputError(
            f"{path}: joint {name!r}: found an axis that MuJoCo takes for none, expected a direction"
        )


def _body(model: mujoco.MjModel, name: str, path: Path) -> int:
    names = [model.body(k).name for k in range(model.nbody)]
    if name not in names:
        raise InputError(f"--tip: found {cut(name)!r}, no body of {path}; {close_matches(name, names)}")
    return names.index(name)


def _longest(model: mujoco.MjModel, path: Path) -> int:
    """The body at the end of the chain with the most joints; fixed bodies behind it do not count."""
    moving = np.zeros(model.nbody, dtype=int)
    for body in range(1, model.nbody):
        moving[body] = moving[model.body_parentid[body]] + model.body_jntnum[body]
    best = [k for k in range(model.nbody) if moving[k] == moving.max() and model.body_jntnum[k]]
    if len(best) != 1:
        named = [cut(model.body(k).name, 60) or f"body{k}" for k in best]
        names = shortened(named, 10) or "none with joints"
        raise InputError(
            f"{path}: found several ends of a chain: {names}, expected one: say which with --tip"
        )
    return best[0]


def _chain(model: mujoco.MjModel, tip: int, path: Path) -> list[int]:
    """Bodies from the last one that stands still to the tip. Raises InputError for joints of other kinds."""
    import mujoco

    chain = [tip]
    while chain[-1]:
        chain.append(int(model.body_parentid[chain[-1]]))
    chain.reverse()
    while len(chain) > 1 and not model.body_jntnum[chain[1]]:
        del chain[0]
    if len(chain) > CHAIN_MOST:
        raise InputError(f"{path}: found {len(chain)} bodies up to the tip, expected at most {CHAIN_MOST}")
    if len(chain) < 2:
        raise InputError(
            f"{path}: found no joint on the way to {cut(model.body(tip).name)!r}, expected another --tip"
        )
    known = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    for body in chain:
        for k in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            if int(model.jnt_type[k]) not in known:
                raise InputError(
                    f"{path}: joint {cut(model.joint(k).name)!r}: found a ball or free joint, expected hinges and "
                    "slides on the way from the base to the tip"
                )
    return chain


def _poses(model: mujoco.MjModel) -> Array:
    """(nbody, 4, 4) of every body in the world as the file places them, mm."""
    data = _placed(model)
    out = np.tile(np.eye(4), (model.nbody, 1, 1))
    out[:, :3, :3], out[:, :3, 3] = data.xmat.reshape(-1, 3, 3), _MM * data.xpos
    return out


def _centres(model: mujoco.MjModel) -> Array:
    """(nbody, 3) centres of mass in the world, mm."""
    return np.asarray(_MM * _placed(model).xipos)


def _placed(model: mujoco.MjModel) -> mujoco.MjData:
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return data


__all__ = ["mjcf_start"]
