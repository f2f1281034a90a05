"""Laws of what generated C is made from: the drawn arm, the order of pivots, natural units, samples."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.graph_machines import machine_of, model_of
from support.six_joint_arms import ARMS, BUILT, DRAWN, GENERAL
from truepose.codegen import layout, reference
from truepose.codegen.chain import ChainExpressions, pivot_order
from truepose.codegen.layout import layout_of
from truepose.codegen.leaves.all_solutions import solutions
from truepose.codegen.leaves.all_solutions.solutions import branches_of
from truepose.codegen.loops import Equations
from truepose.codegen.printer import Real
from truepose.codegen.reference import Reference
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.velocities import chain_of

Array = NDArray[np.float64]
LOOPED = ("planar", "delta", "hybrid", "pus", "ups")
TURNING = (True,) * 6


# -- arms ----------------------------------------------------------------------------------------------


@cache
def arm(name: str) -> tuple[SymbolicModel, ChainExpressions]:
    with TemporaryDirectory() as folder:
        model = symbolic_model(ARMS[name].machine(Path(folder)))
    chain = chain_of(model)
    assert chain is not None
    return model, ChainExpressions.of(model, chain)


@pytest.mark.parametrize("name", [*DRAWN, *BUILT])
def test_the_drawn_arm_is_the_arm_next_to_it(name: str) -> None:
    """Exactly where it was built as drawn; else with axes within 0.05 rad and a meeting point within 2 % of the reach."""
    frames = ARMS[name].frames(np.zeros((1, 6)))[0]
    reach = 1500.0
    found = branches_of(*arm(name), reach, TURNING)
    assert found is not None
    alike = [1, 2] if found.kind == "wrist" else [1, 2, 3]
    last = [3, 4, 5] if found.kind == "wrist" else [4, 5]
    angle, distance = (1e-9, 1e-6) if name in DRAWN else (0.05, 0.02 * reach)
    np.testing.assert_allclose(np.linalg.norm(found.axes, axis=1), 1.0, atol=1e-12)
    assert np.linalg.norm(np.cross(found.axes, frames[:6, :, 2]), axis=1).max() <= angle
    assert (np.sum(found.axes * frames[:6, :, 2], axis=1) > 0.9).all()
    np.testing.assert_allclose(found.axes[alike], found.signs[: len(alike), None] * found.common, atol=1e-12)
    assert set(found.signs.tolist()) <= {-1.0, 1.0} and found.signs[0] == 1.0  # along the second axis
    off = np.linalg.norm(np.cross(found.points - frames[:6, :, 3], frames[:6, :, 2]), axis=1)
    assert off.max() <= distance
    np.testing.assert_array_equal(found.points[last], np.tile(found.meeting, (len(last), 1)))
    np.testing.assert_allclose(found.tool, frames[6], atol=1e-9)
    across = found.axes[5] if found.kind == "wrist" else found.common
    assert found.side @ across == pytest.approx(0.0, abs=1e-12) and np.linalg.norm(
        found.side
    ) == pytest.approx(1.0)


@pytest.mark.parametrize("name", GENERAL)
def test_no_drawn_arm_is_next_to_a_general_one(name: str) -> None:
    assert branches_of(*arm(name), 1500.0, TURNING) is None


def test_an_arm_with_a_joint_that_does_not_repeat_after_a_turn_has_no_closed_form() -> None:
    for k in range(6):
        assert branches_of(*arm("ur"), 1500.0, (*TURNING[:k], False, *TURNING[k + 1 :])) is None


@pytest.mark.parametrize("kind", ["wrist", "parallel"])
def test_parallel_axes_may_point_either_way(kind: Literal["wrist", "parallel"]) -> None:
    """An axis turned round, with its reading, is the same line: only its sign changes."""
    alike = branches_of(*arm("puma" if kind == "wrist" else "ur"), 1500.0, TURNING)
    assert alike is not None and alike.kind == kind
    for turned in range(1, 3 if kind == "wrist" else 4):
        axes = alike.axes * np.where(np.arange(6) == turned, -1.0, 1.0)[:, None]
        found = solutions.drawn_branches(kind, axes, alike.points, alike.tool, 1500.0)
        assert found is not None
        np.testing.assert_allclose(found.axes, axes, atol=1e-12)
        np.testing.assert_allclose(found.points, alike.points, atol=1e-8)
        np.testing.assert_allclose(found.common, axes[1], atol=1e-12)
        np.testing.assert_allclose(found.signs[:2], np.sign(axes[1:3] @ axes[1]))


def test_axes_that_are_not_parallel_or_do_not_meet_make_no_closed_form() -> None:
    """0.05 rad from their common direction, and a fiftieth of the reach."""
    alike = branches_of(*arm("ur"), 1500.0, TURNING)
    assert alike is not None
    for tilt, near in ((0.04, True), (0.06, False)):
        axes = alike.axes.copy()
        side = np.cross(alike.common, alike.side)
        # two of three to either side: the common direction stays
        axes[1], axes[2] = axes[1] + np.tan(tilt) * side, axes[2] - np.tan(tilt) * side
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        assert (
            solutions.drawn_branches("parallel", axes, alike.points, alike.tool, 1500.0) is not None
        ) is near
    across = np.cross(alike.axes[4], alike.axes[5])
    for apart, near in ((0.039, True), (0.041, False)):  # the point lies in the middle between two lines
        points = alike.points.copy()
        points[4] += apart * 1500.0 * across / np.linalg.norm(across)
        assert (
            solutions.drawn_branches("parallel", alike.axes, points, alike.tool, 1500.0) is not None
        ) is near


def test_lines_meet_where_least_squares_puts_the_point() -> None:
    rng = np.random.default_rng(4)
    axes = rng.normal(size=(3, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    place = np.array([30.0, -20.0, 10.0])
    point, distance = solutions.meeting_point(axes, place + 7.0 * axes)
    np.testing.assert_allclose(point, place, atol=1e-9)
    assert distance < 1e-9
    points = place + rng.normal(size=(3, 3))

    def away(at: Array) -> Array:
        return np.asarray(np.linalg.norm(np.cross(at - points, axes), axis=1))

    point, distance = solutions.meeting_point(axes, points)
    assert distance == pytest.approx(away(point).max())
    for step in 1e-3 * rng.normal(size=(20, 3)):
        assert np.sum(away(point + step) ** 2) > np.sum(away(point) ** 2)


@pytest.mark.parametrize("name", ["ur", "puma", "general"])
def test_pivots_are_taken_where_elimination_leaves_the_most(name: str) -> None:
    """Against Schur complements of the arm's own Jacobians: the largest in the geometric mean over the samples."""
    q, reach = ARMS[name].readings(40, seed=3), 700.0
    order = pivot_order(*arm(name), q, reach)
    assert sorted(order) == list(range(6))
    J = ARMS[name].jacobians(q) * np.repeat([1.0, reach], 3)[:, None]
    for k in range(6):
        used = order[:k]
        left = J[:, :, k].copy()
        if k:
            inner = np.linalg.solve(J[:, used, :k], J[:, used, k, None])
            left -= (J[:, :, :k] @ inner)[:, :, 0]
        rest = [row for row in range(6) if row not in used]
        with np.errstate(divide="ignore"):
            size = {row: float(np.log(np.abs(left[:, row])).clip(-30.0).mean()) for row in rest}
        if all(np.abs(J[:, order[j], j]).min() > 1e-6 for j in range(k)) or k == 0:
            assert size[order[k]] >= max(size.values()) - 1e-5


