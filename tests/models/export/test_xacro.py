"""A machine as xacro, expanded by xacro itself: it is the URDF, with any prefix, and other files can call its macro."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from support.generated_machines import HEAD, machine_of
from truepose.models.leaves.export.write import export, render
from truepose.models.load import load_machine

xacro: Any = pytest.importorskip("xacro")
ODD = """  type: graph
  bodies: [base, "a$(b)", "1 c"]
  joints:
    - {name: "j${x}", kind: revolute, parent: base, child: "a$(b)", xyz: [0.1, 2, 3], actuated: true, range: [-10, 20]}
    - {name: "j__x_", kind: prismatic, parent: "a$(b)", child: "1 c", xyz: [4, 5, 6], axis: [0.6, 0, 0.8], actuated: true}
"""


def elements(text: str) -> list[tuple[str, dict[str, str]]]:
    return [(e.tag, dict(e.attrib)) for e in ElementTree.fromstring(text).iter() if e.tag != "robot"]


def expanded(path: Path, **arguments: str) -> str:
    return str(xacro.process_file(str(path), mappings=arguments).toxml())


@pytest.mark.parametrize("name", ["arm", "nano", "scara", "odd"])
def test_expanded_it_is_the_urdf(tmp_path: Path, name: str) -> None:
    if name == "odd":
        (tmp_path / "odd.yaml").write_text(HEAD.format(name="odd") + ODD)
        machine = load_machine(tmp_path / "odd.yaml")
    else:
        machine = machine_of(tmp_path, name)
    export(machine, tmp_path / "out.urdf.xacro")
    urdf = render(machine, "urdf").text
    assert elements(expanded(tmp_path / "out.urdf.xacro")) == elements(urdf)
    prefixed = elements(expanded(tmp_path / "out.urdf.xacro", prefix="left_"))
    names = ("name", "link", "joint")
    for (tag, found), (_, stated) in zip(prefixed, elements(urdf), strict=True):
        assert found == {k: f"left_{v}" if k in names and tag != "robot" else v for k, v in stated.items()}


def test_a_cell_of_two_calls_the_macro(tmp_path: Path) -> None:
    export(machine_of(tmp_path, "arm"), tmp_path / "arm.urdf.xacro")
    (tmp_path / "cell.xacro").write_text(
        """<robot name="cell" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="standalone" default="false"/>
  <xacro:include filename="arm.urdf.xacro"/>
  <xacro:arm prefix="left_"/>
  <xacro:arm prefix="right_"/>
</robot>
"""
    )
    links = ElementTree.fromstring(expanded(tmp_path / "cell.xacro")).findall("link")
    names = [link.get("name") for link in links]
    assert len(names) == len(set(names)) and {"left_tool", "right_tool"} <= set(names) and "tool" not in names
