"""A URDF's links and joints, checked: what the chain, its inertias and ``truepose init`` read of it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from xml.etree import ElementTree

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.files import read_input
from truepose.models.lie import pose_of, rpy_matrix
from truepose.models.machine.mechanism import Inertial
from truepose.models.units import UnitSystem
from truepose.wording import close_matches, cut, shortened


class _Tree(ElementTree.TreeBuilder):
    """Elements as they come; a document type and xacro are refused."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        """Entities are declared there: they may stand for gigabytes, and for other files."""
        raise InputError(
            f"{self._path}: found <!DOCTYPE {cut(name, 40)}>, expected a URDF without a document type"
        )

    def start(self, tag: str, attrs: dict[str, str], /) -> ElementTree.Element:
        if "/xacro}" in tag:
            raise InputError(
                f"{self._path}: found xacro (<xacro:{cut(tag.rpartition('}')[2], 40)}>), expected the URDF that is made of it: "
                "xacro robot.urdf.xacro > robot.urdf"
            )
        return super().start(tag, attrs)


def parse_own_xml(text: str) -> ElementTree.Element:
    """Return the root element of a text that truepose itself wrote. Raises ElementTree.ParseError for broken XML."""
    return ElementTree.fromstring(text)


def read_urdf(path: Path) -> ElementTree.Element:
    """Return the element ``robot``. Raises InputError for a missing file, broken XML, and xacro."""
    try:
        data = read_input(path)
    except OSError as exc:
        raise InputError(f"{path}: cannot read the URDF: {exc.strerror or exc}") from None
    return parse_urdf(data, path)


def parse_urdf(data: bytes, path: Path) -> ElementTree.Element:
    """Return the element ``robot`` of what a file holds. Raises InputError as ``read_urdf``."""
    try:
        parser = ElementTree.XMLParser(target=_Tree(path))
        parser.feed(data)
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as exc:
        raise InputError(f"{path}: cannot read the URDF: broken XML: {cut(str(exc))}") from None
    if root.tag != "robot":
        raise InputError(f"{path}: found <{cut(root.tag)}>, expected <robot>")
    return root


_T = TypeVar("_T")
KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
MM_PER_M = 1000.0
CHAIN_MOST = 500
"""Joints between a base and a tip, the fixed ones among them."""
NAME_MOST = 200
"""Characters of the name of a link or joint."""
FARTHEST = 1e9
"""m, rad, kg: what is larger in a URDF is no robot's."""
_TOP = ("link", "joint", "material")
_OF_JOINTS = ("parent", "child", "origin", "axis", "limit", "mimic")
_AXIS = (1.0, 0.0, 0.0)
"""Axis of a joint that states none."""


