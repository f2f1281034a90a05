"""Numbers of exported frames, and what is said of frames that a format does not hold."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.exported import frame, machine_named
from truepose.arrays import Array
from truepose.models.leaves.export.links import text, xyz_rpy
from truepose.models.leaves.export.write import render

NUMBERS = ", ".join(f"{field} (\\S+)" for field in ("x", "y", "z", "roll", "pitch", "yaw"))


def told(text: str, what: str) -> Array | None:
    """(4, 4) mm of a frame in the comments, None where they do not name it."""
    found = re.search(f"^# Not held: {what}: {NUMBERS}$", text, re.M)
    if found is None:
        return None
    values = np.array([float(v) for v in found.groups()])
    return frame(values[:3], values[3:])


def test_flange_tool_and_world_stand_in_the_comments_if_the_file_does_not_hold_them(tmp_path: Path) -> None:
    """Where the last joint's frame cannot be the flange's, the comments lead to both: from one to the other is the tool."""
    text = render(machine_named(tmp_path, "tilted"), "ur-kinematics").text
    flange, tool, base = (
        told(text, what) for what in ("wrist_3 to flange", "wrist_3 to tool", "world to base")
    )
    assert flange is not None and tool is not None and base is not None
    np.testing.assert_allclose(tool, flange @ frame([0.003, 0.004, 0.05], [0, 0, 0]), atol=1e-9)
    np.testing.assert_allclose(base, frame([0.04, -0.003, 0.7], np.radians([1, 2, 30])), atol=1e-9)
    assert told(render(machine_named(tmp_path, "arm"), "ur-kinematics").text, "wrist_3 to flange") is None


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
