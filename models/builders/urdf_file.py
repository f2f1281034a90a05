"""A URDF's links and joints, checked: what the chain, its inertias and ``truepose init`` read of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from truepose.errors import InputError
from truepose.models.units import UnitSystem
from truepose.wording import close_matches

KINDS = {"revolute": "revolute", "continuous": "revolute", "prismatic": "prismatic", "fixed": "fixed"}
MM_PER_M = 1000.0
_AXIS = (1.0, 0.0, 0.0)
"""Axis of a joint that states none."""


class _NoEntities(ElementTree.TreeBuilder):
    """Refuses a document type: its entities can stand for gigabytes, or for other files."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self._path = path

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise InputError(
            f"{self._path}: found <!DOCTYPE {name}>, expected a URDF without a document type and entities"
        )


def _tree(path: Path) -> ElementTree.Element:
    """The root of an XML file. Raises OSError, and ParseError, ValueError or LookupError for what is none."""
    if path.exists() and not path.is_file():  # a device or a pipe may never end
        raise OSError(None, "not a file")
    return ElementTree.fromstring(path.read_bytes(), ElementTree.XMLParser(target=_NoEntities(path)))


@dataclass(frozen=True)
class Robot:
    """A URDF's links and joints; every message names the file and the element."""

    path: Path
    links: frozenset[str]
    above: Mapping[str, ElementTree.Element]
    """The joint that carries each link."""
    elements: tuple[ElementTree.Element, ...] = ()
    """The links' elements."""

    @classmethod
    def read(cls, path: Path) -> Robot:
        """Read and check what all joints share. Raises InputError for a missing file and broken XML."""
        try:
            root = _tree(path)
        except OSError as exc:
            raise InputError(f"{path}: cannot read the URDF: {exc.strerror or exc}") from None
        except (ElementTree.ParseError, ValueError, LookupError) as exc:
            raise InputError(f"{path}: cannot read the URDF: broken XML: {exc}") from None
        if root.tag != "robot":
            raise InputError(f"{path}: found <{root.tag}>, expected <robot>")
        links = [link.get("name", "") for link in root.findall("link")]
        joints = [joint.get("name", "") for joint in root.findall("joint")]
        for what, names in (("link", links), ("joint", joints)):
            wrong = sorted({name for name in names if not name or names.count(name) > 1})
            if wrong:
                found = f"{wrong[0]!r} twice" if wrong[0] else "one without a name"
                raise InputError(f"{path}: {what}: found {found}, expected each with a name of its own")
        robot = cls(path, frozenset(links), {}, tuple(root.findall("link")))
        above: dict[str, ElementTree.Element] = {}
        for joint in root.findall("joint"):
            for end in ("parent", "child"):
                robot.end(joint, end)
            child = robot.end(joint, "child")
            if child in above:
                raise robot.wrong(
                    joint,
                    "child",
                    f"found {child!r}, which {above[child].get('name')!r} carries already",
                    "a tree",
                )
            above[child] = joint
        return replace(robot, above=above)

    def chain(self, base: str, tip: str, where: str) -> list[ElementTree.Element]:
        """Joints from the link ``base`` to the link ``tip``, in order."""
        for field, link in (("base_link", base), ("tip_link", tip)):
            if link not in self.links:
                raise InputError(
                    f"{where}.{field}: found {link!r}, no link of {self.path}; {close_matches(link, self.links)}"
                )
        out: list[ElementTree.Element] = []
        link = tip
        while link != base and link in self.above and self.above[link] not in out:
            out.append(self.above[link])
            link = self.end(out[-1], "parent")
        if link != base or not out:
            raise InputError(
                f"{where}.tip_link: found {tip!r}, which no joint of {self.path} carries from {base!r} on, "
                "expected a link further from the base than base_link"
            )
        return out[::-1]

    def joint_name(self, joint: ElementTree.Element) -> str:
        """The joint's name."""
        return joint.get("name", "")

    def end(self, joint: ElementTree.Element, which: str) -> str:
        """The link at an end of a joint, ``parent`` or ``child``."""
        element = joint.find(which)
        link = "" if element is None else element.get("link", "")
        if link not in self.links:
            raise self.wrong(joint, which, f"found {link!r}", f"a link; {close_matches(link, self.links)}")
        return link

    def joint(self, joint: ElementTree.Element, units: UnitSystem) -> dict[str, Any]:
        """Kind, frame, axis and range of a joint as a graph states them, in the file's units."""
        kind = joint.get("type", "")
        if kind not in KINDS:
            expected = f"{', '.join(KINDS)} (describe the machine as type: graph)"
            raise self.wrong(joint, "type", f"found {kind!r}", expected)
        xyz, rpy = self.numbers(joint, "origin", "xyz"), self.numbers(joint, "origin", "rpy")
        out: dict[str, Any] = {"kind": KINDS[kind]}
        out["xyz"] = [float(units.from_internal(MM_PER_M * v, "length")) for v in xyz]
        out["rpy"] = [float(units.from_internal(v, "angle")) for v in rpy]
        if kind == "fixed":
            return out
        axis = self.numbers(joint, "axis", "xyz", _AXIS)
        if not any(axis):
            raise self.wrong(joint, "axis", "found 0 0 0", "a direction")
        out["axis"] = list(axis)
        if joint.find("mimic") is not None:
            return out
        out["actuated"] = True
        limits = self._range(joint, kind)
        if limits is not None:
            slides = kind == "prismatic"
            dimension, factor = ("length", MM_PER_M) if slides else ("angle", 1.0)
            out["range"] = [float(units.from_internal(factor * v, dimension)) for v in limits]
        return out

    def mimic(self, joint: ElementTree.Element) -> tuple[str, float, float] | None:
        """What a joint follows: the other's name, multiplier (1, mm/rad or rad/mm) and offset (mm or rad); None if nothing.

        Raises InputError where that joint has no reading of its own, or the same one twice.
        """
        element = joint.find("mimic")
        if element is None or joint.get("type") == "fixed":
            return None
        found = element.get("joint", "")
        other = next((j for j in self.above.values() if self.joint_name(j) == found), None)
        if (
            other is None
            or other.find("mimic") is not None
            or KINDS.get(other.get("type", ""), "fixed") == "fixed"
        ):
            raise self.wrong(
                joint, "mimic", f"found {found!r}", "a joint that moves and has a reading of its own"
            )
        factor, offset = (
            self.number(joint, "mimic", element.get(key, usual))
            for key, usual in (("multiplier", "1"), ("offset", "0"))
        )
        own, theirs = (MM_PER_M if j.get("type") == "prismatic" else 1.0 for j in (joint, other))
        return found, factor * own / theirs, offset * own

    def _range(self, joint: ElementTree.Element, kind: str) -> tuple[float, float] | None:
        """Lower and upper limit; None for a joint that turns without end or states none."""
        limit = joint.find("limit")
        if kind == "continuous" or limit is None or not {"lower", "upper"} & set(limit.keys()):
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
        values = tuple(self.number(joint, tag, word) for word in text.split())
        if len(values) != len(default):
            raise self.wrong(joint, f"{tag}.{attribute}", f"found {text!r}", "3 numbers")
        return values

    def number(self, joint: ElementTree.Element, tag: str, text: str) -> float:
        """A finite number of an element of a joint or link."""
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.wrong(joint, tag, f"found {text!r}", "finite numbers")
        return value

    def wrong(self, joint: ElementTree.Element, element: str, found: str, expected: str) -> InputError:
        """The error of one element of a joint or link."""
        return InputError(
            f"{self.path}: {joint.tag} {self.joint_name(joint)!r}: {element}: {found}, expected {expected}"
        )


__all__ = ["KINDS", "MM_PER_M", "Robot"]