@dataclass(frozen=True)
class Robot:
    """A URDF's links and joints; every message names the file and the element."""

    path: Path
    links: frozenset[str]
    above: Mapping[str, ElementTree.Element]
    """The joint that carries each link."""
    elements: tuple[ElementTree.Element, ...] = ()
    """The links' elements."""
    unread: tuple[str, ...] = ()
    """Kinds of elements that nothing here reads, such as `transmission`, sorted; shapes and materials aside."""

    @classmethod
    def read(cls, path: Path) -> Robot:
        """Read and check what all joints share. Raises InputError for a missing file and broken XML."""
        return cls.of(read_urdf(path), path)

    @classmethod
    def of(cls, root: ElementTree.Element, path: Path) -> Robot:
        """Check what all joints share in the element ``robot`` of a file. Raises InputError naming the element."""
        links = [link.get("name", "") for link in root.findall("link")]
        joints = [joint.get("name", "") for joint in root.findall("joint")]
        _check_names(path, "link", links)
        _check_names(path, "joint", joints)
        within = (child.tag for joint in root.findall("joint") for child in joint)
        unread = sorted({child.tag for child in root} - set(_TOP) | set(within) - set(_OF_JOINTS))
        robot = cls(path, frozenset(links), {}, tuple(root.findall("link")), tuple(unread))
        above: dict[str, ElementTree.Element] = {}
        for joint in root.findall("joint"):
            for end in ("parent", "child"):
                robot.end(joint, end)
            child = robot.end(joint, "child")
            if child in above:
                raise robot.wrong(
                    joint,
                    "child",
                    f"found {cut(child)!r}, which {cut(above[child].get('name', ''))!r} carries already",
                    "a tree",
                )
            above[child] = joint
        return replace(robot, above=above)

    def chain(self, base: str, tip: str, where: str) -> list[ElementTree.Element]:
        """Joints from the link ``base`` to the link ``tip``, in order."""
        for field, link in (("base_link", base), ("tip_link", tip)):
            if link not in self.links:
                raise InputError(
                    f"{where}.{field}: found {cut(link)!r}, no link of {self.path}; {close_matches(link, self.links)}"
                )
        out: list[ElementTree.Element] = []
        link, seen = tip, set[str]()
        while link != base and link in self.above and link not in seen:
            seen.add(link)
            out.append(self.above[link])
            link = self.end(out[-1], "parent")
        if link == base and len(out) > CHAIN_MOST:
            raise InputError(
                f"{where}.tip_link: found {len(out)} joints of {self.path} from {cut(base)!r} to {cut(tip)!r}, "
                f"expected at most {CHAIN_MOST}"
            )
        if link != base or not out:
            raise InputError(
                f"{where}.tip_link: found {cut(tip)!r}, which no joint of {self.path} carries from {cut(base)!r} on, "
                "expected a link further from the base than base_link"
            )
        return out[::-1]

    def carried(
        self, link: str, known: dict[str, _T | None], beyond: Callable[[_T, ElementTree.Element], _T]
    ) -> _T | None:
        """Return what is known of a link by the joints that carry it from a link in ``known``; None where there is none.

        ``known`` grows, so that long branches are walked once.
        """
        way: list[str] = []
        while link not in known:
            known[link] = None  # a ring, or another root, unless the walk comes to a link that is known
            way.append(link)
            if link in self.above:
                link = self.end(self.above[link], "parent")
        found = known[link]
        for one in reversed(way):
            found = None if found is None else beyond(found, self.above[one])
            known[one] = found
        return found

    @cached_property
    def joints(self) -> Mapping[str, ElementTree.Element]:
        """All joints by name."""
        return {self.joint_name(joint): joint for joint in self.above.values()}

    def joint_name(self, joint: ElementTree.Element) -> str:
        """The joint's name."""
        return joint.get("name", "")

    def end(self, joint: ElementTree.Element, which: str) -> str:
        """The link at an end of a joint, ``parent`` or ``child``."""
        element = joint.find(which)
        link = "" if element is None else element.get("link", "")
        if link not in self.links:
            raise self.wrong(
                joint, which, f"found {cut(link)!r}", f"a link; {close_matches(link, self.links)}"
            )
        return link

    def kind(self, joint: ElementTree.Element) -> str:
        """Return how a joint moves, as a graph states it. Raises InputError for a floating or planar joint."""
        kind = joint.get("type", "")
        if kind in KINDS:
            return KINDS[kind]
        expected = ", ".join(KINDS)
        if kind in ("floating", "planar"):
            beyond = f"a chain that starts beyond it, at the link {cut(self.end(joint, 'child'))!r} (base_link, --base-link)"
            expected = f"{expected}, or {beyond}, or type: graph"
        raise self.wrong(joint, "type", f"found {cut(kind)!r}", expected)

    def joint(self, joint: ElementTree.Element, units: UnitSystem) -> dict[str, Any]:
        """Kind, frame, axis and range of a joint as a graph states them, in the file's units."""
        kind = self.kind(joint)
        xyz, rpy = self.numbers(joint, "origin", "xyz"), self.numbers(joint, "origin", "rpy")
        out: dict[str, Any] = {"kind": kind}
        out["xyz"] = [float(units.from_internal(MM_PER_M * v, "length")) for v in xyz]
        out["rpy"] = [float(units.from_internal(v, "angle")) for v in rpy]
        if kind == "fixed":
            return out
        axis = self.numbers(joint, "axis", "xyz", _AXIS)
        if not any(axis):
            raise self.wrong(joint, "axis", "found 0 0 0", "a direction")
        out["axis"] = _direction(axis)
        if joint.find("mimic") is not None:
            return out
        out["actuated"] = True
        limits = self._range(joint)
        if limits is not None:
            slides = kind == "prismatic"
            dimension, factor = ("length", MM_PER_M) if slides else ("angle", 1.0)
            out["range"] = [float(units.from_internal(factor * v, dimension)) for v in limits]
        return out

    def mimic(self, joint: ElementTree.Element) -> tuple[str, float, float] | None:
        """What a joint follows in the end: the name of a joint with a reading, multiplier (1, mm/rad or rad/mm) and offset
        (mm or rad); None for a joint that follows nothing.

        Raises InputError where that joint does not move, or follows this one.
        """
        if joint.find("mimic") is None or KINDS.get(joint.get("type", "")) == "fixed":
            return None
        ratio, offset, names, here = 1.0, 0.0, dict.fromkeys([self.joint_name(joint)]), joint
        while (element := here.find("mimic")) is not None:
            found = element.get("joint", "")
            other = self.joints.get(found)
            if other is None or KINDS.get(other.get("type", ""), "fixed") == "fixed" or found in names:
                way = f", by way of {shortened(list(map(cut, [*names][1:])), 5)}" if len(names) > 1 else ""
                expected = "a joint that moves and has a reading of its own"
                raise self.wrong(joint, "mimic", f"found {cut(found)!r}{way}", expected)
            factor, shift = (
                self.number(here, "mimic", element.get(key, usual))
                for key, usual in (("multiplier", "1"), ("offset", "0"))
            )
            ratio, offset = ratio * factor, offset + ratio * shift
            names[found] = None
            here = other
        own, theirs = (MM_PER_M if j.get("type") == "prismatic" else 1.0 for j in (joint, here))
        return self.joint_name(here), ratio * own / theirs, offset * own

    def _range(self, joint: ElementTree.Element) -> tuple[float, float] | None:
        """Lower and upper limit; None for a joint that turns without end or states none."""
        limit = joint.find("limit")
        if joint.get("type") == "continuous" or limit is None or not {"lower", "upper"} & set(limit.keys()):
            return None
        low, high = (self.number(joint, "limit", limit.get(side, "0")) for side in ("lower", "upper"))
        if low >= high:
            raise self.wrong(joint, "limit", f"found lower {low:g}, upper {high:g}", "lower < upper")
        return low, high

    def numbers(
        self,
        joint: ElementTree.Element,
        tag: str,
        attribute: str,
        default: tuple[float, ...] = (0.0, 0.0, 0.0),
    ) -> tuple[float, ...]:
        """Three numbers of an element of a joint or link."""
        element = joint.find(tag)
        text = None if element is None else element.get(attribute)
        if text is None:
            return default
        words = text.split(maxsplit=len(default))
        values = tuple(self.number(joint, tag, word) for word in words) if len(words) == len(default) else ()
        if not values or (tag != "axis" and max(map(abs, values)) > FARTHEST):
            raise self.wrong(
                joint, f"{tag}.{attribute}", f"found {cut(text)!r}", f"3 numbers of at most {FARTHEST:g}"
            )
        return values

    def number(self, joint: ElementTree.Element, tag: str, text: str) -> float:
        """A finite number of an element of a joint or link."""
        try:
            value = (
                float(text) if text.isascii() and "_" not in text else math.nan
            )  # Python reads 1_000, nobody else does
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.wrong(joint, tag, f"found {cut(text)!r}", "finite numbers")
        return value

    def wrong(self, joint: ElementTree.Element, element: str, found: str, expected: str) -> InputError:
        """The error of one element of a joint or link."""
        where = f"{self.path}: {joint.tag} {cut(self.joint_name(joint))!r}: {element.replace('/', '.')}"
        return InputError(f"{where}: {found}, expected {expected}")


