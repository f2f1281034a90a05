"""Information of measurement poses: what a fit would use, with exact slopes of the criterion on it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.graph_machines import machine_of
from support.plans import NAMES, poses
from truepose.identification.fit.problem import prior_of
from truepose.identification.leaves.planning.climb import Landscape
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.leaves.planning.plan import plan
from truepose.identification.leaves.planning.showing import plan_table
from truepose.identification.prediction.predict import simulate, with_inputs
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.effect_text import parse_effect
from truepose.models.machine.machine import Machine, Mass
from truepose.models.sensors.pose import Position


def loaded(name: str) -> Machine:
    """Machines with effects as well: loads in an open and in a closed chain."""
    if not name.endswith(" with effects"):
        return machine_of(name)
    machine = machine_of(name.removesuffix(" with effects"))
    texts = ["joint-compliance@q2:c=1e-7", "transmission-error@q3:a=1e-4,b=0,order=1", "gravity-sag@tool"]
    if name.startswith("pus"):
        mass = Mass("mirror", 20.0, (10.0, 5.0, 30.0), machine.mechanism.flange)
        machine = replace(machine, gravity=(0.0, 0.0, -9.80665), masses=(mass,))
        texts = ["actuator-scale@rho2:s=1e-3", "leg-compliance@leg2:c=1e-4"]
    return machine.with_effects(tuple(parse_effect(text, machine) for text in texts))


@pytest.mark.parametrize("name", [*NAMES, "serial with effects", "pus with effects", "hybrid", "delta"])
def test_gradients_are_exact_through_loops_loads_and_differences_of_rows(name: str) -> None:
    """Against differences of eighth order along random directions of all joints of all poses."""
    function = Landscape(PoseInformation(loaded(name)))
    information = function.information
    q = 0.8 * poses(information, 12) + 0.2 * information.home
    value, gradient = function.gradient(information.at(q))
    # once with and once without slopes: other sums, of some hundred terms
    assert value == pytest.approx(function.value(information.at(q)), rel=1e-12)
    rng = np.random.default_rng(4)
    for _ in range(3):
        e = 5e-3 * (information.high - information.low) * rng.uniform(-1, 1, q.shape)
        both = [[function.value(information.at(q + sign * k * e)) for sign in (1, -1)] for k in (1, 2, 3, 4)]
        difference = sum(
            c * (up - down) for c, (up, down) in zip((4 / 5, -1 / 5, 4 / 105, -1 / 280), both, strict=True)
        )
        # values have some 13 digits, more than six of which remain of a change by 5e-3 of the ranges
        assert abs(difference - float(np.sum(gradient * e))) < 1e-5 * float(np.linalg.norm(gradient * e))


@pytest.mark.parametrize("name", [*NAMES, "serial with effects"])
def test_the_planned_information_is_what_a_fit_would_use(name: str, tmp_path: Path) -> None:
    """Against the Jacobian of the fit's residuals on a recording at these poses."""
    machine = loaded(name)
    information = PoseInformation(machine)
    found = information.at(poses(information, 8))
    rows = information.rows(found.signature).reshape(-1, len(information.names))
    made = plan(machine, 8, method="random")
    made = replace(made, q=found.q)
    plan_table(made).to_csv(tmp_path / "poses.csv", index=False)
    frame = simulate(
        machine, load_recording(machine, [tmp_path / "poses.csv"], need_observations=False), seed=None
    )
    with_inputs(read_table(tmp_path / "poses.csv"), frame).to_csv(tmp_path / "recording.csv", index=False)
    predictor = Predictor(machine, load_recording(machine, [tmp_path / "recording.csv"]), machine.effects)
    p = predictor.model.p_home
    prior = prior_of(machine, machine.effects)
    x, _ = predictor.assemble(p)
    fitted = np.concatenate([block.jacobian for block in predictor.blocks(p, x)])
    fitted = (fitted[..., prior.free] * prior.scale[prior.free]).reshape(-1, len(prior.free))
    gram = fitted.T @ fitted
    # the recording's joints are rounded to 1e-12 of their range
    assert np.max(np.abs(rows.T @ rows - gram)) < 1e-9 * np.max(gram)


@dataclass(frozen=True)
class OwnResidual(Position):
    """A position sensor whose residual is its own, turned into the tool's axes."""

    type = "own-residual"

    def residual(self, world: ca.SX, s: Mapping[str, ca.SX], reading: ca.SX) -> ca.SX:
        return world[:3, :3].T @ (world[:3, 3] - reading)


def test_a_sensor_with_a_residual_of_its_own_is_planned_for_all_the_same() -> None:
    machine = machine_of("serial")
    own = replace(machine, sensors=(OwnResidual(0.01),))
    plain, turned = (Landscape(PoseInformation(one)) for one in (machine, own))
    q = poses(plain.information, 9)
    value, gradient = plain.gradient(plain.information.at(q))
    other, slope = turned.gradient(turned.information.at(q))
    assert other == pytest.approx(value, rel=1e-12)
    assert slope == pytest.approx(gradient, rel=1e-9, abs=1e-9 * float(np.max(np.abs(gradient))))
