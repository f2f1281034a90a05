"""Read an exported xacro: its macro without a prefix, properties put in, as the URDF that xacro would make of it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from xml.etree import ElementTree

from truepose.errors import InputError
from truepose.models.builders.urdf_file import parse_own_xml

_XACRO = "{http://www.ros.org/wiki/xacro}"
_WORK = re.compile(r"\$\$|\$\{(\w+)\}")
"""What xacro works out in an attribute: a dollar sign that is written twice, or a property by its name."""


def expand_xacro(text: str) -> str:
    """Return the URDF of the macro that the file calls by itself. Raises InputError where it calls none of its own."""
    root = parse_own_xml(text)
    macros = {macro.get("name", ""): macro for macro in root.findall(f"{_XACRO}macro")}
    called = [call.tag.removeprefix(_XACRO) for call in root.findall(f"{_XACRO}if/*")]
    if len(called) != 1 or called[0] not in macros:
        raise InputError(f"found calls of {', '.join(called)}, expected one of {', '.join(macros)}")
    robot = ElementTree.Element("robot", name=_evaluate(root.get("name", ""), {}))
    known = {"prefix": ""}
    for element in macros[called[0]]:
        if element.tag == f"{_XACRO}property":
            known[element.get("name", "")] = _evaluate(element.get("value", ""), known)
            continue
        for part in element.iter():
            part.attrib.update({name: _evaluate(value, known) for name, value in part.attrib.items()})
        robot.append(element)
    return ElementTree.tostring(robot, encoding="unicode")


def _evaluate(text: str, known: Mapping[str, str]) -> str:
    """Return an attribute as xacro leaves it. Raises KeyError for a property that is not ``known``."""
    return _WORK.sub(lambda found: "$" if found[1] is None else known[found[1]], text)
