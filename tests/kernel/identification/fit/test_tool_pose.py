"""Laws of how far the tool is from where a model has it. mm, rad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.partial_machines import partial_machine, readings
from support.recordings import rows_of
from truepose.identification.compensation.inverse import PoseSolver, base_frame
from truepose.identification.fit.tool_pose import tool_points
from truepose.identification.prediction.predictor import Predictor
from truepose.models.load import load_machine

BASE = "base: {in: world, xyz: [500, -40, 90], rpy: [20, -35, 70]}"


@pytest.mark.parametrize(
    ("name", "task", "counted"),
    [
        ("planar2", "", False),
        ("gantry", "", True),
        ("gantry", "task: [x, y]\n", False),
        ("pan_tilt", "", True),
        ("pan_tilt", "task: [axis]\n", True),
    ],
)
def test_the_tool_is_judged_by_what_counts_of_it(name: str, task: str, counted: bool, tmp_path: Path) -> None:
    """What leads out of a planar arm's plane, or out of a stated task, is no error; a task without a position counts all."""
    more = f"sensor: {{type: position, sigma: {{xyz: 0.01}}}}\n{task}"
    machine = partial_machine(tmp_path, name, more)
    assert machine.file
    text = machine.file.path.read_text(encoding="utf-8")
    text = (
        text.replace("frames: {", f"frames: {{{BASE}, ")
        if "frames" in text
        else f"{text}frames: {{{BASE}}}\n"
    )
    machine.file.path.write_text(text, encoding="utf-8")
    machine = load_machine(machine.file.path)
    solver = PoseSolver(machine)
    q = readings(machine, 60, 1)
    poses = solver.forward(q)[0]
    up = 0.5 * np.random.default_rng(2).standard_normal(len(q))
    read = poses[:, :3, 3] + up[:, None] * base_frame(machine)[:3, 2]
    rows = rows_of(q, joints=machine.mechanism.readings, observations=dict(zip("xyz", read.T, strict=True)))
    predictor = Predictor(machine, rows, ())
    p = predictor.model.p_home
    fitted = np.arange(len(q)) < 40
    squares = tool_points(predictor, p, predictor.assemble(p)[0]).squares(fitted, ~fitted)
    assert np.sqrt(np.mean(squares)) == pytest.approx(
        np.std(up[~fitted]) if counted else 0.0, rel=0.2, abs=2e-2
    )
