"""An arm with what yields in it as MJCF: motor hinges as commanded, and behind them springs, gaps, friction, halves of links.

m, kg, N, rad. A joint is up to three hinges on one axis, in series: ``q3`` turns as its motor does, ``q3.gap`` is free
within the play, ``q3.spring`` gives way. Friction acts on their sum, a fixed tendon, because it rubs where the link
turns. Links are cut where a beam of one or two lumped springs bends, mounts turn about springs in their origin.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
STEP = 0.002
RATE = 100.0
"""1/s: springs settle at this rate, critically damped; inertia is added for that, which no rest depends on."""
GAP_INERTIA, GAP_DAMPING = 1.0, 5.0
LOOSE_INERTIA, LOOSE_DAMPING = 0.05, 0.5
"""kg m^2 and N m s/rad of what is free: it falls to its stop in a tenth of a second."""
MOTOR_INERTIA = 1e9
"""kg m^2: nothing behind it turns a motor."""
HARD = {"solimp": "0.9999 0.9999 0.001 0.5 2", "solref": f"{2 * STEP} 1"}
"""How MuJoCo resists at stops and in friction: a millionth of what is free gets through."""
CUTS = {1: (0.5,), 2: (0.5 - 12**-0.5, 0.5 + 12**-0.5)}
"""Shares of a link's length at which it is cut: in the middle, or at the points that give a cantilever's end exactly."""
POISSON = 0.3
DUST = 1e-9
"""kg and kg m^2 of a body that only carries hinges."""


@dataclass(frozen=True)
class Bend:
    """A link of bending stiffness ``stiffness`` N m^2, cut into 1 or 2 hinged ``pieces``; ``twists`` as a round tube does."""

    stiffness: float
    pieces: int
    twists: bool


@dataclass(frozen=True)
class Yielding:
    """What gives way. By joint from 0: springs N m/rad, gaps rad (the whole play), friction N m; ``fed`` joints whose drive
    bears the weight itself. couplings: (driven, driving) to ratio; bends by link from 1; mounts: N m/rad about x, y, z.
    loose: rad of play about both axes across a joint's (``q3``), or across z of the tool's mount (``tool``)."""

    springs: Mapping[int, float] = field(default_factory=dict)
    gaps: Mapping[int, float] = field(default_factory=dict)
    friction: Mapping[int, float] = field(default_factory=dict)
    fed: frozenset[int] = frozenset()
    couplings: Mapping[tuple[int, int], float] = field(default_factory=dict)
    bends: Mapping[int, Bend] = field(default_factory=dict)
    mounts: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    loose: Mapping[str, float] = field(default_factory=dict)

    @property
    def remembers(self) -> bool:
        """Whether where it stands depends on the way there."""
        return bool(self.gaps or self.friction or self.loose)


@dataclass(frozen=True)
class Build:
    """An arm as built: rows (n, 5) m and rad, tool (4, 4) on the flange, masses by body (``link1`` ..., ``tool``,
    ``payload``) with centres in the link's or the tool's frame, gravity (3,) in frame 0."""

    rows: Array
    tool: Array
    masses: Mapping[str, tuple[float, Array]]
    gravity: Array


COUPLED = 1e8
"""N m/rad of the belt that couples two joints: it does not give way itself."""


def mjcf(build: Build, yielding: Yielding) -> str:
    """The model's XML; the site ``tool`` is what an instrument sees."""
    root = ET.Element("mujoco", model="arm")
    ET.SubElement(root, "compiler", angle="radian", autolimits="true")
    option = ET.SubElement(
        root, "option", gravity=_text(build.gravity), timestep=str(STEP), integrator="implicitfast"
    )
    option.set("iterations", "50")
    option.set("tolerance", "0")
    ET.SubElement(option, "flag", contact="disable")
    body = _mount(ET.SubElement(root, "worldbody"), "base", np.eye(4), yielding)
    for k, row in enumerate(build.rows):
        body = _link(body, k, row, build, yielding)
    body = _mount(body, "tool", np.eye(4), yielding)
    end = _body(body, "tool", build.tool, build.masses.get("tool"))
    ET.SubElement(end, "site", name="tool")
    if "payload" in build.masses:
        _body(end, "payload", np.eye(4), build.masses["payload"])
    _tendons(root, yielding, len(build.rows))
    return ET.tostring(root, encoding="unicode")


