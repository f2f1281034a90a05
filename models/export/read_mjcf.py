"""Read an exported MJCF: bodies, joints and equality constraints as MuJoCo defines them, in expressions of CasADi.

Joints move a body one after the other, each about or along its axis through ``pos``; at its ``ref`` a joint leaves the body
where the file has it. Loops are closed by Newton's method from there. Source: MuJoCo documentation, XML reference (``joint``,
``freejoint``, ``equality/connect``, ``equality/weld``, ``equality/joint``) and "Computation", "Kinematics".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.models import lie
from truepose.models.builders.urdf_xml import parse_own_xml
from truepose.models.export.numbers import MM_PER_M

Array = NDArray[np.float64]
_ROUNDS = 50
_REST = 1e-14
"""m or rad; what rounding leaves of a step of Newton's method."""
_CLOSED = 1e-12
"""m or rad; loops that lack no more are closed."""


@dataclass(frozen=True)
class Mjcf:
    """A model that was read: ``ranges`` of driven joints (mm or rad, None without limits), and ``tool``, the name of its site.

    ``solved`` takes readings (m, rad) and unknowns to equations and slopes, ``places`` takes them to the frames of ``names``.
    """

    ranges: Mapping[str, tuple[float, float] | None]
    tool: str
    units: Sequence[float]
    names: tuple[str, ...]
    solved: ca.Function
    places: ca.Function

    def frames(self, readings: Sequence[float]) -> dict[str, Array] | None:
        """Return the frames (4, 4) mm of bodies and sites in the world at readings (mm, rad), None where loops stay open."""
        q, x = np.divide(readings, self.units), np.zeros(self.solved.size1_in(1))
        for _ in range(_ROUNDS):
            gap, slope = (np.array(out) for out in self.solved(q, x))
            step = np.linalg.lstsq(slope, gap.ravel(), rcond=None)[0] if x.size else x
            x -= step
            if np.max(np.abs(step), initial=0.0) < _REST:
                break
        if not np.max(np.abs(np.array(self.solved(q, x)[0])), initial=0.0) <= _CLOSED:
            return None
        poses = _split_frames(self.places(q, x))
        poses[:, :3, 3] *= MM_PER_M
        return dict(zip(self.names, poses, strict=True))


def read_mjcf(text: str, readings: Sequence[str]) -> Mjcf:
    """Return the model of a text whose joints ``readings`` are driven. Raises KeyError for a joint that it has not."""
    root = parse_own_xml(text)
    joints = {joint.get("name", ""): joint for joint in root.iterfind("worldbody//joint")}
    driven = [joints[name] for name in readings]
    compiler, world, site = (root.find(path) for path in ("compiler", "worldbody", "worldbody//site"))
    radian = compiler is not None and compiler.get("angle") == "radian"
    model = _Model(1.0 if radian else np.pi / 180.0, {name: ca.SX.sym("q") for name in readings})
    for element in root.iterfind("equality/joint"):
        model.follow(element, joints)
    if world is not None:
        model.add(world, "world", ca.SX.eye(4))
    q, x = ca.vertcat(*model.driven.values()), ca.vertcat(ca.SX(0, 1), *model.unknown)
    places = ca.Function("places", [q, x], [ca.horzcat(*model.frames.values())])
    start = _split_frames(
        places([model.measure(joint, "ref", "0")[0] for joint in driven], np.zeros(x.numel()))
    )
    at = dict(zip(model.frames, start, strict=True))
    gap = ca.vertcat(ca.SX(0, 1), *(g for e in root.iterfind("equality/*") for g in model.gaps(e, at)))
    solved = ca.Function("solved", [q, x], [ca.densify(gap), ca.densify(ca.jacobian(gap, x))])
    units = [MM_PER_M if joint.get("type") == "slide" else 1.0 for joint in driven]
    ranges = dict.fromkeys(readings)
    for name, joint, unit in zip(readings, driven, units, strict=True):
        if "range" in joint.attrib:
            low, high = model.measure(joint, "range", "")
            ranges[name] = (unit * low, unit * high)
    tool = "" if site is None else site.get("name", "")
    return Mjcf(ranges, tool, units, tuple(model.frames), solved, places)


def _split_frames(columns: ca.DM) -> Array:
    """Return the frames (n, 4, 4) that stand side by side."""
    return np.array(columns).reshape(4, -1, 4).transpose(1, 0, 2)


