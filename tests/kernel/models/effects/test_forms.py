"""Forms of effects that fit real parts: pins with lobes, wobbles of several orders, friction by elements, creep and gain."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.effects import Campaign, with_effect
from support.examples import examples
from support.simulated import machine_from
from support.telescope_legs import leg_rows
from support.tool_pose import HEAD, pose
from truepose.identification.recording.history import creep_sum, stop_operator
from truepose.models.effects.base import PlacedEffect, Shifts, Site, effects
from truepose.models.machine.machine import Machine
from truepose.models.machine.states import hinges

Named = Callable[[str], Machine]

Array = NDArray[np.float64]
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 150, range: [-90, 90]}
    - {name: q3, kind: revolute, alpha: -90, r: 700, range: [-170, 170]}
    - {name: q4, kind: revolute, alpha: 90, range: [-90, 90]}
frames: {tool: {in: flange, xyz: [300, 0, 40], tolerance: {xyz: 1, rpy: 1}}}
sensor: {type: pose, sigma: {xyz: 0.005, rot: 0.001}}
masses: {payload: {kg: 3, com: [0, 20, 10], in: tool}}
"""
SLIDE = """
mechanism:
  type: serial
  joints: [{name: s1, kind: prismatic, range: [-0.1, 0.1]}, {name: s2, kind: prismatic, range: [0, 200], screw_pitch: 5}]
sensor: {type: pose, sigma: {xyz: 0.0001, rot: 0.001}}
masses: {payload: {kg: 3, com: [0, 20, 10], in: tool}}
"""
ROBOT = """
mechanism:
  {type: 3ups-up-3r, base_radius: 300, platform_radius: 100, platform_offset: 50, wrist_offset: 100, head: 50,
   tool: 50, limb_range: [500, 900], wrist_range: [-90, 90]}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.01}}
"""
HEXAPOD = (
    "mechanism:\n  type: 6-pus\n  home: [0, 0, 440, 0, 0, 0]\n  legs:\n"
    + leg_rows("length: 500, range: [-60, 60]")
    + "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.01}}\nmasses: {head: {kg: 9, com: [0, 0, 50], in: tool}}\n"
)
SEEN = SLIDE.replace(
    "sensor: {type: pose, sigma: {xyz: 0.0001, rot: 0.001}}",
    "sensor: {type: targets, points: {P1: [0, 0, 0], P2: [50, 0, 0]}, sigma: {xyz: 0.01}}",
)


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Named:
    folder: Path = tmp_path_factory.mktemp("machines")
    texts = {"arm": ARM, "slide": SLIDE, "robot": ROBOT, "hexapod": HEXAPOD, "seen": SEEN}
    known = {name: machine_from(folder, HEAD.format(name=name) + text, name) for name, text in texts.items()}
    return known.__getitem__


def tilt(one: Array, two: Array) -> complex:
    turn = two[:3, :3] @ one[:3, :3].T
    return complex(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0]) / 2


class Marks(dict[str, ca.SX]):
    """A symbol for whatever is asked for."""

    def __missing__(self, name: str) -> ca.SX:
        return self.setdefault(name, ca.SX.sym(name))


def shifts(of: Machine, term: PlacedEffect) -> tuple[Shifts, Site]:
    nominal = {p.name: ca.SX(p.nominal) for p in of.parameters}
    c = {name: ca.SX(value) for name, value in term.values.items()}
    site = Site(of, term.place, term.settings_map, c, Marks(), Marks(), nominal, Marks(), Marks())
    return term.effect.shifts(site), site