def _link(parent: ET.Element, k: int, row: Array, build: Build, yielding: Yielding) -> ET.Element:
    """The body of joint k (from 0) with its hinges; returned is its far end, where the next one is hung up."""
    beta, alpha, d, theta, r = row
    tilt = Rotation.from_euler("YX", [beta, alpha])
    at = _frame(tilt * Rotation.from_euler("z", theta), tilt.apply([d, 0.0, r]))
    link, bend = k + 1, yielding.bends.get(k + 1)
    mass = build.masses[f"link{link}"]
    cuts, span = _cuts(build.rows, k, bend)
    behind = _half(mass[1], cuts, span)
    body = _body(parent, f"link{link}", at, mass if behind == 0 else None)
    _hinges(body, k, yielding)
    for piece, cut in enumerate(cuts, start=1):
        at = _frame(Rotation.identity(), cut if piece == 1 else cut - cuts[piece - 2])
        centre = (mass[0], mass[1] - cut) if behind == piece else None
        body = _body(body, f"link{link}.piece{piece}", at, centre)
        assert bend is not None
        _beam(body, f"link{link}.piece{piece}", bend, span)
    return (
        body
        if not len(cuts)
        else _body(body, f"link{link}.end", _frame(Rotation.identity(), -cuts[-1]), None)
    )


def _cuts(rows: Array, k: int, bend: Bend | None) -> tuple[Array, Array]:
    """(c, 3) where link k + 1 is cut, and the way (3,) from its root, before ``r``, to where the next axis is."""
    if bend is None:
        return np.zeros((0, 3)), np.zeros(3)
    root = np.array([0.0, 0.0, -rows[k, 4]])
    span = reach(rows, k)
    return root + np.outer(CUTS[bend.pieces], span), span


def reach(rows: Array, k: int) -> Array:
    """(3,) m: way along link k + 1, ``r`` of its own joint and ``d`` of the next, in its frame."""
    beta, _, d, _, _ = rows[k + 1]
    return np.array([d * np.cos(beta), 0.0, rows[k, 4] - d * np.sin(beta)])


def _half(centre: Array, cuts: Array, span: Array) -> int:
    """Behind how many cuts a mass lies."""
    return int(sum((centre - cut) @ span > 0 for cut in cuts))


def _hinges(body: ET.Element, k: int, yielding: Yielding) -> None:
    _across(body, f"q{k + 1}", yielding)
    _joint(body, f"q{k + 1}", (0, 0, 1), armature=MOTOR_INERTIA)
    if k in yielding.gaps:
        _free(body, f"q{k + 1}.gap", (0, 0, 1), yielding.gaps[k], GAP_INERTIA, GAP_DAMPING)
    if k in yielding.springs:
        _spring(body, f"q{k + 1}.spring", (0, 0, 1), yielding.springs[k])
    for driven, driving in yielding.couplings:
        if driven == k:
            _spring(body, f"q{k + 1}.by.q{driving + 1}", (0, 0, 1), COUPLED, own=False)


def _beam(body: ET.Element, name: str, bend: Bend, span: Array) -> None:
    """Hinges across a link, and along it where it twists."""
    length = float(np.linalg.norm(span))
    along = span / length
    first = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
    first /= np.linalg.norm(first)
    each = bend.pieces * bend.stiffness / length
    _spring(body, f"{name}.u", first, each)
    _spring(body, f"{name}.v", np.cross(along, first), each)
    if bend.twists:
        _spring(body, f"{name}.w", along, each / (1 + POISSON))


