"""Poses against independent derivations: chains, loops, and their derivatives."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from support.closed_kinematics import INVERSE, base_to_flange, chain, leg_end, platform_pose, rail, readings
from support.moving_machines import HEXAPODS, SERIAL, TEXTS, drawn, named, nominal, read_machines, record
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "moving")


def twist(a: Array, b: Array, step: float) -> Array:
    """(n, 6) twist per unit from poses a to b, ``step`` apart."""
    turn = lie.log_so3(b[:, :3, :3] @ np.swapaxes(a[:, :3, :3], 1, 2))
    return np.hstack([b[:, :3, 3] - a[:, :3, 3], turn]) / step


# -- chains --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SERIAL)
def test_a_chain_is_the_product_of_its_rows(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(1)
    q, p = readings(machine, rng), drawn(machine, rng)
    c = named(machine, p)
    world, good = Predictor(machine, record(machine, q)).poses(p)
    assert good.all()
    expected = [chain(machine, row, c)[-1] for row in q]
    np.testing.assert_allclose(base_to_flange(machine, world, c), expected, atol=1e-9)


@pytest.mark.parametrize("tilt", [1e-2, 1e-5, 1e-8])
@pytest.mark.parametrize("towards", np.linspace(0.0, 6.0, 7))
def test_any_small_tilt_of_parallel_axes_is_a_small_change(
    machines: Mapping[str, Machine], tilt: float, towards: float
) -> None:
    """Hayati: without beta, a tilt about y would turn theta by a right angle at once."""
    machine = machines["arm"]
    axis = np.array([np.sin(tilt) * np.cos(towards), np.sin(tilt) * np.sin(towards), np.cos(tilt)])
    c = dict(nominal(machine))
    before = chain(machine, np.zeros(6), c)
    c["q3.beta"], c["q3.alpha"] = float(np.arctan2(axis[0], axis[2])), float(np.arcsin(-axis[1]))
    assert np.hypot(c["q3.beta"], c["q3.alpha"]) < 1.01 * tilt
    world, _ = Predictor(machine, record(machine, np.zeros((1, 6)))).poses(np.array(list(c.values())))
    links = chain(machine, np.zeros(6), c)
    np.testing.assert_allclose(base_to_flange(machine, world, c)[0], links[-1], atol=1e-9)
    np.testing.assert_allclose(links[1][:3, :3].T @ links[2][:3, 2], axis, atol=1e-12)
    assert np.linalg.norm(links[2][:3, 3] - before[2][:3, 3]) < 1000 * tilt


# -- loops ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", HEXAPODS)
def test_forward_undoes_the_closed_inverse(machines: Mapping[str, Machine], name: str) -> None:
    machine, rng = machines[name], np.random.default_rng(2)
    p = drawn(machine, rng)
    c = named(machine, p)
    placed = [platform_pose(rng) for _ in range(60)]
    q = np.array([INVERSE[name](machine, *pose, c) for pose in placed])
    world, good = Predictor(machine, record(machine, q)).poses(p)
    assert good.all()
    found = base_to_flange(machine, world, c)
    np.testing.assert_allclose(found[:, :3, 3], [position for position, _ in placed], atol=1e-7)
    np.testing.assert_allclose(found[:, :3, :3], [rotation for _, rotation in placed], atol=1e-9)


# -- derivatives ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", TEXTS)
def test_twists_by_every_parameter_and_port(machines: Mapping[str, Machine], name: str) -> None:
    """Implicit derivatives against differences of poses solved anew."""
    machine, rng = machines[name], np.random.default_rng(5)
    predictor = Predictor(machine, record(machine, readings(machine, rng, 3)), ports=True)
    p = predictor.model.p_home.copy()
    p[: len(machine.parameters)] = drawn(machine, rng)
    x, good = predictor.assemble(p)
    assert good.all()
    _, exact = predictor.twists(p, x)
    units = {q.name: q.unit for q in machine.parameters}
    units |= {actuator.displacement: actuator.unit for actuator in machine.mechanism.actuators}
    for k, port in enumerate(predictor.model.names):
        turns = port.rsplit(".", 1)[-1].startswith("r")
        step = 1e-2 if units.get(port, "rad" if turns else "mm") == "mm" else 1e-5
        ends = []
        for sign in (-1, 1):
            moved = p.copy()
            moved[k] += sign * step
            ends.append(predictor.poses(moved, predictor.assemble(moved, x)[0])[0])
        slope = twist(ends[0], ends[1], 2 * step)
        scale = 1.0 + np.abs(slope).max()
        np.testing.assert_allclose(exact[:, :, k], slope, atol=3e-7 * scale, err_msg=port)


def test_shifted_parameters_move_the_base_too(machines: Mapping[str, Machine]) -> None:
    """A shift at base.x is seen like any other."""
    machine, rng = machines["movers"], np.random.default_rng(12)
    wrong = PlacedEffect.at(effects.get("wrong-constant", "test")(), machine, ("base.x",), {}, {"value": 3.0})
    q = readings(machine, rng, 2)
    world, shifted = (
        Predictor(machine, record(machine, q), placed).poses(symbolic_model(machine, placed).p_home)[0]
        for placed in ((), (wrong,))
    )
    np.testing.assert_allclose(shifted[:, :3, 3] - world[:, :3, 3], [[3.0, 0.0, 0.0]] * 2, atol=1e-9)


@pytest.mark.parametrize("name", HEXAPODS)
def test_legs_have_their_lengths_after_the_forward_solution(
    machines: Mapping[str, Machine], name: str
) -> None:
    machine, rng = machines[name], np.random.default_rng(3)
    p = drawn(machine, rng)
    c, q = named(machine, p), readings(machine, rng, 20)
    world, good = Predictor(machine, record(machine, q)).poses(p)
    assert good.all()
    for row, pose in zip(q, base_to_flange(machine, world, c), strict=True):
        for leg, reading in enumerate(row, start=1):
            upper = pose[:3, 3] + pose[:3, :3] @ leg_end(c, leg, "b")
            moved = c[f"leg{leg}.offset"] + c[f"leg{leg}.gain"] * reading
            slide = moved * rail(machine, leg, c) if name == "pus" else 0.0
            length = c[f"leg{leg}.length"] if name == "pus" else moved
            assert np.linalg.norm(upper - leg_end(c, leg, "a") - slide) == pytest.approx(length, abs=1e-8)
