"""Imperfections of the independent simulator: their zeros, sizes and signs, and the statics below them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from challenge.simulator.arm import Arm
from challenge.simulator.base import Array, Campaign, Imperfection, Place, SimulatedMachine, Specimen
from challenge.simulator.ported import Work
from challenge.simulator.stewart import Stewart
from challenge.simulator.stewart_closure import StewartPose
from challenge.simulator.stewart_drawing import PAYLOAD_COM, PLATFORM_COM, PLATFORM_KG
from proof_support.simulated_machines import MACHINES, drawn

ONLY_TARGETS = ("target-offset", "sensor-scale")
"""What three reflectors change; the rest of ``arm-targets`` is ``arm``."""
KINDS = [
    pytest.param(m, kind.name, place, id=f"{m.name}-{kind.name}-{'+'.join(place)}")
    for m in MACHINES
    for kind in m.kinds()
    for place in dict.fromkeys((kind.places[0], kind.places[-1]))
    if m.name != "arm-targets" or kind.name in ONLY_TARGETS
]


def imperfection(machine: SimulatedMachine, kind: str, place: Place, seed: int = 1) -> Imperfection:
    typical = next(k.typical for k in machine.kinds() if k.name == kind)
    return Imperfection(kind, place, typical, machine.shape(kind, place, np.random.default_rng(seed)))


@pytest.mark.parametrize(("machine", "kind", "place"), KINDS)
class TestKinds:
    def test_size_none_leaves_readings_as_they_are(
        self, machine: SimulatedMachine, kind: str, place: Place
    ) -> None:
        spec, c = drawn(machine, kind)
        none = imperfection(machine, kind, place).scaled(0.0)
        np.testing.assert_array_equal(machine.measure(spec, (none,), c), machine.measure(spec, (), c))

    def test_readings_move_and_scale_continuously(
        self, machine: SimulatedMachine, kind: str, place: Place
    ) -> None:
        """Small sizes act in proportion; a tenth of a thousandth more of it changes readings by about as much."""
        spec, c = drawn(machine, kind)
        exact = machine.measure(spec, (), c)
        typical = imperfection(machine, kind, place)
        change = machine.measure(spec, (typical,), c) - exact
        assert np.max(np.abs(change)) > 1e-5
        more = machine.measure(spec, (typical.scaled(1 + 1e-4),), c) - exact
        assert np.linalg.norm(more - change) < 3e-4 * np.linalg.norm(change)
        small = machine.measure(spec, (typical.scaled(1e-2),), c) - exact
        assert np.linalg.norm(small - 1e-2 * change) < 1e-3 * np.linalg.norm(change)

    def test_the_same_again(self, machine: SimulatedMachine, kind: str, place: Place) -> None:
        spec, c = drawn(machine, kind)
        one, two = (machine.measure(spec, (imperfection(machine, kind, place),), c) for _ in range(2))
        np.testing.assert_array_equal(one, two)


class TestPhysics:
    def test_what_yields_lets_the_tool_fall_and_further_under_load(self) -> None:
        machine = Arm()
        spec, c = drawn(machine)
        heavy = replace(c, payload=np.full(len(c), 16.0))
        weak_parts = (
            ("joint-compliance", ("q2",)),
            ("joint-compliance", ("q3",)),
            ("link-bending", ("link2",)),
            ("link-bending", ("link4",)),
            ("gravity-sag", ("base",)),
        )
        for kind, place in weak_parts:
            weak = imperfection(machine, kind, place)
            empty, full = (
                _height(spec, machine.measure(spec, (weak,), k)) - _height(spec, machine.measure(spec, (), k))
                for k in (c, heavy)
            )
            assert np.mean(full) < np.mean(empty) < 0

    def test_pressed_legs_shorten(self) -> None:
        machine = Stewart()
        spec, c = drawn(machine)
        soft = tuple(imperfection(machine, "leg-compliance", (f"leg{k}",)) for k in range(1, 7))
        change = machine.measure(spec, soft, c) - machine.measure(spec, (), c)
        assert np.all(change[:, 2] < 0)

    def test_backlash_shows_only_between_sides(self) -> None:
        machine = Arm()
        spec, c = drawn(machine)
        one_sided = replace(c, approach=np.ones_like(c.approach))
        play = imperfection(machine, "backlash", ("q1",))
        zero = dict(spec.parameters)
        zero["q1.theta"] -= play.size / 2
        np.testing.assert_allclose(
            machine.measure(spec, (play,), one_sided),
            machine.measure(Specimen(zero), (), one_sided),
            atol=1e-9,
        )


class TestStatics:
    def test_arm_torques_are_slopes_of_the_potential_energy(self) -> None:
        """Central differences of the weights' energy by each joint, mJ to N*m; loads from summed moments."""
        machine = Arm()
        spec, c = drawn(machine)
        solved = machine.solve(_work(spec, c))

        def energy(work: Work) -> Array:
            there = machine.solve(work)
            joules: Array = -np.einsum("nmi,nmi->n", there.weights, there.spots) * 1e-3
            return joules

        for k in range(6):
            np.testing.assert_allclose(solved.torque(k), -_slope(energy, spec, c, k, 1e-5), atol=1e-5)

    def test_leg_forces_are_slopes_of_the_potential_energy(self) -> None:
        """A leg that grows by dl lifts the load by -F dl: Castigliano without any statics."""
        machine = Stewart()
        spec, c = drawn(machine)
        solved = machine.solve(_work(spec, c))

        def energy(work: Work) -> Array:
            return _energy(machine.solve(work), spec, c)

        for k in range(6):
            np.testing.assert_allclose(solved.forces[:, k], -_slope(energy, spec, c, k, 1e-4), atol=1e-4)


def _slope(energy: Callable[[Work], Array], spec: Specimen, c: Campaign, k: int, h: float) -> Array:
    """(n,) central difference of an energy by the displacement of joint or leg k."""
    ends = []
    for side in (h, -h):
        work = _work(spec, c)
        work.moved[:, k] += side
        ends.append(energy(work))
    slope: Array = (ends[0] - ends[1]) / (2 * h)
    return slope


def _work(spec: Specimen, c: Campaign) -> Work:
    values = {name: np.full(len(c), value) for name, value in spec.parameters.items()}
    return Work(c, values, np.zeros_like(c.q))


def _energy(there: StewartPose, spec: Specimen, c: Campaign) -> Array:
    """(n,) N*mm of platform and payload, from heights above the base's origin."""
    body = there.position + there.rotation @ np.array(PLATFORM_COM)
    hand = Rotation.from_euler("xyz", [spec.parameters[f"tool.r{a}"] for a in "xyz"]).apply(PAYLOAD_COM)
    hand = hand + np.array([spec.parameters[f"tool.{a}"] for a in "xyz"])
    load = there.position + there.rotation @ hand
    energy: Array = 9.80665 * (PLATFORM_KG * body[:, 2] + c.payload * load[:, 2])
    return energy


def _height(spec: Specimen, readings: Array) -> Array:
    """Along the vertical of the base as built, mm."""
    p = spec.parameters
    up = Rotation.from_euler("xyz", [p[f"base.r{a}"] for a in "xyz"]).apply([0.0, 0.0, 1.0])
    height: Array = readings @ up
    return height
