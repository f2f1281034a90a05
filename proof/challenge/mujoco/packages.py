"""Arms that public model packages ship as MJCF, read from their files and compiled by MuJoCo.

Nothing of a package is imported or copied: its folder is found, its XML is read. Lengths m, angles rad, as in MJCF.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.errors import InputError

try:
    import mujoco
except ImportError as exc:
    raise InputError(
        "challenge.mujoco: found no package 'mujoco', expected the extra: pip install '.[mujoco]'"
    ) from exc

Array = NDArray[np.float64]
ARMS = "models/assets/robots/{}/robot.xml"
SHOWN = ("geom", "camera", "light", "actuator", "asset", "sensor", "keyframe", "contact")
"""Elements without a part in the kinematics, where every moving body states its inertia."""


@dataclass(frozen=True)
class Source:
    """Where an arm is: package, file in it, the body that carries the tool; ``bare``: its bodies state their inertia,
    and what is only shown or touched can be left out, meshes first."""

    package: str
    file: str
    tip: str
    bare: bool = True


@dataclass(frozen=True)
class Package:
    """An arm with all joints at zero, in the frame of the world of its MJCF, m and kg.

    anchors, axes (n, 3): of the hinges on the way to ``tip`` (4, 4), base first; ranges (n, 2) rad; masses (n + 1,)
    and centres (n + 1, 3) of what moves with each joint, the stand first.
    """

    anchors: Array
    axes: Array
    ranges: Array
    masses: Array
    centres: Array
    tip: Array
    model: Any
    tip_body: int
    addresses: NDArray[np.int64]

    def pose(self, q: Array) -> Array:
        """(4, 4) of the tip by the package's own model, joints (n,) rad."""
        data = mujoco.MjData(self.model)
        data.qpos[self.addresses] = q
        mujoco.mj_kinematics(self.model, data)
        return _frame(data, self.tip_body)


SOURCES: Mapping[str, Source] = {
    "ur5e": Source("robosuite", ARMS.format("ur5e"), "right_hand"),
    "panda": Source("robosuite", ARMS.format("panda"), "right_hand"),
    "sawyer": Source("robosuite", ARMS.format("sawyer"), "right_hand"),
    "iiwa": Source("robosuite", ARMS.format("iiwa"), "right_hand"),
    "kinova3": Source("robosuite", ARMS.format("kinova3"), "right_hand"),
    "xarm7": Source("robosuite", ARMS.format("xarm7"), "right_hand"),
    "jaco": Source("dm_control", "third_party/kinova/jaco_arm.xml", "b_6", bare=False),
}


def installed() -> tuple[str, ...]:
    """Names of the arms whose packages are here."""
    return tuple(name for name, source in SOURCES.items() if _path(source) is not None)


def read(name: str) -> Package:
    """An arm by name. Raises InputError for one that is unknown or whose package is not installed."""
    if name not in SOURCES:
        raise InputError(f"challenge.mujoco: found arm {name!r}, expected one of {', '.join(SOURCES)}")
    source = SOURCES[name]
    path = _path(source)
    if path is None:
        raise InputError(
            f"challenge.mujoco: found no package {source.package!r} with {source.file}, which arm {name!r} is from; "
            "expected the extra: pip install '.[mujoco]'"
        )
    model = _bare(path) if source.bare else mujoco.MjModel.from_xml_path(str(path))
    return _read(model, source.tip)


def _path(source: Source) -> Path | None:
    found = find_spec(source.package)
    for folder in (found.submodule_search_locations or ()) if found else ():
        if (Path(folder) / source.file).is_file():
            return Path(folder) / source.file
    return None


def _bare(path: Path) -> Any:
    """The model without what is only shown, so that no mesh is read."""
    root = ET.parse(path).getroot()
    for parent in list(root.iter()):
        for child in [c for c in parent if c.tag in SHOWN]:
            parent.remove(child)
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def _read(model: Any, tip: str) -> Package:
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_forward(model, data)
    tip_body = model.body(tip).id
    joints = _way(model, tip_body)
    carriers = [0, *(int(model.jnt_bodyid[j]) for j in joints)]
    link = {int(model.body_weldid[body]): k for k, body in enumerate(carriers)}
    masses, moments = np.zeros(len(carriers)), np.zeros((len(carriers), 3))
    for body in range(1, model.nbody):
        k = link.get(int(model.body_weldid[body]))
        if k is not None:  # a finger that moves by itself is no part of the arm
            masses[k] += model.body_mass[body]
            moments[k] += model.body_mass[body] * data.xipos[body]
    axes = data.xaxis[joints].copy()
    return Package(
        data.xanchor[joints].copy(),
        axes / np.linalg.norm(axes, axis=1, keepdims=True),
        np.where(model.jnt_limited[joints][:, None], model.jnt_range[joints], [-np.inf, np.inf]),
        masses,
        moments / np.maximum(masses, 1e-12)[:, None],
        _frame(data, tip_body),
        model,
        tip_body,
        model.jnt_qposadr[joints].astype(np.int64),
    )


def _way(model: Any, body: int) -> list[int]:
    """The hinges from the world to a body, in that order."""
    joints: list[int] = []
    while body:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints = [*range(first, first + count), *joints]
        body = int(model.body_parentid[body])
    return joints


def _frame(data: Any, body: int) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = data.xmat[body].reshape(3, 3), data.xpos[body]
    return out


__all__ = ["SOURCES", "Package", "Source", "installed", "read"]
