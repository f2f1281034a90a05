"""The arm and the files of the first ten minutes: the same arm by other means, and lines that are left out."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

from first_ten_minutes.arm import COMPLIANCE, LOAD, PLAY, RANGES, SHEET, path, seen, sides, specimen
from first_ten_minutes.given import ROWS, spatial_analyzer, write
from first_ten_minutes.study import LADEN, left_out
from mistakes.rotations import frame
from mistakes.sources.campaign import Campaign
from mistakes.sources.chain import Arm, Body, Physics, tool_poses
from mistakes.sources.tables import Sheet

FILE = """schema: truepose/machine/1
# gravity: [0, 0, 1] in a comment stays
gravity: [0, 0, -9.80665]
frames:
  base: {in: world}
  tool: {in: flange}
tolerances:
  length: 0.3
  angle: 0.1
sensor: {type: position}
"""


def test_the_arm_is_that_of_the_modified_rows_with_its_play_and_compliance() -> None:
    """By the other chain of these benchmarks, in the other convention, its loads by another sum."""
    arm = specimen(np.random.default_rng(1))
    q = path(np.random.default_rng(2), 30)
    sheet = Sheet(arm.rows, (False,) * 6, RANGES, 1.0)
    modified = sheet.modified
    a, alpha = sheet.rest
    tool = frame(np.array([a, 0.0, 0.0]), np.array([alpha, 0.0, 0.0]))
    at = tool.copy()
    at[:3, 3] += tool[:3, :3] @ arm.tool
    other = Arm(modified, np.zeros(6, dtype=bool), arm.base, at, (Body(7, LOAD, np.zeros(3)),))
    second, third = np.eye(6)[1], np.eye(6)[2]
    physics = Physics(COMPLIANCE * second, PLAY * third, np.zeros(6), np.ones(6))
    campaign = Campaign(q, np.arange(30.0), sides(q), np.zeros(30), np.zeros(30))
    expected = tool_poses(other, campaign, physics)[:, :3, 3]
    found = seen(arm, q, np.random.default_rng(3), noise=False)
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_the_files_hold_what_was_measured(tmp_path: Path) -> None:
    given = write(tmp_path, 4)
    points = given.points.read_text().splitlines()
    assert len([line for line in points if not line.startswith("//")]) == ROWS
    assert points[-1].split("\t")[0] == "A::KR14 CELL::P090"
    log, sheet = pd.read_csv(given.log), pd.read_csv(given.sheet)
    assert list(log["point"]) == [f"P{k + 1:03d}" for k in range(ROWS)]
    np.testing.assert_array_equal(sheet[["a", "alpha", "d", "theta"]], SHEET)
    low, high = RANGES.T
    assert ((log.iloc[:, 1:7] >= low) & (log.iloc[:, 1:7] <= high)).all(axis=None)


def test_points_are_written_to_a_tenth_of_a_micrometre() -> None:
    assert (
        spatial_analyzer(np.array([[1.0, -2.5, 0.00004]]))
        .splitlines()[-1]
        .endswith("\t1.0000\t-2.5000\t0.0000")
    )


@pytest.mark.parametrize(
    ("omitted", "gone"),
    [("gravity", ["gravity: ["]), ("tolerances", ["tolerances:", "length:", "angle:"]), ("base", ["base:"])],
)
def test_one_section_is_left_out_and_nothing_else(omitted: str, gone: list[str]) -> None:
    text = left_out(FILE + LADEN, omitted)
    kept = [line for line in (FILE + LADEN).splitlines() if line not in text.splitlines()]
    assert len(kept) == len(gone)
    assert all(line.strip().startswith(word) for line, word in zip(kept, gone, strict=True))


def test_a_section_that_is_not_there_cannot_be_left_out() -> None:
    with pytest.raises(ValueError, match="found 0 times"):
        left_out("name: arm\n", "gravity")
