"""``NAME_point``: the readings of two axes that point the tool somewhere."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.generated_c import built_of, needs_compiler
from support.simulated import machine_from
from truepose.codegen.c import generate, render
from truepose.models.load import load_machine

FILE = """schema: truepose/machine/1
name: mount
mechanism:
  type: mount
  kind: {kind}
  latitude: 39
  first: {{offset: 3, range: [-20, 200]}}
  second: {{offset: -1, tilt: 0.3, range: [-80, 260]}}
frames:
  base: {{in: world, rpy: [0.4, -0.2, 0]}}
  tool: {{in: flange, rpy: [0, 0, 0.5]}}
sensor: {{type: direction, sigma: {{angle: 1 arcsec}}}}
effects:
  - {{effect: gravity-sag, place: [tool], parameters: {{c: {{value: 1.0e-5, unit: rad/(N*m)}}}}}}
"""


@pytest.mark.parametrize("kind", ["equatorial", "alt-az"])
@needs_compiler
def test_directions_are_met_near_the_guess(tmp_path: Path, kind: str) -> None:
    built = built_of(machine_from(tmp_path, FILE.format(kind=kind), "mount"), tmp_path / "c", "double")
    for k in range(500):
        q = np.array([-0.3 + 3.7 * (0.618034 * k % 1.0), -1.3 + 5.7 * (0.414214 * k % 1.0)])
        wanted = built.fk(q)[1][[0, 4, 8]]
        code, found = built.call(
            "point", wanted, q + ([0.02, -0.03] if k % 2 else [-0.7, 0.4]), out=np.zeros(2)
        )
        assert code == 0
        assert np.linalg.norm(built.fk(found)[1][[0, 4, 8]] - wanted) < 1e-9  # what the header promises
        if k % 2 and abs(np.sin(q[1])) < 0.95:
            np.testing.assert_allclose(found, q, rtol=0, atol=1e-6)
    for nowhere in (np.array([np.nan, 0.0, 0.0]), np.zeros(3)):
        code, left = built.call("point", nowhere, np.full(2, 0.25), out=np.full(2, -7.0))
        assert code == 4 and (left == -7.0).all()


def test_machines_that_point_nothing_have_no_such_function(tmp_path: Path) -> None:
    text = FILE.format(kind="alt-az").replace("{type: direction, sigma: {angle: 1 arcsec}}", "POSE")
    text = text.replace("POSE", "{type: pose, sigma: {xyz: 0.1, rot: 0.1}}")
    generate(machine_from(tmp_path, text, "mount"), tmp_path / "c")
    assert "mount_point" not in (tmp_path / "c/mount_kin.h").read_text()


JOINTS = "[{name: q1, kind: revolute, r: 300}, {name: q2, kind: SECOND, alpha: 90, range: [-90, 90]}THIRD]"


@pytest.mark.parametrize(
    ("second", "third", "of", "points"),
    [
        ("revolute", "", "x", True),
        ("prismatic", "", "x", False),
        ("revolute", ", {name: q3, kind: revolute, alpha: 90, d: 100}", "x", False),
        ("revolute", "", "origin", False),
    ],
)
def test_two_turning_joints_point_an_axis_and_nothing_else_does(
    tmp_path: Path, second: str, third: str, of: str, points: bool
) -> None:
    joints = JOINTS.replace("SECOND", second).replace("THIRD", third)
    text = f"schema: truepose/machine/1\nname: mount\nmechanism: {{type: serial, joints: {joints}}}\n"
    text += f"sensor: {{type: direction, of: {of}, sigma: {{angle: 1 arcsec}}}}\n"
    (tmp_path / "mount.yaml").write_text(text)
    assert ("mount_point" in render(load_machine(tmp_path / "mount.yaml"), "double")["mount_kin.h"]) is points
