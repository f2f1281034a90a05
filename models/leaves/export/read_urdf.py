"""Read an exported URDF by ``type: urdf``, with all its links, and where its base stands."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.models.builders.urdf import Urdf, expanded
from truepose.models.builders.urdf_file import Robot, inertials_of, parse_own_xml, parse_urdf
from truepose.models.file.machine_file import SCHEMA, checked_machine
from truepose.models.leaves.export.numbers import MM_PER_M
from truepose.models.lie import pose_of, rpy_matrix
from truepose.models.load import build_machine
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import BASE
from truepose.models.units import UnitSystem


def read_urdf(text: str, tips: Sequence[str]) -> Machine:
    """Return the machine that leads from the base to the links ``tips``, of which the first is the tool.

    Raises InputError naming the element that cannot be read.
    """
    file = Path("export.urdf")  # nothing is written: a process that is killed leaves no file behind
    try:
        robot = Robot.of(parse_urdf(text.encode(), file), file)
        section = Urdf(type="urdf", file=file.name, base_link=BASE, tip_link=tuple(tips))
        graph = expanded(section, robot, UnitSystem(), "mechanism")
        inertials_of(robot, graph["bodies"])
        return build_machine(checked_machine(file, {"schema": SCHEMA, "name": "export", "mechanism": graph}))
    except InputError as exc:
        raise InputError(str(exc).replace(f"{file}: ", "")) from exc


def read_base(text: str) -> Array:
    """Return the base (4, 4) mm in the link that carries it; the identity where it is the first link."""
    out = np.eye(4)
    for joint in parse_own_xml(text).findall("joint"):
        child, origin = joint.find("child"), joint.find("origin")
        if child is not None and origin is not None and child.get("link") == BASE:
            xyz, rpy = ([float(v) for v in origin.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
            out = pose_of(rpy_matrix(rpy), np.multiply(xyz, MM_PER_M))
    return out