def _mount(parent: ET.Element, name: str, at: Array, yielding: Yielding) -> ET.Element:
    if name not in yielding.mounts and name not in yielding.loose:
        return parent
    body = _body(parent, f"{name}.mount", at, None)
    for axis, direction, stiffness in zip("xyz", np.eye(3), yielding.mounts.get(name, ()), strict=False):
        _spring(body, f"{name}.{axis}", direction, stiffness)
    _across(body, name, yielding)
    return body


def _across(body: ET.Element, name: str, yielding: Yielding) -> None:
    """Play about x and y, where there is any."""
    if name in yielding.loose:
        for axis, direction in (("x", (1, 0, 0)), ("y", (0, 1, 0))):
            _free(body, f"{name}.loose.{axis}", direction, yielding.loose[name], LOOSE_INERTIA, LOOSE_DAMPING)


def _tendons(root: ET.Element, yielding: Yielding, n: int) -> None:
    tendon = ET.SubElement(root, "tendon")
    for k in range(n):
        if k in yielding.friction:
            rubs = ET.SubElement(
                tendon, "fixed", name=f"q{k + 1}.friction", frictionloss=repr(yielding.friction[k])
            )
            rubs.set("solreffriction", HARD["solref"])
            rubs.set("solimpfriction", HARD["solimp"])
            behind = [
                name for name, has in (("gap", yielding.gaps), ("spring", yielding.springs)) if k in has
            ]
            for joint in (f"q{k + 1}", *(f"q{k + 1}.{name}" for name in behind)):
                ET.SubElement(rubs, "joint", joint=joint, coef="1")
    for (driven, driving), ratio in yielding.couplings.items():
        name = f"q{driven + 1}.by.q{driving + 1}"
        belt = ET.SubElement(tendon, "fixed", name=name, stiffness=repr(COUPLED), springlength="0")
        ET.SubElement(belt, "joint", joint=name, coef="1")
        ET.SubElement(belt, "joint", joint=f"q{driving + 1}", coef=repr(-ratio))


def _spring(
    body: ET.Element, name: str, axis: Array | tuple[int, int, int], stiffness: float, *, own: bool = True
) -> None:
    """A hinge that settles at ``RATE``; ``own``: by a spring of its own, else by what is tied to it."""
    hinge = _joint(body, name, axis, armature=stiffness / RATE**2, damping=2 * stiffness / RATE)
    if own:
        hinge.set("stiffness", repr(float(stiffness)))


def _free(
    body: ET.Element, name: str, axis: tuple[int, int, int], play: float, inertia: float, damping: float
) -> None:
    """A hinge without a spring between two hard stops, ``play`` rad apart."""
    hinge = _joint(body, name, axis, armature=inertia, damping=damping)
    hinge.set("range", _text([-play / 2, play / 2]))
    hinge.set("solreflimit", HARD["solref"])
    hinge.set("solimplimit", HARD["solimp"])


def _joint(body: ET.Element, name: str, axis: Array | tuple[int, int, int], **fields: float) -> ET.Element:
    written = {key: repr(float(value)) for key, value in fields.items()}
    return ET.SubElement(body, "joint", {"name": name, "type": "hinge", "axis": _text(axis), **written})


def _body(parent: ET.Element, name: str, at: Array, mass: tuple[float, Array] | None) -> ET.Element:
    x, y, z, w = Rotation.from_matrix(at[:3, :3]).as_quat()
    body = ET.SubElement(parent, "body", name=name, pos=_text(at[:3, 3]), quat=_text((w, x, y, z)))
    kg, centre = mass if mass is not None and mass[0] > DUST else (DUST, np.zeros(3))
    inertia = max(0.01 * kg, DUST)
    ET.SubElement(body, "inertial", mass=repr(float(kg)), pos=_text(centre), diaginertia=_text([inertia] * 3))
    return body


def _frame(rotation: Rotation, origin: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), origin
    return out


def _text(values: Array | tuple[float, ...] | list[float]) -> str:
    return " ".join(repr(float(v)) for v in values)


__all__ = ["RATE", "STEP", "Bend", "Build", "Yielding", "mjcf", "reach"]
