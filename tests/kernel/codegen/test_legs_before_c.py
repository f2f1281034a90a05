"""Laws of hexapods' legs before they become C: units of their forces, and one assembly of every leg."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.constants import g

from support.effect_machines import TEXTS
from support.generated_machines import HEAD, RAILS
from support.legged_machines import LEGGED
from support.moving_machines import written
from truepose.codegen import layout
from truepose.codegen.layout import layout_of
from truepose.codegen.legs import legs_of
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.mechanism import Joint


def model_of(folder: Path, text: str) -> SymbolicModel:
    path = folder / "legs.yaml"
    path.write_text(HEAD.format(name="legs") + text)
    machine = load_machine(path)
    return symbolic_model(machine, machine.effects)


@pytest.mark.parametrize(("kg", "counts"), [(30.0, 30.0), (2.5, 2.5), (0.1, 1.0)])
def test_a_legs_force_is_a_share_of_the_weight_it_carries(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kg: float, counts: float
) -> None:
    """At standard gravity, of one kilogram at least; a force of that size in each leg counts as one machine's reach."""
    monkeypatch.setattr(layout, "VECTORS", 2)
    numbers = layout_of(model_of(tmp_path, RAILS.replace("kg: 30,", f"kg: {kg},")), "double")
    forces = np.array(numbers.bounded) == 0
    assert forces.sum() == 6
    np.testing.assert_allclose(numbers.unknown[forces] * numbers.reach, counts * g)


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


def test_a_platform_that_carries_a_body_is_not_solved_leg_by_leg(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rods could hold on to that body as well."""
    monkeypatch.setattr(layout, "VECTORS", 2)
    model = model_of(tmp_path, LEGGED["plain_rails"])
    numbers = layout_of(model, "double")
    mechanism = model.machine.mechanism
    camera = Joint("camera", "fixed", mechanism.flange, "camera")
    more = replace(model.machine, mechanism=replace(mechanism, joints=(*mechanism.joints, camera)))
    assert legs_of(model, numbers, "double") is not None
    assert legs_of(symbolic_model(more), numbers, "double") is None


@pytest.mark.parametrize(("unit", "half"), [("mm", 60.0), ("rad", np.radians(150.0))])
def test_joints_without_a_range_are_sampled_on_both_sides(tmp_path: Path, unit: str, half: float) -> None:
    """A slide by a tenth of the machine's size about home, a turning joint by 150 degrees about zero."""
    stage = written(tmp_path, TEXTS["stage"])
    actuators = stage.mechanism.actuators
    free = replace(
        stage, mechanism=replace(stage.mechanism, actuators=tuple(replace(a, range=None) for a in actuators))
    )
    near = np.arange(1.0, len(actuators) + 1.0)
    low, high = layout.sample_ranges(free, near, 600.0)
    own = np.array([a.unit == unit for a in actuators])
    assert own.any()
    np.testing.assert_allclose((high - low)[own] / 2.0, half)
    np.testing.assert_allclose((high + low)[own] / 2.0, near[own] if unit == "mm" else 0.0)
