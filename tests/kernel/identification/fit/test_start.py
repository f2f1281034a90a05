"""Where a fit starts: frames that may be anywhere are put where the readings say."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.short_arm import HEAD, JOINTS
from support.simulated import machine_from, readings_of
from truepose.identification.fit.align import aligned_start
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.machine.machine import Machine

FRAMES = """frames:
  base: {{in: world, xyz: [{base}], rpy: [{turn}], tolerance: {{xyz: {loose}, rpy: {tilt}}}}}
  tool: {{in: flange, xyz: [20, 30, 80], rpy: [{tool}], tolerance: {{xyz: 1, rpy: {bent}}}}}
tolerances: {{length: 0.1, angle: 0.1}}
"""
POSE = "{type: pose, sigma: {xyz: 0.01, rot: 0.005}}"
TARGETS = "{type: targets, points: {A: [150, 0, 40], B: [-80, 120, 0], C: [0, -90, 60]}, sigma: {xyz: 0.01}}"
HERE = {"base": "0, 0, 0", "turn": "0, 0, 0", "tool": "0, 0, 0"}
THERE = {"base": "900, -2000, 350", "turn": "20, -35, 160", "tool": "10, 25, -120"}


def machine(folder: Path, name: str, sensors: str, **texts: str) -> Machine:
    known = {"loose": "1", "tilt": "1", "bent": "1"} | texts
    return machine_from(folder, HEAD + JOINTS + FRAMES.format(**known) + f"sensor: {sensors}\n", name)


def started(true: Machine, drawn: Machine) -> Mapping[str, float]:
    """Parameters from which a fit of ``drawn`` starts, the readings being those of ``true`` without noise."""
    rng = np.random.default_rng(1)
    columns = [f"{a.reading} [{a.reading_unit}]" for a in true.mechanism.actuators]
    ranges = np.array([a.range for a in true.mechanism.actuators], dtype=float)
    low, high = ranges.T
    poses = rng.uniform(low, high, (20, len(ranges)))
    table = pd.DataFrame(poses, columns=columns)
    start = aligned_start(Predictor(drawn, load_recording(drawn, readings_of(true, table, seed=None))))
    return dict(zip((p.name for p in drawn.parameters), start, strict=False))


def apart(start: Mapping[str, float], true: Machine) -> float:
    """Largest difference from the true parameters, mm and rad."""
    return max(abs(start[p.name] - p.nominal) for p in true.parameters)


@pytest.mark.parametrize("bent", ["120", "1"])
def test_frames_start_where_the_readings_put_them(tmp_path: Path, bent: str) -> None:
    """Base and tool wherever they stand; a tool that is known stays as drawn. Without noise the start is exact."""
    stands = THERE if bent == "120" else THERE | {"tool": HERE["tool"]}
    true = machine(tmp_path, "true", POSE, **stands)
    drawn = machine(tmp_path, "drawn", POSE, **HERE, loose="2000", tilt="200", bent=bent)
    assert apart(started(true, drawn), true) < 1e-6


def test_points_that_turn_with_the_tool_put_the_base_right_once_the_tool_is(tmp_path: Path) -> None:
    """The base is fitted to points of a tool that is turned yet, so that both are put right in turns."""
    both = f"[{POSE}, {TARGETS}]"
    true = machine(tmp_path, "true", both, **THERE | {"tool": "4, -5, 30"})
    drawn = machine(tmp_path, "drawn", both, **HERE, loose="2000", tilt="200", bent="120")
    # three turns of putting each right leave no more; the first leaves millimetres
    assert apart(started(true, drawn), true) < 1e-3


@pytest.mark.parametrize(("tilt", "put"), [("12", True), ("11", False)])
def test_a_frame_is_put_right_that_may_be_a_radian_off(tmp_path: Path, tilt: str, put: bool) -> None:
    """At five sigma: from nearer than that a fit finds its way itself."""
    stands = {"base": "30, -20, 10", "turn": "5, -8, 20", "tool": HERE["tool"]}
    true, drawn = (
        machine(tmp_path, "true", POSE, **stands),
        machine(tmp_path, "drawn", POSE, **HERE, tilt=tilt),
    )
    start = started(true, drawn)
    assert apart(start, true if put else drawn) < 1e-6