@pytest.mark.parametrize(("real", "share"), [("double", 1e-7), ("float", 1e-3)])
def test_a_pivot_is_trusted_down_to_a_share_of_its_typical_size_in_every_unit(
    real: Real, share: float
) -> None:
    """At the only sample every pivot has its typical size: its inverse is that share of the largest sound one."""
    rng, n = np.random.default_rng(8), 5
    matrix, symbols = rng.standard_normal((n, n)), ca.SX.sym("J", n, n)
    units: list[Array] = [np.ones((2, n)), 10.0 ** rng.integers(-4, 5, (2, n)).astype(float)]
    orders = []
    for rows, columns in units:
        told = matrix / rows[:, None] / columns
        found = Equations.of(symbols, told[None], (rows, columns), real)
        assert found is not None
        inverses = ca.Function("inverses", [symbols], [found.factors.values[:n]])(told)
        np.testing.assert_allclose(np.abs(np.array(inverses)[:, 0]) / found.largest, share, rtol=0.006)
        orders.append(found.factors.pivots.order)
    assert orders[0] == orders[1]


# -- natural units -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LOOPED)
def test_an_unknowns_unit_moves_what_is_a_reach_away_by_a_millimetre(name: str) -> None:
    """To first order: slides by themselves, turns at the reach, modified Rodrigues parameters by their rotation."""
    model, reach = model_of(name), 650.0
    mechanism = model.machine.mechanism
    units = layout.natural_units(model, reach)
    assert len(units) == len(model.readings) + len(model.home)
    for actuator, unit in zip(mechanism.actuators, units, strict=False):
        gain = model.machine.geometry[actuator.gain].nominal if actuator.gain else 1.0
        assert abs(gain) * unit * (reach if actuator.unit == "rad" else 1.0) == pytest.approx(1.0)
    rest, small = list(units[len(model.readings) :]), 1e-3
    for joint in mechanism.unknown:
        slides = {"prismatic": 1, "free": 3}.get(joint.kind, 0)
        turned = {"revolute": 1, "universal": 2}.get(joint.kind, 0)
        mrp = 3 if joint.kind in ("spherical", "free") else 0
        assert [rest.pop(0) for _ in range(slides)] == [1.0] * slides
        for _ in range(turned):
            assert rest.pop(0) * reach == pytest.approx(1.0)
        for k in range(mrp):
            axis = np.eye(3)[k] * rest.pop(0) * small
            moved = reach * Rotation.from_mrp(axis).magnitude()
            assert moved == pytest.approx(small, rel=1e-4)
    assert not rest