def _check_names(path: Path, what: str, names: list[str]) -> None:
    """Each with a name of its own, of a length that messages and columns have room for."""
    wrong = sorted(name for name, count in Counter(names).items() if not name or count > 1)
    if wrong:
        found = f"{cut(wrong[0])!r} twice" if wrong[0] else "one without a name"
        raise InputError(f"{path}: {what}: found {found}, expected each with a name of its own")
    long = next((name for name in names if len(name) > NAME_MOST), None)
    if long is not None:
        found = f"the name {cut(long)!r} of {len(long)} characters"
        raise InputError(f"{path}: {what}: found {found}, expected at most {NAME_MOST}")


def _direction(axis: tuple[float, ...]) -> list[float]:
    """An axis as it stands; of one whose length's square no number holds, the same direction."""
    largest = max(map(abs, axis))
    return list(axis) if 1e-6 <= largest <= 1e6 else [v / largest for v in axis]


STANDARD_GRAVITY = 9.80665
_NAMED = 3


class _Hung(NamedTuple):
    """The body that a link hangs on, the link's frame (4, 4) in the body's at zero, and whether a joint could move it."""

    body: str
    frame: Array
    moved: bool

    def beyond(self, robot: Robot, joint: ElementTree.Element) -> _Hung:
        """Return the same of the link that a joint carries."""
        moved = self.moved or joint.get("type") != "fixed"
        return _Hung(self.body, self.frame @ _origin(robot, joint), moved)