@dataclass
class _Model:
    """What was read so far: values of joints, unknown coordinates, and frames (4, 4) by name. m, and ``turn`` rad to angles."""

    turn: float
    driven: dict[str, ca.SX]
    followed: dict[str, ca.SX] = field(default_factory=dict)
    unknown: list[ca.SX] = field(default_factory=list)
    frames: dict[str, ca.SX] = field(default_factory=dict)

    def measure(self, joint: ElementTree.Element, attribute: str, usual: str) -> list[float]:
        """Return numbers that a joint counts by, m or rad."""
        factor = 1.0 if joint.get("type") == "slide" else self.turn
        return [factor * value for value in _read_numbers(joint, attribute, usual)]

    def follow(self, element: ElementTree.Element, joints: Mapping[str, ElementTree.Element]) -> None:
        """Move a joint as a polynomial of another says: (q1 - ref1) = polynomial(q2 - ref2)."""
        one, other = element.get("joint1", ""), element.get("joint2", "")
        (ref,), (start,) = (self.measure(joints[name], "ref", "0") for name in (one, other))
        terms = _read_numbers(element, "polycoef", "0 1 0 0 0")
        powers = [(self.driven[other] - start) ** k for k in range(len(terms))]
        self.followed[one] = ref + ca.dot(ca.DM(terms), ca.vertcat(*powers))

    def add(self, element: ElementTree.Element, name: str, frame: ca.SX) -> None:
        """Add a body that its parent, its place and its joints have brought to a frame, with all that it carries."""
        self.frames[name] = frame
        for body in element.findall("body"):
            placed = frame @ _read_pose(body)
            for joint in body:
                if joint.tag in ("joint", "freejoint"):
                    placed = placed @ self._motion(joint)
            self.add(body, body.get("name", ""), placed)
        for site in element.findall("site"):  # behind the bodies, of which one may have its name
            self.frames[site.get("name", "")] = frame @ _read_pose(site)

    def _motion(self, joint: ElementTree.Element) -> ca.SX:
        kind = "free" if joint.tag == "freejoint" else joint.get("type", "hinge")
        if kind in ("ball", "free"):
            turned = lie.mrp_rotation(self._new(3))
            if kind == "free":
                return lie.transform(turned, self._new(3))
            return _rotate_about(_read_numbers(joint, "pos", "0 0 0"), turned)
        name = joint.get("name", "")
        value = self.driven.get(name, self.followed.get(name))
        if value is None:
            value = self._new(1)
        moved = value - self.measure(joint, "ref", "0")[0]
        axis = ca.SX(ca.DM(lie.unit_vector(_read_numbers(joint, "axis", "0 0 1"))))
        if kind == "slide":
            return lie.transform(ca.SX.eye(3), axis * moved)
        return _rotate_about(_read_numbers(joint, "pos", "0 0 0"), lie.axis_rotation(axis, moved))

    def _new(self, size: int) -> ca.SX:
        self.unknown.append(ca.SX.sym("x", size))
        return self.unknown[-1]

    def gaps(self, element: ElementTree.Element, start: Mapping[str, Array]) -> list[ca.SX]:
        """Return what a constraint lacks; a ``connect`` holds the points together that are one at the ``start``."""
        if element.tag == "joint":
            return []
        names = [element.get("body1", "world"), element.get("body2", "world")]
        one, other = (self.frames[name] for name in names)
        if element.tag == "connect":
            anchor = np.append(_read_numbers(element, "anchor", "0 0 0"), 1.0)
            point = np.linalg.solve(start[names[1]], start[names[0]] @ anchor)
            return [(one @ ca.DM(anchor) - other @ ca.DM(point))[:3]]
        numbers = _read_numbers(element, "relpose", "")
        apart = lie.inverse(one @ _pose_of(numbers[:3], numbers[3:])) @ other
        return [apart[:3, 3], lie.vee(apart[:3, :3])]


def _read_numbers(element: ElementTree.Element, attribute: str, usual: str) -> list[float]:
    return [float(word) for word in element.get(attribute, usual).split()]


def _read_pose(element: ElementTree.Element) -> ca.SX:
    return _pose_of(_read_numbers(element, "pos", "0 0 0"), _read_numbers(element, "quat", "1 0 0 0"))


def _pose_of(position: Sequence[float], quaternion: Sequence[float]) -> ca.SX:
    """Return a pose (4, 4) of a position (m) and a quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_quat([x, y, z, w]).as_matrix(), position
    return ca.SX(ca.DM(out))


def _rotate_about(point: Sequence[float], rotation: ca.SX) -> ca.SX:
    """Return a rotation (3, 3) about a point as a motion (4, 4)."""
    centre = ca.SX(ca.DM(point))
    return lie.transform(rotation, centre - rotation @ centre)


__all__ = ["Mjcf", "read_mjcf"]
