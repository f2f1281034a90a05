"""Laws of hexapods' legs before they become C: units of their forces, and one assembly of every leg."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.generated_machines import HEAD
from support.legged_machines import LEGGED
from truepose.codegen import layout
from truepose.codegen.layout import layout_of
from truepose.codegen.legs import legs_of
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model


def model_of(folder: Path, text: str) -> SymbolicModel:
    path = folder / "legs.yaml"
    path.write_text(HEAD.format(name="legs") + text)
    machine = load_machine(path)
    return symbolic_model(machine, machine.effects)


def test_legs_that_change_their_assembly_have_no_closed_form(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A slide has two places for one pose, below and above its joint: the same one must be meant everywhere."""
    monkeypatch.setattr(layout, "VECTORS", 8)
    model = model_of(tmp_path, LEGGED["plain_rails"])
    numbers = layout_of(model, "double")
    legs = legs_of(model, numbers, "double")
    assert legs is not None and legs.roots is not None
    lack = ca.Function("lack", [legs.pose, model.q, model.p, model.z], [legs.lack])
    for k in (0, 5):
        q, tool = numbers.vectors[7]
        trials = []
        for move in (-1.0, 0.0, 1.0):
            there = q.copy()
            there[k] += move
            trials.append(float(lack(tool[:3].ravel(), there, model.p_home, model.z_home)[k]))
        moves = np.roots(np.polyfit([-1.0, 0.0, 1.0], trials, 2))
        assert np.min(np.abs(moves)) < 1e-6 and np.max(np.abs(moves)) > 100.0
        other = q.copy()
        other[k] += moves[np.argmax(np.abs(moves))]
        vectors = (*numbers.vectors[:7], (other, tool))
        assert legs_of(model, replace(numbers, vectors=vectors), "double") is None
