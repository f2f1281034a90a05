"""Laws of rotations and rigid motions: group axioms, exponential and logarithm, and their symbolic twins."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from support.examples import examples
from truepose.models import lie

Array = NDArray[np.float64]
LAWS = settings(deadline=None, max_examples=examples(40))
SMALLEST = 1e-3


def vectors(size: float) -> st.SearchStrategy[Array]:
    """Three components of at most ``size``, exact zeros among them."""
    one = st.floats(-size, size, allow_nan=False).map(lambda v: v if abs(v) > 1e-12 else 0.0)
    return st.tuples(one, one, one).map(np.array)


turns = vectors(1.7)  # rotation vectors shorter than pi
points = vectors(1000.0)


def poses() -> st.SearchStrategy[Array]:
    return st.tuples(turns, points).map(lambda pair: pose(*pair))


def pose(turn: Array, point: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = lie.exp_so3(turn), point
    return out


def numeric(expression: ca.SX, *pairs: tuple[ca.SX, Array]) -> Array:
    """Value of an expression where symbols have these values."""
    function = ca.Function("f", [symbol for symbol, _ in pairs], [expression])
    out: Array = function(*(ca.DM(value) for _, value in pairs)).full()
    return out


@LAWS
@given(poses(), poses(), poses())
def test_poses_are_a_group(a: Array, b: Array, c: Array) -> None:
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-9)
    np.testing.assert_allclose(a @ lie.inverse_pose(a), np.eye(4), atol=1e-9)
    np.testing.assert_allclose(lie.inverse_pose(a) @ a, np.eye(4), atol=1e-9)
    np.testing.assert_allclose(lie.inverse_pose(a @ b), lie.inverse_pose(b) @ lie.inverse_pose(a), atol=1e-9)
    np.testing.assert_allclose(lie.inverse_pose(lie.inverse_pose(a)), a, atol=1e-9)


@LAWS
@given(st.lists(poses(), min_size=1, max_size=4))
def test_batches_are_their_rows(rows: list[Array]) -> None:
    stack = np.array(rows)
    # products of stacks may add in another order: roundings of coordinates up to 1e3
    np.testing.assert_allclose(
        lie.inverse_pose(stack), [lie.inverse_pose(row) for row in rows], rtol=1e-14, atol=1e-12
    )
    logs = lie.log_so3(stack[:, :3, :3])
    np.testing.assert_allclose(logs, [lie.log_so3(row[:3, :3]) for row in rows], atol=1e-14)
    np.testing.assert_allclose(lie.exp_so3(logs[None])[0], stack[:, :3, :3], atol=1e-12)


@LAWS
@given(vectors(1.5))
def test_roll_pitch_yaw_round_trip(rpy: Array) -> None:
    rotation = lie.rpy_matrix(rpy)
    np.testing.assert_allclose(lie.rpy_of(rotation), rpy, atol=1e-9)
    about = Rotation.from_euler
    by_hand = about("z", rpy[2]) * about("y", rpy[1]) * about("x", rpy[0])
    np.testing.assert_allclose(rotation, by_hand.as_matrix(), atol=1e-13)


@LAWS
@given(points, vectors(1.5))
def test_symbolic_roll_pitch_yaw_is_the_numeric_one(xyz: Array, rpy: Array) -> None:
    x, r = ca.SX.sym("x", 3), ca.SX.sym("r", 3)
    found = numeric(lie.rpy_transform(ca.vertsplit(x), ca.vertsplit(r)), (x, xyz), (r, rpy))
    expected = np.eye(4)
    expected[:3, :3], expected[:3, 3] = lie.rpy_matrix(rpy), xyz
    np.testing.assert_allclose(found, expected, atol=1e-12)


@LAWS
@given(st.floats(-7, 7))
def test_elementary_rotations_turn_about_their_axis(angle: float) -> None:
    a, axis = ca.SX.sym("a"), ca.SX.sym("axis", 3)
    for k, turned in enumerate((lie.rot_x(a), lie.rot_y(a), lie.rot_z(a))):
        unit = np.eye(3)[k]
        expected = lie.exp_so3(angle * unit)
        found = numeric(turned, (a, np.array(angle)))
        np.testing.assert_allclose(found[:3, :3], expected, atol=1e-12)
        np.testing.assert_array_equal(found[3], [0, 0, 0, 1])
        general = numeric(lie.axis_rotation(axis, a), (axis, unit), (a, np.array(angle)))
        np.testing.assert_allclose(general, expected, atol=1e-12)


@LAWS
@given(vectors(1.0), st.floats(0, 1))
def test_symbolic_logarithm_is_smooth_through_the_identity(direction: Array, size: float) -> None:
    w = ca.SX.sym("w", 3)
    small = direction * size * SMALLEST
    log = lie.log_so3_sx(lie.mrp_rotation(w / 4))  # the turn w, to second order
    slope = numeric(ca.jacobian(log, w), (w, small))
    np.testing.assert_allclose(slope, np.eye(3), atol=SMALLEST**2)
    np.testing.assert_allclose(numeric(ca.jacobian(log, w), (w, np.zeros(3))), np.eye(3), atol=1e-12)


@LAWS
@given(points, points)
def test_skew_is_the_cross_product_and_vee_undoes_it(a: Array, b: Array) -> None:
    v, m = ca.SX.sym("v", 3), ca.SX.sym("m", 3, 3)
    matrix = numeric(lie.skew(v), (v, a))
    np.testing.assert_allclose(matrix @ b, np.cross(a, b), atol=1e-9)
    np.testing.assert_allclose(numeric(lie.vee(m), (m, matrix))[:, 0], a, atol=1e-12)


def _skew(w: Array) -> Array:
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def _left_jacobian(w: Array) -> Array:
    """How Exp(w) turns as w changes: Exp(w + dw) = Exp(J dw) Exp(w); the series of the exponential's average."""
    out, term = np.eye(3), np.eye(3)
    for k in range(1, 60):
        term = term @ _skew(w) / (k + 1)
        out = out + term
    return out


