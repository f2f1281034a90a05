"""Where a fit starts: frames that may be anywhere are put where the readings say."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.short_arm import HEAD, JOINTS
from truepose.identification.fit.align import aligned_start
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prediction.simulate import simulate, with_inputs
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

FRAMES = """frames:
  base: {{in: world, xyz: [{base}], rpy: [{turn}], tolerance: {{xyz: {loose}, rpy: 200}}}}
  tool: {{in: flange, xyz: [20, 30, 80], rpy: [{tool}], tolerance: {{xyz: 1, rpy: {bent}}}}}
sensor: {{type: pose, sigma: {{xyz: 0.01, rot: 0.005}}}}
tolerances: {{length: 0.1, angle: 0.1}}
"""
HERE = {"base": "0, 0, 0", "turn": "0, 0, 0", "tool": "0, 0, 0"}
THERE = {"base": "900, -2000, 350", "turn": "20, -35, 160", "tool": "10, 25, -120"}


def machine(folder: Path, name: str, **texts: str) -> Path:
    path = folder / f"{name}.yaml"
    path.write_text(HEAD + JOINTS + FRAMES.format(**texts), encoding="utf-8")
    return path


@pytest.mark.parametrize(("loose", "bent"), [("2000", "120"), ("2000", "1")])
def test_frames_start_where_the_readings_put_them(tmp_path: Path, loose: str, bent: str) -> None:
    """Base and tool wherever they stand; a tool that is known stays as drawn. Without noise the start is exact."""
    stands = THERE if bent == "120" else THERE | {"tool": HERE["tool"]}
    true = load_machine(machine(tmp_path, "true", **stands, loose="1", bent="1"))
    drawn = load_machine(machine(tmp_path, "drawn", **HERE, loose=loose, bent=bent))
    rng = np.random.default_rng(1)
    columns = [f"{a.reading} [{a.reading_unit}]" for a in true.mechanism.actuators]
    ranges = np.array([a.range for a in true.mechanism.actuators], dtype=float)
    low, high = ranges.T
    poses = rng.uniform(low, high, (20, len(ranges)))
    text = "\n".join(",".join(f"{v:.9f}" for v in row) for row in poses)
    (tmp_path / "poses.csv").write_text(",".join(columns) + "\n" + text + "\n")
    rows = load_recording(true, [tmp_path / "poses.csv"], need_observations=False)
    read = with_inputs(tmp_path / "poses.csv", simulate(true, rows, seed=None))
    read.to_csv(tmp_path / "read.csv", index=False)
    start = aligned_start(Predictor(drawn, load_recording(drawn, [tmp_path / "read.csv"])))
    names = [p.name for p in drawn.parameters]
    expected = {p.name: p.nominal for p in true.parameters}
    for name, value in zip(names, start, strict=True):
        assert value == pytest.approx(expected[name], abs=1e-6), name
