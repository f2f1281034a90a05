"""Every derivative of a machine against one obtained another way, by complex steps.

What is left is rounding of the double arithmetic under test: measured 1.3e-12.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from support.derivative_machines import ARM, MACHINES, read_machines, readings, symbols_of, written
from support.effects import Campaign
from support.moving_machines import FRAMED, drawn
from support.other_numbers import complex_step
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import sensors

Array = NDArray[np.float64]
EXACT = 1e-11
"""Relative to a column's largest entry: rounding of a few thousand operations, cancellation included."""
LOST = 1e-2
"""Part of the value's size that a column is compared with at least: one that vanishes is a value's rounding."""
SENSORS: Mapping[str, str] = {
    "pose": "{type: pose, sigma: {xyz: 0.01, rot: 0.001}}",
    "position": "{type: position, sigma: {xyz: 0.02}}",
    "targets": "{type: targets, points: {P1: [1, 2, 3], P2: [40, 0, 5], P3: [0, 50, -6]}, sigma: {xyz: 0.01}}",
    "distance": "{type: distance, beam: {xyz: [1, 900, 3], rx: 91, rz: 4}, mirror: {in: tool, z: 2, rx: 3, ry: -4}, "
    "sigma: {distance: 0.001}}",
    "ballbar": "{type: ballbar, centre: [100, 20, 30], ball: [1, 2, 3], sigma: {distance: 0.001}}",
    "socket": "{type: socket, ball: [1, 2, 30], sigma: {xyz: 0.01}}",
    "direction": "{type: direction, station: {xyz: [5, 9, 3], rpy: [1, 2, 3]}, sigma: {angle: 0.001}}",
    "angle": "{type: angle, zero: {q1: 0.3, q3: -0.2}, sigma: {angle: 0.001, length: 0.01}}",
    "tilt": "{type: tilt, zero: {x: 0.1, y: -0.2}, sigma: {angle: 0.001}}",
}


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.mktemp("machines"))


def check(inputs: Sequence[ca.SX], at: Sequence[Array], value: ca.SX, by: int, what: str = "") -> None:
    """CasADi's derivative is the complex step's."""
    own = ca.densify(ca.jacobian(ca.vec(value), inputs[by]))
    exact, here = ca.Function("j", list(inputs), [own, ca.densify(value)])(*at)
    stepped = complex_step(inputs, at, value, by)
    least = LOST * max(1.0, float(np.max(np.abs(here.full()))))
    size = np.maximum(np.max(np.abs(stepped), axis=0, initial=0.0), least)
    np.testing.assert_allclose(exact.full() / size, stepped / size, atol=EXACT, err_msg=what)


@pytest.mark.parametrize("name", MACHINES)
def test_pose_and_closure_by_everything(machines: Mapping[str, Machine], name: str) -> None:
    """By passive coordinates, readings and parameters, off the drawing and off closure."""
    machine, rng = machines[name], np.random.default_rng(6)
    model = symbolic_model(machine)
    x = model.home * (1 + 0.02 * rng.uniform(-1, 1, len(model.home))) + 0.02 * rng.uniform(
        -1, 1, len(model.home)
    )
    at = [x, readings(machine, rng)[0], model.z_home, drawn(machine, rng, 2.0)]
    checked: set[str] = set()
    for value, what in ((model.world[:3, :], "world"), (model.closure, "closure"), (model.gap, "gap")):
        for by, symbol in ((0, "x"), (1, "q"), (3, "p")):
            if value.numel() and len(at[by]):
                check(symbols_of(model), at, value, by, f"{what} by {symbol}")
                checked.add(f"{what} by {symbol}")
    # an open chain has nothing passive and closes nothing
    looped = {f"{what} by x" for what in ("world", "closure", "gap")} if len(model.home) else set()
    assert checked >= {"world by q", "world by p"} | looped


@pytest.mark.parametrize("sensor", SENSORS)
def test_sensors_by_pose_and_constants(tmp_path: Path, sensor: str) -> None:
    """Predictions and residuals by a small twist and by every constant of the sensor."""
    machine = written(tmp_path, FRAMED + ARM + f"sensor: {SENSORS[sensor]}\n")
    (instrument,) = machine.sensors
    own = [*(p.name for p in instrument.parameters), *instrument.reads]
    rng = np.random.default_rng(7)
    at = np.array([30.0, 500.0, -20.0])
    turn = lie.exp_so3(np.array([-np.pi / 2 + 0.2, 0.1, -0.2]))
    small, c, y = ca.SX.sym("small", 6), ca.SX.sym("c", len(own)), ca.SX.sym("y", len(instrument.columns))
    moved = lie.transform((ca.SX.eye(3) + lie.skew(small[3:])) @ ca.DM(turn), ca.DM(at) + small[:3])
    named = dict(zip(own, ca.vertsplit(c), strict=True)) if own else {}
    constants = np.array([machine.geometry[name].nominal for name in own]) + 0.01 * rng.uniform(
        -1, 1, len(own)
    )
    values = [np.zeros(6), constants, np.zeros(len(instrument.columns))]
    predicted = instrument.predict(moved, named)
    outputs = {"prediction": predicted}
    if not instrument.compares:
        read = ca.Function("read", [small, c, y], [predicted])(*values).full()[:, 0]
        values[2] = read + 0.01 * rng.uniform(-1, 1, len(read))
        outputs["residual"] = instrument.residual(moved, named, y)
    for what, value in outputs.items():
        for by in (0, 1):
            if len(values[by]):
                check([small, c, y], values, value, by, what)


def test_every_sensor_was_checked() -> None:
    """A sensor that is added meets these tests by an entry in SENSORS; irradiance is turned into distances."""
    assert set(sensors) <= set(SENSORS) | {"irradiance"}


def _somewhere(machines: Mapping[str, Machine], slug: str) -> list[tuple[str, PlacedEffect]]:
    """The effect at its first and last place on every machine that has one, with coefficients of some size."""
    out = []
    for name, machine in machines.items():
        effect = effects.get(slug, "test")()
        places = list(effect.places(machine))
        if effect.needs_load and name == "hybrid":
            continue  # weights nothing
        for place in dict.fromkeys(tuple(p) for p in places[:1] + places[-1:]):
            settings = dict(next(iter(effect.settings(machine, place, Campaign())), {}))
            placed = PlacedEffect.at(effect, machine, place, settings)
            sizes = [0.05 * c.scale if np.isfinite(c.scale) else 1e-3 for c in placed.coefficients]
            out.append((name, placed.with_values(sizes)))
    return out


@pytest.mark.parametrize("slug", [slug for slug in effects if slug not in (*OF_ROWS, "target-offset")])
def test_shifts_of_every_effect(machines: Mapping[str, Machine], slug: str) -> None:
    """Pose and closure by coefficients and parameters, the effect's shifts woven in.

    Effects of rows have no shifts; a target's offset moves its reading alone (`test_sensor_effects.py`).
    """
    rng = np.random.default_rng(8)
    found = _somewhere(machines, slug)
    assert found
    for name, placed in found[:3]:
        machine = machines[name]
        model = symbolic_model(machine, [placed])
        x = model.home + 0.01 * rng.uniform(-1, 1, len(model.home))
        z = np.where(model.z_home == 0.0, 0.7, model.z_home + 1.5)
        at = [x, readings(machine, rng)[0], z, model.p_home]
        for value, what in ((model.world[:3, :], "world"), (model.closure, "closure")):
            if value.numel():
                check(symbols_of(model), at, value, 3, f"{placed.label} on {name}: {what} by p")
                check(symbols_of(model), at, value, 1, f"{placed.label} on {name}: {what} by q")