def inertials_of(robot: Robot, chain: Sequence[str]) -> tuple[tuple[Inertial, ...], tuple[str, ...]]:
    """Mass and centre (mm, body's frame) of each body of ``chain`` but the first, and notes on them.

    Raises InputError for a mass or an origin that is none.
    """
    sums = {link: np.zeros(4) for link in chain[1:]}  # kg, kg x, kg y, kg z
    bent: list[str] = []
    known: dict[str, _Hung | None] = {link: _Hung(link, np.eye(4), moved=False) for link in sums}
    for element in robot.elements:
        kg, com = _weight(robot, element)
        if not kg:
            continue
        found = robot.carried(
            robot.joint_name(element), known, lambda above, joint: above.beyond(robot, joint)
        )
        if found is None:
            continue
        body, frame, moved = found
        sums[body] += kg * np.array([1.0, *(frame[:3, :3] @ com + frame[:3, 3])])
        bent += [robot.joint_name(element)] if moved else []
    out = tuple(
        Inertial(body, float(s[0]), (float(s[1] / s[0]), float(s[2] / s[0]), float(s[3] / s[0])))
        for body, s in sums.items()
        if s[0] > 0.0
    )
    told = f"{robot.path}: counted where they hang with their joints at zero: {shortened(bent, _NAMED)}"
    return out, (told,) if out and bent else ()


def gravity_in(robot: Robot, base: str) -> tuple[float, float, float]:
    """Gravity (m/s^2) in the frame of a link, where the root link's z points up and all joints stand at zero."""
    turned = np.eye(4)
    link, seen = base, set[str]()
    while link in robot.above and link not in seen:
        seen.add(link)
        turned = _origin(robot, robot.above[link]) @ turned
        link = robot.end(robot.above[link], "parent")
    x, y, z = (float(round(v, 12)) + 0.0 for v in turned[:3, :3].T @ [0.0, 0.0, -STANDARD_GRAVITY])
    return x, y, z


def _weight(robot: Robot, link: ElementTree.Element) -> tuple[float, Array]:
    """Mass of a link, kg, and its centre, mm; 0 where it states none."""
    mass = link.find("inertial/mass")
    if mass is None:
        return 0.0, np.zeros(3)
    kg = robot.number(link, "inertial/mass", mass.get("value", "0"))
    if not 0.0 <= kg <= FARTHEST:
        raise robot.wrong(link, "inertial/mass", f"found {kg:g}", f"a number >= 0, at most {FARTHEST:g} (kg)")
    return kg, MM_PER_M * np.array(robot.numbers(link, "inertial/origin", "xyz"))


def _origin(robot: Robot, joint: ElementTree.Element) -> Array:
    """(4, 4) child frame in the parent's at zero, mm."""
    xyz, rpy = (np.array(robot.numbers(joint, "origin", part)) for part in ("xyz", "rpy"))
    return pose_of(rpy_matrix(rpy), MM_PER_M * xyz)
