"""Laws of the inverse of machines whose loops carry loads. mm, rad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support import ROOT
from support.simulated import machine_from
from truepose.identification.compensation.inverse import PoseSolver

POLISHER = ROOT / "models" / "machines" / "polisher" / "machine.yaml"
YIELDING = """
effects:
  - {effect: joint-compliance, place: [q5], parameters: {c: {value: 9.0e-6, unit: rad/(N*m)}}}
"""


@pytest.mark.parametrize("effects", ["", YIELDING])
def test_leg_forces_do_not_hide_the_pose(effects: str, tmp_path: Path) -> None:
    """From home, in one attempt: N and N mm beside mm would make a valley that takes hundreds of steps, or no end."""
    solver = PoseSolver(machine_from(tmp_path, POLISHER.read_text(encoding="utf-8") + effects))
    assert len(solver.model.home) == (18 if effects else 9)  # with leg forces, or without
    low, high = np.array([a.range for a in solver.machine.mechanism.actuators], dtype=float).T
    share = np.random.default_rng(8).uniform(-1, 1, (60, 6))
    q = (low + high) / 2 + (high - low) / 4 * share
    poses, assembled = solver.forward(q)
    assert assembled.all()
    found = solver.inverse(poses, restarts=0)
    assert found.solved.all()
    # a pose counts as met within 1e-9 of the machine's size, 1.9 m, and 1e-9 rad; a joint may need some times that
    assert np.all(np.abs(found.q - q) < [1e-5] * 3 + [1e-7] * 3)
