"""Derivatives of loops by screws against derivatives of the expressions."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support import telescope_models
from support.generated_machines import machine_of
from truepose.models.machine import kinematics
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import (
    AXES,
    BASE,
    Actuator,
    Joint,
    JointKind,
    Mechanism,
    Parameter,
    Rod,
    Step,
)
from truepose.models.machine.velocities import gap_derivative, twists
from truepose.models.sensors.pose import Position

OFFSETS = tuple(f"{letter}.{kind}" for letter in "abcde" for kind in ("tx", "ty", "rz", "rx"))


def every_joint(closing: JointKind | None, driven: bool) -> Machine:
    """Two chains of all kinds of joints whose last bodies coincide at home, held together by a joint or a rod."""

    def placed(letter: str) -> tuple[Step, ...]:
        return tuple(Step(name.split(".")[1], name) for name in OFFSETS if name.startswith(letter))

    joints = [
        Joint("ja", "universal", BASE, "a", placed("a"), home=(0.0, 0.0)),
        Joint("jb", "spherical", "a", "b", placed("b"), home=(0.0, 0.0, 0.0)),
        Joint("jc", "revolute", "b", "c", placed("c"), (0.0, 0.6, 0.8), home=(0.0,)),
        Joint("jd", "free", BASE, "d", placed("d"), home=(0.0,) * 6),
        Joint("je", "prismatic", "d", "e", placed("e"), (0.8, 0.6, 0.0)),
    ]
    rods: tuple[Rod, ...] = ()
    actuators = [Actuator("q1", "je", "mm", "mm")]
    if closing is None:
        rods = (Rod("rod", "c", ("b.tx", "b.ty", "c.tx"), "e", ("rod.x", "d.ty", "d.tx"), None, 30.0),)
        actuators.append(Actuator("q2", "rod", "mm", "mm", "rod.x"))
    else:
        joints.append(
            Joint("close", closing, "c", "e", (Step("ty", "a.tx"), Step("rz", "a.rz")), (0.6, 0.0, 0.8))
        )
        actuators += [Actuator("q2", "close", "rad", "rad")] if driven else []
    parameters = tuple(Parameter(n, "rad" if ".r" in n else "mm", 0.0) for n in OFFSETS)
    parameters += (Parameter("rod.x", "mm", 30.0),)
    frames = tuple(Parameter(f"{f}.{a}", "rad" if a[0] == "r" else "mm", 0.0) for f in FRAMES for a in AXES)
    mechanism = Mechanism(parameters, tuple(joints), tuple(actuators), "c", rods)
    return Machine("all", mechanism, frames, (Position(0.01),))


def compare(model: SymbolicModel) -> None:
    told = gap_derivative(model)
    assert told is not None
    y = ca.vertcat(model.q, model.x)
    plain = ca.vertcat(twists(model.pose, y), ca.jacobian(model.gap, y))
    inputs = [model.q, model.x, model.p, model.z]
    both = ca.Function("both", inputs, [ca.densify(told), ca.densify(plain)])
    rng = np.random.default_rng(17)
    for _ in range(4):
        q = model.q_home + 0.3 * rng.standard_normal(len(model.q_home))
        x = model.home + 0.3 * rng.standard_normal(len(model.home))
        p = model.p_home + 0.2 * rng.standard_normal(len(model.p_home))
        found, expected = (np.array(v) for v in both(q, x, p, model.z_home))
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("name", ["turns", "hybrid", "planar"])
def test_machines(tmp_path: Path, name: str) -> None:
    machine = machine_of(tmp_path, name)
    compare(symbolic_model(machine, machine.effects))


@pytest.mark.parametrize(
    ("closing", "driven"),
    [(kind, False) for kind in ("spherical", "universal", "fixed", "revolute", "prismatic", None)]
    + [("revolute", True)],
)
def test_every_kind_of_joint(
    monkeypatch: pytest.MonkeyPatch, closing: JointKind | None, driven: bool
) -> None:
    # joints are more than the loops determine: the derivative is there all the same
    monkeypatch.setattr(kinematics, "assembled_home", lambda model: model.home)
    compare(symbolic_model(every_joint(closing, driven)))


def test_what_moves_with_forces_or_geometry_is_left_to_differentiation(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "rails")  # a leg that yields under gravity has forces among the unknowns
    assert gap_derivative(symbolic_model(machine, machine.effects)) is None


def test_rods_that_grow_as_their_flexures_bend_are_left_to_differentiation(tmp_path: Path) -> None:
    bent = symbolic_model(telescope_models.machine_of(tmp_path, "beam"))
    assert gap_derivative(bent) is None
    compare(symbolic_model(telescope_models.machine_of(tmp_path, "spherical")))
