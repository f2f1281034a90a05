"""Planar linkages whose loop is closed by each kind of joint, against circles and lines that meet."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from support.moving_machines import record
from truepose.identification.prediction.predictor import Predictor
from truepose.models.machine.machine import FRAMES, Machine
from truepose.models.machine.mechanism import (
    AXES,
    BASE,
    Actuator,
    Direction,
    Joint,
    JointKind,
    Mechanism,
    Parameter,
    Step,
)
from truepose.models.sensors.pose import Position

Array = NDArray[np.float64]
SLOPE = 0.2
LINKS = {"crank": 40.0, "coupler": 110.0, "rocker": 80.0, "ground": 100.0}


def turned(angle: float, length: float) -> Array:
    return length * np.array([np.cos(angle), np.sin(angle), 0.0])


def four_bar(crank: float) -> Array:
    """Joint between coupler and rocker, above the line between the two pivots it hangs on."""
    a, o = turned(crank, LINKS["crank"]), np.array([LINKS["ground"], 0.0, 0.0])
    r, s, line = LINKS["coupler"], LINKS["rocker"], o - a
    d = float(np.linalg.norm(line))
    along = (r**2 - s**2 + d**2) / (2 * d)
    left = np.array([-line[1], line[0], 0.0]) / d
    out: Array = a + along * line / d + np.sqrt(r**2 - along**2) * left
    return out


def slider(crank: float, slope: float = 0.0) -> Array:
    """Block at the end of the coupler, on a rail through the origin."""
    rail, end = turned(np.arcsin(slope), 1.0), turned(crank, LINKS["crank"])
    out: Array = (rail @ end + np.sqrt(LINKS["coupler"] ** 2 - end @ end + (rail @ end) ** 2)) * rail
    return out


def planar(joints: list[Joint], flange: str) -> Machine:
    """A planar linkage, crank driven, seen by its flange's position."""
    parameters = tuple(Parameter(name, "mm", length) for name, length in LINKS.items())
    parameters += (Parameter("rail.y", "1", SLOPE), Parameter("rail.z", "1", 0.0))
    frames = tuple(Parameter(f"{f}.{a}", "rad" if a[0] == "r" else "mm", 0.0) for f in FRAMES for a in AXES)
    mechanism = Mechanism(parameters, tuple(joints), (Actuator("q", "j1", "rad", "rad"),), flange)
    return Machine("linkage", mechanism, frames, (Position(0.01),))


def along(name: str) -> tuple[Step, ...]:
    return (Step("tx", name),)


def open_chain() -> list[Joint]:
    crank = Joint("j1", "revolute", BASE, "crank")
    return [crank, Joint("j2", "revolute", "crank", "coupler", along("crank"), home=(0.5,))]


def with_rocker(kind: JointKind) -> Machine:
    """Closed between coupler and rocker by a joint that allows at least a turn about z."""
    rocker = Joint("j3", "revolute", BASE, "rocker", along("ground"), home=(1.5,))
    end = Joint("end", "fixed", "rocker", "rocker end", along("rocker"))
    axis = (0.0, 0.0, 1.0)
    turned_in = Joint("lay", "fixed", "coupler", "tip", along("coupler"))
    return planar(
        [*open_chain(), rocker, end, turned_in, Joint("j4", kind, "tip", "rocker end", (), axis)],
        "rocker end",
    )


def with_foot() -> Machine:
    """Three passive joints in a row, the last body fixed to the ground: a loop closed by a fixed joint."""
    rocker = Joint("j3", "revolute", "coupler", "rocker", along("coupler"), home=(-1.5,))
    foot = Joint("j4", "revolute", "rocker", "foot", along("rocker"), home=(0.5,))
    ground = Joint("ground", "fixed", BASE, "ground", along("ground"))
    return planar([*open_chain(), rocker, foot, ground, Joint("j5", "fixed", "foot", "ground")], "rocker")


def with_slider(axis: tuple[float, float, float] | Direction) -> Machine:
    """A block at the end of the coupler that slides along a rail."""
    block = Joint("j3", "revolute", "coupler", "block", along("coupler"), home=(-0.5,))
    return planar([*open_chain(), block, Joint("j4", "prismatic", "block", BASE, (), axis)], "block")


def universal() -> Machine:
    """The closing cross turns about x, then y: the linkage stands in the plane of x and z instead."""
    flat = with_rocker("universal")
    upright = [
        replace(j, axis=(0.0, -1.0, 0.0)) if j.kind == "revolute" else j for j in flat.mechanism.joints
    ]
    return replace(flat, mechanism=replace(flat.mechanism, joints=tuple(upright)))


LINKAGES: Mapping[str, tuple[Callable[[], Machine], Callable[[float], Array]]] = {
    "revolute": (lambda: with_rocker("revolute"), four_bar),
    "spherical": (lambda: with_rocker("spherical"), four_bar),
    "universal": (universal, lambda crank: four_bar(crank)[[0, 2, 1]]),
    "fixed": (with_foot, four_bar),
    "prismatic": (lambda: with_slider((1.0, 0.0, 0.0)), slider),
    "prismatic, slanted": (
        lambda: with_slider(Direction((None, "rail.y", "rail.z"))),
        lambda crank: slider(crank, SLOPE),
    ),
}


@pytest.mark.parametrize("kind", LINKAGES)
def test_linkages_close_whatever_joint_closes_them(kind: str) -> None:
    build, expected = LINKAGES[kind]
    machine = build()
    cranks = np.linspace(-1.2, 1.2, 9)
    predictor = Predictor(machine, record(machine, cranks[:, None]))
    p = predictor.model.p_home
    x, good = predictor.assemble(p)
    assert good.all()
    model = predictor.model
    closure = ca.Function("closure", [model.x, model.q, model.z, model.p], [model.closure])
    gaps = [closure(here, [crank], [], p).full() for here, crank in zip(x, cranks, strict=True)]
    np.testing.assert_allclose(gaps, 0.0, atol=1e-9)
    world, _ = predictor.poses(p, x)
    np.testing.assert_allclose(world[:, :3, 3], [expected(crank) for crank in cranks], atol=1e-8)


@pytest.mark.parametrize("kind", LINKAGES)
def test_linkages_follow_their_lengths(kind: str) -> None:
    build, expected = LINKAGES[kind]
    machine = build()
    predictor = Predictor(machine, record(machine, np.array([[0.4], [-0.7]])))
    p = predictor.model.p_home
    _, slopes = predictor.twists(p, predictor.assemble(p)[0])
    for k, name in enumerate(LINKS):
        before, moved = LINKS[name], []
        for step in (-1e-4, 1e-4):
            LINKS[name] = before + step
            moved.append(np.array([expected(0.4), expected(-0.7)]))
        LINKS[name] = before
        np.testing.assert_allclose(slopes[:, :3, k], (moved[1] - moved[0]) / 2e-4, atol=1e-6)