ANGLES = (0.0, 1e-12, 1e-9, 1e-7, 1e-4, 0.1, 1.0, 3.0, np.pi - 1e-3, np.pi - 1e-6, np.pi - 1e-9)


@pytest.fixture
def directions() -> Array:
    rng = np.random.default_rng(5)
    some = np.vstack([np.eye(3), -np.eye(3), rng.standard_normal((6, 3))])
    return np.asarray(some / np.linalg.norm(some, axis=1, keepdims=True))


@pytest.mark.parametrize("angle", ANGLES[:9])
def test_the_symbolic_logarithm_has_digits_to_near_half_a_turn(angle: float, directions: Array) -> None:
    """Sine and cosine of the angle are known to 1e-16: near pi the direction is known to that over the sine."""
    r = ca.SX.sym("r", 3, 3)
    log = ca.Function("log", [r], [lie.log_so3_sx(r)])
    for w in angle * directions:
        atol = 1e-15 + 1e-14 * angle / max(np.sin(angle), 1e-3)
        np.testing.assert_allclose(log(lie.exp_so3(w)).full()[:, 0], w, atol=atol)


@pytest.mark.parametrize("angle", [1e-8, 1e-3, 0.5, 2.0, 3.1])
def test_jacobians_of_the_group(angle: float, directions: Array) -> None:
    """Of the logarithm by a turn on the left, J^-1; of Rodrigues parameters and axis rotations by their own."""
    r, small, s, a = ca.SX.sym("r", 3, 3), ca.SX.sym("small", 3), ca.SX.sym("s", 3), ca.SX.sym("a")
    left = lie.log_so3_sx((ca.SX.eye(3) + lie.skew(small)) @ r)
    log = ca.Function("log", [small, r], [ca.jacobian(left, small)])
    turned = ca.Function("mrp", [s], [lie.mrp_rotation(s), ca.jacobian(ca.vec(lie.mrp_rotation(s)), s)])
    rolled = lie.axis_rotation(s, a)
    about = ca.Function("axis", [s, a], [rolled, ca.jacobian(ca.vec(rolled), a)])
    for direction in directions:
        w = angle * direction
        rotation, jacobian = lie.exp_so3(w), _left_jacobian(w)
        found = log(np.zeros(3), rotation).full()
        # near half a turn the logarithm's direction is known to rounding over the sine
        np.testing.assert_allclose(
            found, np.linalg.inv(jacobian), atol=1e-12 / np.sin(angle) ** 2 if angle > 1 else 1e-9
        )
        mrp, slopes = turned(np.tan(angle / 4) * direction)
        np.testing.assert_allclose(mrp.full(), rotation, atol=1e-14)
        # d w / d s of w = 4 atan(|s|) s / |s|
        size = np.tan(angle / 4)
        outer = np.outer(direction, direction)
        by_s = 4 / (1 + size**2) * outer + angle / size * (np.eye(3) - outer)
        spins = jacobian @ by_s
        for k in range(3):
            derivative = slopes.full()[:, k].reshape(3, 3).T
            np.testing.assert_allclose(derivative, _skew(spins[:, k]) @ rotation, atol=1e-12)
        turn, slope = about(direction, angle)
        np.testing.assert_allclose(turn.full(), rotation, atol=1e-14)
        np.testing.assert_allclose(slope.full().reshape(3, 3).T, _skew(direction) @ rotation, atol=1e-14)


