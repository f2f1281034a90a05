"""Wind-up, wobble, flexures and crosses: closed forms, zeros at home, and truths recovered by a fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.effect_machines import Machines
from support.effects import with_effect
from support.simulated import machine_from, recorded
from support.structures import TEXTS, G, structure, turn_between
from support.tool_pose import HEAD, pose
from truepose.identification.fit.estimate import estimate
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect, Settings, effects
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import Mechanism

Array = NDArray[np.float64]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Machines:
    folder = tmp_path_factory.mktemp("machines")
    return {name: structure(folder, name) for name in TEXTS}


# -- axis-wobble, screw-windup -----------------------------------------------------------------------------


def test_a_wobbling_axis_tilts_against_its_turn(machines: Machines) -> None:
    """The direction that the body carries as its axis, seen from where the joint stands: one circle, backwards."""
    arm, a, b = machines["arm"], 3e-4, -2e-4
    tilts, angles = [], np.linspace(-2.5, 2.5, 11)
    wobble = with_effect(arm, "axis-wobble", ("q1",), a=a, b=b)
    for q in angles:
        still, moved = (pose(arm, [q, 0.3, 0.2, 100], *t) for t in ((), (wobble,)))
        tilts.append(turn_between(still, moved))
    found = np.array(tilts)
    np.testing.assert_allclose(found[:, 2], 0, atol=1e-7)
    expected = (a + 1j * b) * np.exp(-1j * angles)
    circle = found[:, 0] + 1j * found[:, 1]
    np.testing.assert_allclose(circle / circle[0], expected / expected[0], atol=1e-3)
    np.testing.assert_allclose(np.abs(circle), np.hypot(a, b), rtol=1e-3)


def test_what_turns_with_the_joint_is_geometry_and_what_turns_against_it_is_not(
    machines: Machines,
) -> None:
    arm = machines["arm"]
    recording = simulated(arm, 60, seed=3)
    fit = estimate(arm, recording, [with_effect(arm, "axis-wobble", ("q1",))])
    std = fit.std[len(arm.parameters) :]
    assert np.all(std < 2e-5)
    still = effects.get("axis-wobble", "test")()
    assert not still.screened(replace(arm, mechanism=narrowed(arm)), ("q1",))


def narrowed(machine: Machine) -> Mechanism:
    actuators = tuple(replace(a, range=(-0.05, 0.05)) for a in machine.mechanism.actuators)
    return replace(machine.mechanism, actuators=actuators)


@pytest.mark.parametrize("s", [0.0, 120.0, 500.0])
def test_a_screw_gives_way_with_its_free_length(machines: Machines, s: float) -> None:
    arm, c = machines["arm"], 1e-7
    q = [0.3, 0.7, 0.2, s]
    still, moved = (pose(arm, q, *t) for t in ((), (with_effect(arm, "screw-windup", ("q4",), c=c),)))
    axis = still[:3, 2]  # the slide runs along z of its frame, which is the tool's
    force = 3 * G * np.array([0, 0, -1.0]) @ axis
    np.testing.assert_allclose(moved[:3, 3] - still[:3, 3], c * force * s * axis, atol=1e-7)


# -- flexure-shift, joint-runout -----------------------------------------------------------------------------

TILTED = [6.0, -9.0, 14.0, -3.0, -8.0, 11.0]


def test_nothing_moves_at_home_and_shifts_are_even_in_small_tilts(machines: Machines) -> None:
    machine = machines["flexed"]
    legs = tuple(f"leg{k}" for k in range(1, 7))
    terms = [with_effect(machine, "flexure-shift", legs, k=2.5)]
    terms += [with_effect(machine, "joint-runout", (f"leg2.{end}",), uu=5.0, uv=2.0, vv=-4.0) for end in "ab"]
    for term in terms:
        home = [pose(machine, np.zeros(6), *t) for t in ((), (term,))]
        np.testing.assert_allclose(home[1], home[0], atol=1e-9)
        off = []
        for sign in (1, -1):
            still, moved = (pose(machine, sign * 0.1 * np.array(TILTED), *t) for t in ((), (term,)))
            off.append(moved[:3, 3] - still[:3, 3])
        assert np.linalg.norm(off[0]) > 1e-7
        assert np.linalg.norm(off[0] - off[1]) < 0.1 * np.linalg.norm(off[0])


def test_the_shift_of_a_flexure_is_that_of_beam_theory(machines: Machines) -> None:
    """On ball joints, k = l / 12 at all legs does what the model of bent flexures does."""
    plain, bent = machines["flexed"], machines["bent"]
    legs = tuple(f"leg{k}" for k in range(1, 7))
    shifted = pose(plain, TILTED, with_effect(plain, "flexure-shift", legs, k=30 / 12))[:3, 3]
    start, exact = (pose(m, TILTED)[:3, 3] for m in (plain, bent))
    assert np.linalg.norm(exact - start) > 1e-3
    np.testing.assert_allclose(
        shifted - start, exact - start, atol=5e-3 * float(np.linalg.norm(exact - start))
    )


def crossed(folder: Path, centre: Array, e: float) -> Machine:
    """The delta robot with one cross drawn as two axes a distance ``e`` apart, the first at ``centre`` (3,) of its arm."""
    line = next(text for text in TEXTS["delta"].splitlines() if "name: u1a" in text)
    x, y, z = centre
    frame = f"xyz: [{x:.12f}, {y:.12f}, {z:.12f}], rpy: [0, -157, 0]"
    axes = [
        f"    - {{name: u1x, kind: revolute, parent: arm1, child: cross, {frame}, axis: [1, 0, 0]}}",
        f"    - {{name: u1y, kind: revolute, parent: cross, child: rod1a, xyz: [0, 0, {e}], axis: [0, 1, 0]}}",
    ]
    text = (
        TEXTS["delta"]
        .replace(line, "\n".join(axes))
        .replace("bodies: [ground,", "bodies: [ground, cross,", 1)
    )
    return machine_from(folder, HEAD.format(name="crossed") + text)


CENTRE = np.array([250.0, 40.0, 0.0])


def test_runout_is_a_cross_whose_second_axis_passes_the_first(machines: Machines, tmp_path: Path) -> None:
    """At the same place at home."""
    delta, e, q = machines["delta"], 2.0, [-0.2, 0.9, 0.5]
    home = np.array(delta.mechanism.home_directions["u1a"])
    back = e * np.array([0, home[1], home[2]]) / np.hypot(home[1], home[2])
    centre = CENTRE - Rotation.from_euler("y", -157, degrees=True).apply(back)
    runout = with_effect(delta, "joint-runout", ("u1a",), e=e)
    still, shifted, drawn = pose(delta, q), pose(delta, q, runout), pose(crossed(tmp_path, centre, e), q)
    assert np.linalg.norm(drawn[:3, 3] - still[:3, 3]) > 1e-3
    np.testing.assert_allclose(shifted, drawn, atol=1e-8)


@pytest.mark.parametrize("order", [-2.0, 3.0])
@pytest.mark.parametrize(("pin", "hinge"), [(1.0, "u1x"), (2.0, "u1y")])
def test_a_pin_of_a_cross_runs_out_like_the_hinge_that_it_is(
    machines: Machines, tmp_path: Path, pin: float, hinge: str, order: float
) -> None:
    delta, drawn, q = machines["delta"], crossed(tmp_path, CENTRE, 0.0), [-0.2, 0.9, 0.5]
    one = with_effect(delta, "joint-runout", ("u1a",), {"order": order, "pin": pin}, a=0.3, b=-0.2)
    other = with_effect(drawn, "joint-runout", (hinge,), {"order": order}, a=0.3, b=-0.2)
    assert np.linalg.norm(pose(delta, q, one)[:3, 3] - pose(delta, q)[:3, 3]) > 1e-2
    np.testing.assert_allclose(pose(delta, q, one), pose(drawn, q, other), atol=1e-8)


# -- truths recovered ----------------------------------------------------------------------------------------


def simulated(machine: Machine, n: int, *terms: PlacedEffect, seed: int, **columns: Array) -> Recording:
    """Readings of n poses, with noise: a walk of every joint within its range."""
    rng = np.random.default_rng(seed)
    data = {}
    for actuator in machine.mechanism.actuators:
        low, high = actuator.range or (-1.0, 1.0)
        unit = "rad" if actuator.unit == "rad" else "mm"
        data[f"{actuator.reading} [{unit}]"] = rng.uniform(low, high, n)
    return recorded(machine, pd.DataFrame(data | columns), *terms, seed=seed)


@dataclass(frozen=True)
class Truth:
    """An effect as it truly is, on a machine that shows it in n poses."""

    machine: str
    slug: str
    place: tuple[str, ...]
    values: Mapping[str, float]
    settings: Settings
    n: int = 60


LEG_NAMES = tuple(f"leg{k}" for k in range(1, 7))
WEIGHTS = {"w1": 0.05, "w2": 0.04, "w3": 0.03, "w4": 0.06}
TRUTHS = (
    Truth("arm", "link-bending", ("link2",), {"c": 2e-11}, {}),
    Truth("arm", "screw-windup", ("q4",), {"c": 3e-6}, {}, 120),
    Truth("arm", "axis-wobble", ("q1",), {"a": 2e-4, "b": -1e-4}, {}),
    Truth("flexed", "flexure-shift", LEG_NAMES, {"k": 2.5}, {}),
    Truth("hexapod", "joint-runout", ("leg2.a",), {"uu": 0.5, "uv": 0.2, "vv": -0.4}, {}),
    Truth("delta", "joint-runout", ("u1a",), {"e": 0.5}, {}, 80),
    Truth("stage", "friction-hysteresis", ("s1",), {"h": 2e-3}, {"width": 0.1}),
    Truth("stage", "piezo-hysteresis", ("s2",), WEIGHTS, {}, 150),
    Truth("stage", "piezo-creep", ("s1",), {"g": 0.015}, {"t0": 0.1}),
)


@pytest.mark.parametrize("truth", TRUTHS, ids=lambda t: f"{t.slug}-{t.machine}")
def test_a_fit_recovers_the_truth(machines: Machines, truth: Truth) -> None:
    """Within four of its own standard errors, which are smaller than a third of the truth."""
    machine, rng = machines[truth.machine], np.random.default_rng(8)
    true = with_effect(machine, truth.slug, truth.place, settings=truth.settings, **truth.values)
    time = np.cumsum(np.exp(rng.uniform(0, 7, truth.n)))
    recording = simulated(machine, truth.n, true, seed=11, time=time)
    (term,) = [true.with_values([0.0] * len(true.amplitudes))]
    fit = estimate(machine, recording, [term])
    (found,) = fit.fitted_effects()
    std = fit.std[len(machine.parameters) :][: len(true.amplitudes)]
    off = np.array(found.amplitudes) - true.amplitudes
    assert np.all(np.abs(off) < 4 * std)
    assert np.linalg.norm(std) < np.linalg.norm(true.amplitudes) / 3


def test_memory_stands_at_nothing_where_it_is_not_known(machines: Machines) -> None:
    """The controller's code without drivers, and a plan, see the plain joint."""
    stage = machines["stage"]
    terms = [
        with_effect(stage, "friction-hysteresis", ("s1",), settings={"width": 0.1}, h=5e-3),
        with_effect(stage, "piezo-hysteresis", ("s2",), settings={}, **WEIGHTS),
        with_effect(stage, "piezo-creep", ("s1",), g=0.02),
    ]
    np.testing.assert_allclose(pose(stage, [0.05, -0.08], *terms), pose(stage, [0.05, -0.08]), atol=1e-15)