# -- joint-runout ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("joint", ["u1a", "u2a", "u3b", "up1"])
@pytest.mark.parametrize("order", [-3, -1, 2, 8])
def test_a_pin_circles_across_itself_so_many_times_a_turn(machine: Named, joint: str, order: int) -> None:
    robot, a, b = machine("robot"), 0.03, -0.02
    hinge = next(h for h in hinges(robot) if h.name == joint)
    moved, site = shifts(
        robot, with_effect(robot, "joint-runout", (joint,), {"order": float(order)}, a=a, b=b)
    )
    names = [step.parameter for step in hinge.placement[:3]]
    assert list(moved) == names
    at = ca.Function("at", [site.turn(joint)], [ca.vertcat(*(moved[name] for name in names))])
    start, quarter = (np.array(at(t)).ravel() for t in (0.0, np.pi / 2 / order))
    held = {p.name: p.nominal for p in robot.parameters}
    turn = held[hinge.placement[3].parameter]  # about z: these brackets stand turned about it
    around = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    axis = around @ np.array(hinge.axis, dtype=float)
    for shift in (start, quarter):
        assert np.linalg.norm(shift) == pytest.approx(np.hypot(a, b))
        assert shift @ axis == pytest.approx(0.0, abs=1e-12)
    # a quarter of the circle later, right-handed about the pin
    np.testing.assert_allclose(quarter, np.cross(axis, start), atol=1e-9)


# -- axis-wobble ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("pair", "turns"), [("ab", -2), ("cd", 2)])
def test_a_wobble_of_second_order_circles_twice_a_turn(machine: Named, pair: str, turns: int) -> None:
    arm, size = machine("arm"), (3e-4, -2e-4)
    term = with_effect(
        arm, "axis-wobble", ("q1",), {"orders": 2.0}, **{f"{c}2": s for c, s in zip(pair, size, strict=True)}
    )
    angles = np.linspace(-2.5, 2.5, 7)
    circle = np.array(
        [tilt(pose(arm, [q, 0.3, 0.2, 0.1]), pose(arm, [q, 0.3, 0.2, 0.1], term)) for q in angles]
    )
    np.testing.assert_allclose(np.abs(circle), np.hypot(*size), rtol=1e-3)
    np.testing.assert_allclose(circle / circle[0], np.exp(1j * turns * (angles - angles[0])), atol=1e-3)


# -- what remembers ------------------------------------------------------------------------------------------

SIDES = st.sampled_from([-1.0, 1.0])


@given(
    way=st.lists(st.tuples(st.floats(-50, 50), SIDES), min_size=2, max_size=20),
    width=st.floats(0.5, 10),
    behind=st.floats(0.1, 30),
)
@settings(max_examples=examples(60), deadline=None)
def test_a_known_overshoot_is_a_way_through_its_turning_points(
    way: list[tuple[float, float]], width: float, behind: float
) -> None:
    readings, side = (np.array(v) for v in zip(*way, strict=True))
    piece = np.zeros(len(way), dtype=np.int64)
    rested = np.r_[False, (np.diff(readings) == 0) & (np.diff(side) == 0)]
    via = np.where(rested, readings, readings - side * behind)
    path = np.stack([via, readings], axis=1).ravel()
    whole = stop_operator(path, np.zeros(2 * len(way)), np.zeros(2 * len(way), dtype=np.int64), width)
    found = stop_operator(readings, side, piece, width, behind)
    np.testing.assert_allclose(found, whole[1::2], atol=1e-9)


def test_a_wait_ages_every_move_alike() -> None:
    time, way = np.array([0.0, 30.0, 70.0]), np.array([0.0, 2.0, 5.0])
    found = creep_sum(time, way, np.zeros(3, dtype=np.int64), 0.1, 3.0)
    np.testing.assert_allclose(found, [0, 2 * np.log10(31), 2 * np.log10(431) + 3 * np.log10(31)])


def test_a_gain_calibrated_late_leaves_what_is_still_to_creep(machine: Named) -> None:
    """``since`` takes the creep of so many seconds, in proportion to the reading, out of the gain."""
    slide = machine("slide")
    early, late = (
        shifts(
            slide, with_effect(slide, "piezo-creep", ("s1",), {"t0": 0.1, "dwell": 2.0, "since": t}, g=0.01)
        )
        for t in (0.0, 99.9)
    )
    values = []
    for found, site in (early, late):
        (driver,) = site.z.values()
        values.append(float(ca.Function("f", [driver, site.q["s1"]], [found["s1.displacement"]])(0.4, 0.07)))
    assert values[0] == pytest.approx(0.01 * 0.4)
    assert values[0] - values[1] == pytest.approx(0.01 * 3 * 0.07)