@given(st.lists(st.floats(-1.0, 1.0), min_size=3, max_size=3), st.integers(-290, 290))
def test_a_direction_has_one_of_length_one_however_long_it_is(v: list[float], power: int) -> None:
    v = [0.0 if abs(x) < 1e-6 else x for x in v]
    if not any(v):
        assert lie.unit_vector(v).tolist() == [0.0, 0.0, 0.0]
        return
    found = lie.unit_vector([x * 10.0**power for x in v])
    np.testing.assert_allclose(found, np.array(v) / np.linalg.norm(v), rtol=1e-12)


@LAWS
@given(turns)
def test_logarithm_undoes_exponential(turn: Array) -> None:
    rotation = lie.exp_so3(turn)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(lie.log_so3(rotation), turn, atol=1e-9)
    np.testing.assert_allclose(lie.exp_so3(-turn), rotation.T, atol=1e-13)


@LAWS
@given(turns)
def test_a_logarithm_is_never_longer_than_half_a_turn(turn: Array) -> None:
    assert np.linalg.norm(lie.log_so3(lie.exp_so3(4 * turn))) <= np.pi + 1e-12


@LAWS
@given(vectors(2.0))
def test_modified_rodrigues_parameters(mrp: Array) -> None:
    s = ca.SX.sym("s", 3)
    found = numeric(lie.mrp_rotation(s), (s, mrp))
    np.testing.assert_allclose(found, Rotation.from_mrp(mrp).as_matrix(), atol=1e-12)


@LAWS
@given(turns)
def test_symbolic_logarithm_is_the_numeric_one(turn: Array) -> None:
    r = ca.SX.sym("r", 3, 3)
    rotation = lie.exp_so3(turn)
    np.testing.assert_allclose(
        numeric(lie.log_so3_sx(r), (r, rotation))[:, 0], lie.log_so3(rotation), atol=1e-9
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_exponential_and_logarithm_undo_each_other_everywhere(angle: float, directions: Array) -> None:
    w = angle * directions
    np.testing.assert_allclose(lie.log_so3(lie.exp_so3(w)), w, atol=1e-14 * max(1.0, angle))
    again = lie.exp_so3(lie.log_so3(lie.exp_so3(w)))
    np.testing.assert_allclose(again, lie.exp_so3(w), atol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_the_exponential_is_the_groups(angle: float, directions: Array) -> None:
    """Exp(w) = expm(w x), and as its own adjoint: Exp(R w) = R Exp(w) R', Ad(Exp w) = exp(ad w)."""
    turn = lie.exp_so3(np.array([0.4, -1.1, 0.7]))
    for w in angle * directions:
        rotation = lie.exp_so3(w)
        np.testing.assert_allclose(rotation, expm(_skew(w)), atol=1e-14)
        np.testing.assert_allclose(lie.exp_so3(turn @ w), turn @ rotation @ turn.T, atol=1e-14)
        np.testing.assert_allclose(
            rotation @ _skew(directions[0]) @ rotation.T, _skew(rotation @ directions[0]), atol=1e-14
        )


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1.0, 3.0])
def test_twists_are_carried_by_the_adjoint(angle: float, directions: Array) -> None:
    """Ad(exp X) = exp(ad X) in SE(3), twists [v; w]; and Ad carries twists as the pose carries points."""
    for w, v in zip(angle * directions, 3.0 * directions[::-1], strict=True):
        motion = np.zeros((4, 4))
        motion[:3, :3], motion[:3, 3] = _skew(w), v
        pose = expm(motion)
        np.testing.assert_allclose(pose[:3, :3], lie.exp_so3(w), atol=1e-14)
        np.testing.assert_allclose(pose[:3, 3], _left_jacobian(w) @ v, atol=1e-13)
        small = np.block([[_skew(w), _skew(v)], [np.zeros((3, 3)), _skew(w)]])
        rotation, shift = pose[:3, :3], _skew(pose[:3, 3])
        adjoint = np.block([[rotation, shift @ rotation], [np.zeros((3, 3)), rotation]])
        np.testing.assert_allclose(expm(small), adjoint, atol=1e-13)
        carried = pose @ motion @ lie.inverse_pose(pose)  # a twist stays itself along its own screw
        np.testing.assert_allclose(carried, motion, atol=1e-12)
