"""A builder and a sensor from outside the package are fitted without another edit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest

from support.moving_machines import POSE, record, written
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.builder import BuildContext, builders
from truepose.models.machine.mechanism import BASE, Actuator, Joint, Mechanism, Parameter, Step
from truepose.models.machine.sensor import Channel, Sensor, sensors


@pytest.fixture
def additions() -> None:
    """A gantry and a dial gauge, known by name for one test."""

    @builders.add("gantry")
    def gantry(section: Mapping[str, Any], context: BuildContext) -> Mechanism:
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        bodies = (BASE, "x", "y", "z")
        tilts = tuple(context.parameter(f"{b}.tilt", "rad", 0.0, ("tilt", b)) for b in bodies[1:])
        joints = tuple(
            Joint(f"s{k}", "prismatic", a, b, (Step(f"r{'yxz'[k]}", f"{b}.tilt"),), axes[k])
            for k, (a, b) in enumerate(pairwise(bodies))
        )
        return Mechanism(tilts, joints, tuple(Actuator(j.name, j.name, "mm", "mm") for j in joints), "z")

    @sensors.add("dial")
    @dataclass(frozen=True)
    class Dial(Sensor):
        zero: Parameter
        type = "dial"
        columns = {"height": "mm"}  # noqa: RUF012
        channels = (Channel("height", "mm", 1e-3, "distance", "tip"),)
        parameters = property(lambda self: (self.zero,))

        @classmethod
        def build(cls, section: Mapping[str, Any], context: BuildContext) -> Dial:
            return cls(context.parameter("zero", "mm", 0.0, ("zero",), "sensor", 10.0))

        def predict(self, world: ca.SX, s: Mapping[str, ca.SX]) -> ca.SX:
            return world[2, 3] - s["zero"]


@pytest.mark.usefixtures("additions")
def test_a_builder_and_a_sensor_from_outside_need_no_other_edit(tmp_path: Path) -> None:
    machine = written(tmp_path, "mechanism: {type: gantry}\nsensor: {type: dial}\n")
    rng = np.random.default_rng(12)
    q, truth = rng.uniform(-300, 300, (40, 3)), np.array([1e-3, -2e-3, 0.0, *np.zeros(12), 0.7])
    assert [p.name for p in machine.parameters][-1] == "zero"
    predictor = Predictor(machine, record(machine, q))
    _, values, _, _ = predictor.columns(truth, predictor.assemble(truth)[0])
    read = machine.sensors[0].noisy(values, rng)[:, 0]
    fit = estimate(machine, record(machine, q, {"height": read}))
    off = (fit.p - truth)[fit.prior.free] / fit.std[fit.prior.free]
    assert np.abs(off).max() < 4.0
    assert fit.chi2_per_dof < 2.0


def test_what_was_discarded_is_unknown(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="gantry"):
        written(tmp_path, "mechanism: {type: gantry}\n" + POSE)