def test_elements_side_by_side_are_the_sum_of_single_ones(machine: Named) -> None:
    slide, friction = machine("slide"), effects.get("friction-hysteresis", "test")()
    found = [s for s in friction.settings(slide, ("s2",), Campaign()) if "elements" in s]
    assert len({s.get("overshoot") for s in found}) == len(found) > 1
    several = with_effect(
        slide, "friction-hysteresis", ("s2",), {"elements": 1.0}, h1=1e-3, h2=2e-3, h3=3e-3, h4=4e-3
    )
    total, site = shifts(slide, several)
    marks = [site.z[name] for name in several.drivers]
    leads = [0.1, -1.0, 3.0, 20.0]
    value = float(ca.Function("f", marks, [total["s2.displacement"]])(*leads))
    alone = 0.0
    for width, h, lead in zip((0.003, 0.01, 0.03, 0.1), (1e-3, 2e-3, 3e-3, 4e-3), leads, strict=True):
        term = with_effect(slide, "friction-hysteresis", ("s2",), {"width": width}, h=h)
        one, here = shifts(slide, term)
        alone += float(ca.Function("f", [here.z[term.drivers[0]]], [one["s2.displacement"]])(lead))
    assert value == pytest.approx(alone)


@pytest.mark.parametrize(("s", "share"), [(0.0, 0.0), (50.0, 0.25), (200.0, 1.0)])
def test_friction_of_a_nut_winds_the_free_part_of_its_screw_up(
    machine: Named, s: float, share: float
) -> None:
    slide = machine("slide")
    term = with_effect(slide, "screw-windup", ("s2",), {"friction": 1.0}, w=0.02)
    assert not term.needs_load
    found, site = shifts(slide, term)
    at = ca.Function("f", [site.q["s2"], site.z["approach.s2"]], [found["s2.displacement"]])
    assert [float(at(s, side)) for side in (1, -1)] == pytest.approx([-0.01 * share, 0.01 * share])


# -- platform-deformation, lens-distortion ----------------------------------------------------------------------


def test_under_load_a_platform_gives_way_at_i_by_j_as_at_j_by_i(machine: Named) -> None:
    hexapod = machine("hexapod")
    values = {f"C[{i},{j}]": 1e-5 * (7 * i + j) for i in range(1, 7) for j in range(i, 7)}
    term = with_effect(hexapod, "platform-deformation", ("platform",), {"form": 5.0}, **values)
    assert {c.name for c in term.coefficients} == set(values)
    assert [c.name for c in term.coefficients if c.lower == 0.0] == [f"C[{k},{k}]" for k in range(1, 7)]
    found, site = shifts(hexapod, term)
    loads = [site.loads[f"leg{k}.b.z"] for k in range(1, 7)]
    moved = ca.vertcat(*(found[f"leg{k}.b.z"] for k in range(1, 7)))
    C = np.array(ca.Function("C", loads, [ca.jacobian(moved, ca.vertcat(*loads))])(*np.ones(6)))
    assert C[1, 4] == pytest.approx(values["C[2,5]"])
    np.testing.assert_array_equal(C, C.T)


def test_a_decentred_lens_is_one_whose_axis_stands_aside(machine: Named) -> None:
    """p is minus k1 times how far aside: the derivative of radial distortion by its centre."""
    robot, k1, aside = machine("seen"), 1e-3, np.array([3e-6, -2e-6])
    p = -k1 * aside
    term = with_effect(
        robot,
        "lens-distortion",
        ("sensor",),
        {"terms": 1.0, "decentred": 1.0},
        p1=float(p[0]),
        p2=float(p[1]),
    )
    found, site = shifts(robot, term)
    ports = [port for port in found if port.startswith("P1.")]
    at = ca.Function("at", [site.states[f"seen.P1.{a}"] for a in "xyz"], [found[port] for port in ports])
    for point in ([300.0, -200.0, 1000.0], [0.0, 150.0, 900.0], [-80.0, 0.0, 700.0]):
        x = np.array(point[:2]) / point[2]
        one, two = x - aside, x + aside
        expected = point[2] * k1 * ((one @ one) * one - (two @ two) * two) / 2
        moved = np.array([float(v) for v in at(*point)])[:2]
        np.testing.assert_allclose(moved, expected, atol=1e-6 * float(np.linalg.norm(expected)))
