"""A machine as xacro: the URDF in a macro as ROS packages have it, with the calibrated constants as properties at its head.

Source: the documentation of xacro (properties, macros, arguments, ``$(arg ...)``, ``$$`` for a dollar sign).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

from truepose.models.leaves.export.links import Names
from truepose.models.leaves.export.tree import Tree
from truepose.models.leaves.export.urdf import urdf_elements
from truepose.models.machine.machine import Machine

_XACRO = "http://www.ros.org/wiki/xacro"
_TOLD = (
    "xacro FILE prefix:=left_ puts a prefix before the names of links and joints.",
    "A file that includes this one says <xacro:arg name='standalone' default='false'/> before, and calls the macro itself.",
)


def xacro_text(machine: Machine, tree: Tree, notes: Sequence[str]) -> str:
    """The file: a macro named after the machine, with the parameter ``prefix``; it calls it unless ``standalone`` is false."""
    urdf = urdf_elements(machine, tree, (*_TOLD, *notes))
    ElementTree.register_namespace("xacro", _XACRO)
    robot = ElementTree.Element("robot", name=_plain(machine.name))
    name = _word(machine.name)
    macro = ElementTree.Element(_tag("macro"), name=name, params="prefix:=''")
    taken = Names(set())
    joints = [element for element in urdf if element.tag == "joint"]
    for joint in joints:
        macro.extend(_constants(joint, taken))
    for element in urdf:
        if not isinstance(element.tag, str):  # a comment
            robot.append(element)
        else:
            macro.append(_prefixed(element))
    for argument, default in (("prefix", ""), ("standalone", "true")):
        ElementTree.SubElement(robot, _tag("arg"), name=argument, default=default)
    robot.append(macro)
    alone = ElementTree.SubElement(robot, _tag("if"), value="$(arg standalone)")
    ElementTree.SubElement(alone, _tag(name), prefix="$(arg prefix)")
    ElementTree.indent(robot)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(robot, encoding="unicode") + "\n"


def _constants(joint: ElementTree.Element, taken: Names) -> list[ElementTree.Element]:
    """Properties for the numbers of a joint, which then stand in its attributes."""
    stem = taken.free(_word(joint.get("name", "")))
    out = []
    for tag, attributes in (("origin", ("xyz", "rpy")), ("axis", ("xyz",)), ("limit", ("lower", "upper"))):
        element = joint.find(tag)
        if element is None:
            continue
        for attribute in attributes:
            name = f"{stem}_{'axis' if tag == 'axis' else attribute}"
            out.append(ElementTree.Element(_tag("property"), name=name, value=element.get(attribute, "")))
            element.set(attribute, f"${{{name}}}")
    return out


def _prefixed(element: ElementTree.Element) -> ElementTree.Element:
    """A link or joint with the prefix before its name, and before those that it speaks of."""
    element.set("name", "${prefix}" + _plain(element.get("name", "")))
    for tag, attribute in (("parent", "link"), ("child", "link"), ("mimic", "joint")):
        other = element.find(tag)
        if other is not None:
            other.set(attribute, "${prefix}" + _plain(other.get(attribute, "")))
    return element


def _tag(name: str) -> str:
    return f"{{{_XACRO}}}{name}"


def _plain(name: str) -> str:
    """A name in which xacro finds nothing to work out."""
    return name.replace("$", "$$")


def _word(name: str) -> str:
    """A name as a word of Python, which xacro's expressions are."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return word if word[:1].isalpha() else f"m_{word}"
