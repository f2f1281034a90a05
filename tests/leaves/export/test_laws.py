"""Numbers of exported frames, and what is said of frames that a format does not hold."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.exported import frame
from support.moving_machines import written
from truepose.models.leaves.export.links import text, xyz_rpy
from truepose.models.leaves.export.write import render

Array = NDArray[np.float64]
STATED = """frames:
  base: {in: world, xyz: [40, -3, 700], rpy: [1, 2, 30]}
  tool: {in: flange, xyz: [3, 4, 50], rpy: [5, 6, 7]}
"""
NUMBERS = ", ".join(f"{field} (\\S+)" for field in ("x", "y", "z", "roll", "pitch", "yaw"))
PLATES = {"along the last axis": "[0, 0, 30], rpy: [0, 0, 20]", "askew": "[0, 82, 1], rpy: [-90, 0, 0.1]"}


def told(text: str, what: str) -> Array | None:
    """(4, 4) mm of a frame in the comments, None where they do not name it."""
    found = re.search(f"^# Not held: {what}: {NUMBERS}$", text, re.M)
    if found is None:
        return None
    values = np.array([float(v) for v in found.groups()])
    return frame(values[:3], values[3:])


@pytest.mark.parametrize("plate", PLATES)
def test_flange_tool_and_world_stand_in_the_comments_where_the_machine_file_has_them(
    tmp_path: Path, plate: str
) -> None:
    """Where the last joint's frame cannot be the flange's, the comments lead to both: from one to the other is the tool."""
    parents = ("base", "a", "b", "c", "d", "e", "f")
    axes = ("[0, 0, 1]", "[0, 1, 0]", "[0, 1, 0]", "[0, 1, 0]", "[0, 0, 1]", "[0, 1, 0]")
    joints = "".join(
        f"    - {{name: j{k}, kind: revolute, parent: {parents[k - 1]}, child: {parents[k]}, xyz: [{k}, 20, 100], "
        f"axis: {'[0, 0, 1]' if k == 6 else axis}, actuated: true}}\n"
        for k, axis in enumerate(axes, 1)
    )
    joints += f"    - {{name: plate, kind: fixed, parent: f, child: plate, xyz: {PLATES[plate]}}}\n"
    body = f"mechanism:\n  type: graph\n  bodies: [{', '.join(parents)}, plate]\n  flange: plate\n  joints:\n"
    machine = written(
        tmp_path, body + joints + STATED + "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}\n"
    )
    text = render(machine, "ur-kinematics").text
    flange, tool, base = (
        told(text, what) for what in ("wrist_3 to flange", "wrist_3 to tool", "world to base")
    )
    assert (flange is None) == (plate != "askew")
    assert tool is not None and base is not None
    stated = frame([0.003, 0.004, 0.05], np.radians([5, 6, 7]))
    np.testing.assert_allclose(tool, (np.eye(4) if flange is None else flange) @ stated, atol=1e-9)
    np.testing.assert_allclose(base, frame([0.04, -0.003, 0.7], np.radians([1, 2, 30])), atol=1e-9)


@pytest.mark.parametrize("pitch", [90.0, -90.0, 89.99999999, 0.0, 180.0])
def test_roll_pitch_and_yaw_lose_no_digit(pitch: float) -> None:
    rng = np.random.default_rng(2)
    for roll, yaw in rng.uniform(-np.pi, np.pi, (20, 2)):
        rotation = Rotation.from_euler("xyz", [roll, np.radians(pitch), yaw]).as_matrix()
        given = np.eye(4)
        given[:3, :3] = rotation
        np.testing.assert_allclose(frame(*xyz_rpy(given))[:3, :3], rotation, rtol=0, atol=2e-15)


def test_numbers_read_back_the_same() -> None:
    values = np.random.default_rng(3).standard_normal(100) * 10.0 ** np.arange(-50, 50)
    assert [float(word) for word in text(*values.tolist()).split()] == values.tolist()
    assert text(0.0, 1.0, -2.5) == "0 1 -2.5"