@pytest.mark.parametrize("name", ["ur", "planar", "pus"])
@pytest.mark.parametrize("real", ["double", "float"])
def test_numbers_of_the_solver_are_those_of_the_machine(name: str, real: Real) -> None:
    model = arm(name)[0] if name in ARMS else model_of(name)
    numbers = layout_of(model, real)
    actuators = model.machine.mechanism.actuators
    longest = max(abs(p.nominal) for p in model.machine.mechanism.parameters if p.unit == "mm")
    far = max(float(np.linalg.norm(pose[:3, 3])) for _, pose in numbers.vectors)
    assert numbers.reach == pytest.approx(max(longest, far), rel=1e-5) and len(numbers.vectors) == 64
    # ranges are widened by what a solved pose may be off; what has none is unlimited
    for k, a in enumerate(actuators):
        tolerance = numbers.rotation if a.unit == "rad" else numbers.position
        if a.range is None:
            assert numbers.low[k] < -1e29 and numbers.high[k] > 1e29
        else:
            assert a.range[0] - numbers.low[k] == pytest.approx(tolerance, rel=1e-3)
            assert numbers.high[k] - a.range[1] == pytest.approx(tolerance, rel=1e-3)
            assert numbers.start[k] == pytest.approx(np.mean(a.range))
            assert numbers.width[k] == pytest.approx(
                min(a.range[1] - a.range[0], 2 * np.pi if a.unit == "rad" else np.inf)
            )
        assert numbers.turns[k] is (a.unit == "rad")
    if real == "float":
        assert numbers.position == numbers.rotation * numbers.reach == 2e-6 * numbers.reach
    else:
        assert (numbers.position, numbers.rotation) == (1e-6, 1e-9)
    assert numbers.closure <= numbers.share * numbers.position and 0 < numbers.tight < numbers.share < 1
    rows = 6 + model.closure.numel()
    assert numbers.weight.tolist() == [1.0] * 3 + [numbers.reach] * 3 + [1.0] * (rows - 6)
    assert len(numbers.bounded) == len(numbers.unknown) and set(numbers.bounded) <= {1, 2}
    # lengths are 1 mm and angles less than that wherever the machine is longer
    assert [b == 1 for b in numbers.bounded] == [u == 1.0 for u in numbers.unknown]


# -- samples -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LOOPED)
def test_readings_at_home_close_the_loops_there(name: str) -> None:
    model = model_of(name)
    close = Reference(model)
    q = close.home_readings(model.q_home + 1e-3)
    gap = ca.Function("gap", [model.q, model.z, model.p, model.x], [model.closure])
    here = np.array(gap(q, model.z_home, model.p_home, model.home))[:, 0]
    assert np.abs(here).max() < 1e-7
    assert np.abs(np.array(gap(model.q_home + 1e-3, model.z_home, model.p_home, model.home))).max() > 1e-4
    passive = close.passive(q)
    assert passive is not None
    np.testing.assert_allclose(passive, model.home, atol=1e-6)


def test_readings_at_home_are_found_for_each_leg_however_near_the_others_are() -> None:
    """The legs of a hexapod close on their own: where one starts says nothing of another."""
    model = model_of("pus")
    close = Reference(model)
    q = close.home_readings(model.q_home)
    for k in range(len(q)):
        start = q.copy()
        start[k] += 20.0
        np.testing.assert_allclose(close.home_readings(start), q, atol=1e-7)


@pytest.mark.parametrize("name", ["planar", "pus"])
def test_samples_lie_within_their_box_and_their_loops_can_be_followed(name: str) -> None:
    model = model_of(name)
    near, half = (
        model.q_home,
        np.array([0.2 if a.unit == "rad" else 1.0 for a in machine_of(name).mechanism.actuators]),
    )
    close = Reference(model)
    found = list(close.samples(near - half, near + half, near, 12))
    assert len(found) == 12
    for q, pose in found:
        assert (np.abs(q - near) <= half + 1e-12).all()
        direct = close.forward(q)
        assert direct is not None
        np.testing.assert_allclose(pose, direct, atol=1e-9)
        np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    assert close.forward(near + 1e4) is None


def test_points_fill_the_cube_evenly() -> None:
    """The middle first; along every axis gaps are those of a Kronecker sequence, at most a few times 1 / n."""
    for size, count in ((1, 50), (6, 200)):
        points = np.array(list(reference.spread(size, count)))
        assert points.shape == (count, size) and (points[0] == 0.5).all()
        assert ((points >= 0.0) & (points < 1.0)).all()
        gaps = np.diff(np.sort(np.vstack([np.zeros(size), points, np.ones(size)]), axis=0), axis=0)
        assert gaps.max() < 6.0 / count
    slopes = reference.slopes_of(8)
    whole = np.round((slopes + np.floor(np.sqrt([2, 3, 5, 7, 11, 13, 17, 19]))) ** 2, 9)
    assert whole.tolist() == [2, 3, 5, 7, 11, 13, 17, 19]
