"""Loads of joints and legs against the potential energy and the balance of wrenches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.closed_kinematics import base_to_flange, chain, leg_end, readings, ups_inverse
from support.moving_machines import SERIAL, drawn, named, nominal, read_machines, record
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import AXES

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "moving")


def _potential(machine: Machine, q: Array, c: Mapping[str, float]) -> float:
    """N m of a serial chain's masses, from SymPy's chain."""
    links = chain(machine, q, c)
    tool = np.eye(4)
    tool[:3, 3] = [c[f"tool.{axis}"] for axis in "xyz"]
    tool[:3, :3] = lie.rpy_matrix(np.array([c[f"tool.r{axis}"] for axis in "xyz"]))
    frames = {f"link{k}": link for k, link in enumerate(links, start=1)} | {"tool": links[-1] @ tool}
    weights = ((m.kg * np.array(machine.gravity), frames[m.body] @ [*m.com, 1.0]) for m in machine.masses)
    return -sum(float(weight @ at[:3]) for weight, at in weights) / 1000


@pytest.mark.parametrize("name", SERIAL)
def test_loads_of_serial_joints_are_slopes_of_the_potential(
    machines: Mapping[str, Machine], name: str
) -> None:
    machine, rng = machines[name], np.random.default_rng(9)
    q, p = readings(machine, rng, 3), drawn(machine, rng)
    c = named(machine, p)
    predictor = Predictor(machine, record(machine, q), ports=True)
    full = predictor.model.p_home.copy()
    full[: len(p)] = p
    loads = predictor.loads(full, predictor.assemble(full)[0])
    for row, reading in enumerate(q):
        for k, actuator in enumerate(machine.mechanism.actuators):
            step = (1e-4 if actuator.unit == "rad" else 1e-1) * np.eye(len(reading))[k]
            ends = [_potential(machine, reading + sign * step, c) for sign in (-1, 1)]
            slope = -(ends[1] - ends[0]) / (2 * step[k])
            expected = slope if actuator.unit == "rad" else 1000 * slope  # N m per mm to N
            assert loads[actuator.displacement][row] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def _tensions(machine: Machine, flange: Array, tool: Array, c: Mapping[str, float]) -> Array:
    """Leg forces of a 6-UPS that balance the weight's wrench, N, positive in tension."""
    upper = [flange[:3, 3] + flange[:3, :3] @ leg_end(c, leg, "b") for leg in range(1, 7)]
    pulls = [leg_end(c, leg, "a") - b for leg, b in enumerate(upper, start=1)]
    columns = [np.hstack([f, np.cross(b, f)]) / np.linalg.norm(f) for f, b in zip(pulls, upper, strict=True)]
    weight = np.zeros(6)
    for mass in machine.masses:
        frame = tool if mass.body == "tool" else flange
        at = frame[:3, 3] + frame[:3, :3] @ mass.com
        force = mass.kg * np.array(machine.gravity)
        weight += np.hstack([force, np.cross(at, force)])
    return np.linalg.solve(np.column_stack(columns), -weight)


def test_leg_forces_balance_the_wrench_of_the_weight(machines: Mapping[str, Machine]) -> None:
    machine, rng = machines["ups"], np.random.default_rng(10)
    p, q = drawn(machine, rng), readings(machine, rng, 4)
    c = named(machine, p)
    predictor = Predictor(machine, record(machine, q), ports=True)
    full = np.concatenate([p, np.zeros(len(predictor.model.names) - len(p))])
    loads = predictor.loads(full, predictor.assemble(full)[0])
    world, _ = predictor.poses(full)
    flange = base_to_flange(machine, world, c)
    base = base_to_flange(machine, np.eye(4)[None], {**c, **{f"tool.{axis}": 0.0 for axis in AXES}})[0]
    expected = [_tensions(machine, f, base @ w, c) for f, w in zip(flange, world, strict=True)]
    found = np.column_stack([loads[a.displacement] for a in machine.mechanism.actuators])
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("kg", [1.0, 2000.0])
def test_soft_legs_stand_in_balance(machines: Mapping[str, Machine], kg: float) -> None:
    """Where legs give way, the unknown forces are those that hold the platform as it then stands."""
    machine, c = machines["ups"], 1e-4
    heavy = replace(machine, masses=tuple(replace(m, kg=m.kg * kg) for m in machine.masses))
    effect = effects.get("leg-compliance", "test")()
    legs = tuple(limb.name for limb in heavy.mechanism.limbs)
    placed = PlacedEffect.at(effect, heavy, legs, {}, {"c": c})
    rng = np.random.default_rng(11)
    q = readings(heavy, rng, 2)
    predictor = Predictor(heavy, record(heavy, q), [placed])
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    assert good.all()
    world, _ = predictor.poses(p, x)
    values = nominal(heavy)
    flange = base_to_flange(heavy, world, values)
    base = base_to_flange(heavy, np.eye(4)[None], {**values, **{f"tool.{axis}": 0.0 for axis in AXES}})[0]
    tension = np.array([_tensions(heavy, f, base @ w, values) for f, w in zip(flange, world, strict=True)])
    np.testing.assert_allclose(x[:, -6:], tension, rtol=1e-4 * kg**0.5, atol=1e-3)
    grown = np.array([ups_inverse(heavy, f[:3, 3], f[:3, :3], values) for f in flange]) - q
    gains = np.array([values[f"leg{k}.gain"] for k in range(1, 7)])
    np.testing.assert_allclose(grown * gains, c * x[:, -6:], rtol=1e-3 * kg**0.5, atol=1e-7)
