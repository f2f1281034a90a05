"""Closed expressions against SymPy's derivation, the printed matrices of the nanopositioner paper among them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
import sympy as sp  # type: ignore[import-untyped]
from numpy.typing import NDArray

from support.telescope_legs import UNEVEN, leg_rows
from truepose.models import lie
from truepose.models.load import load_machine
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


HEAD = "schema: truepose/machine/1\nname: m\ntolerances: {length: 0.2, angle: 0.1}\n"


POSE = "sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}\n"


CAVITY = """
sensor: {type: distance, beam: {xyz: [1, 900, 3], rx: 91, rz: 4}, mirror: {in: tool, z: 2, rx: 3, ry: -4},
  sigma: {distance: 0.001}}
"""


PUS = "mechanism:\n  type: 6-pus\n  home: [0, 0, 440, 0, 0, 5]\n  legs:\n" + leg_rows(
    "u: [0.1, -0.05, 1], length: 500", UNEVEN
)


def written(folder: Path, text: str) -> Machine:
    path = folder / "m.yaml"
    path.write_text(HEAD + text)
    return load_machine(path)


def drawn(machine: Machine, rng: np.random.Generator) -> Array:
    """Parameters two tolerances off their drawing."""
    sigma = np.array([p.tolerance for p in machine.parameters])
    return np.array([p.nominal for p in machine.parameters]) + 2.0 * sigma * rng.uniform(-1, 1, len(sigma))


def _turn(axis: int, angle: Any) -> Any:
    plain = {0: sp.rot_ccw_axis1, 1: sp.rot_ccw_axis2, 2: sp.rot_ccw_axis3}[axis](angle)
    return sp.Matrix(sp.BlockDiagMatrix(plain, sp.eye(1)))


def _shift(x: Any, y: Any, z: Any) -> Any:
    out = sp.eye(4)
    out[0, 3], out[1, 3], out[2, 3] = x, y, z
    return out


def hayati(beta: Any, alpha: Any, d: Any, theta: Any, r: Any) -> Any:
    """Equation 4 of the nanopositioner paper."""
    return _turn(1, beta) * _turn(0, alpha) * _shift(d, 0, 0) * _turn(2, theta) * _shift(0, 0, r)


CONSTANTS = sp.symbols("beta alpha d theta r")


def printed() -> Any:
    """Matrix 10 of the nanopositioner paper as it is printed."""
    beta, alpha, d, theta, r = CONSTANTS
    cb, sb, ca_, sa = sp.cos(beta), sp.sin(beta), sp.cos(alpha), sp.sin(alpha)
    ct, st = sp.cos(theta), sp.sin(theta)
    return sp.Matrix(
        [
            [cb * ct + sa * sb * st, sa * sb * ct - cb * st, ca_ * sb, d * cb + r * ca_ * sb],
            [ca_ * st, ca_ * ct, -sa, -r * sa],
            [sa * cb * st - sb * ct, sb * ct + sa * cb * st, ca_ * cb, r * ca_ * cb - d * sb],
            [0, 0, 0, 1],
        ]
    )


def test_matrix_10_of_the_paper_is_wrong_in_one_entry() -> None:
    """C12 has sine and cosine of theta interchanged; as printed the matrix is no rotation."""
    beta, alpha, _, theta, _ = CONSTANTS
    off = sp.simplify(hayati(*CONSTANTS) - printed())
    wrong = [(i, j) for i in range(4) for j in range(4) if off[i, j] != 0]
    assert wrong == [(2, 1)]
    right = sp.sin(beta) * sp.sin(theta) + sp.sin(alpha) * sp.cos(beta) * sp.cos(theta)
    assert sp.simplify(hayati(*CONSTANTS)[2, 1] - right) == 0
    some = dict(zip(CONSTANTS, (0.1, 0.2, 3, 0.4, 5), strict=True))
    as_printed = np.array(printed()[:3, :3].subs(some), dtype=float)
    derived = np.array(hayati(*CONSTANTS)[:3, :3].subs(some), dtype=float)
    np.testing.assert_allclose(derived @ derived.T, np.eye(3), atol=1e-15)
    assert np.abs(as_printed @ as_printed.T - np.eye(3)).max() > 0.02


def test_one_of_the_papers_special_transforms_is_wrong_too() -> None:
    """With the constants of its Table I; the first entry of the transform from link 4 to 5 is a sine."""
    q = sp.symbols("q")
    c, s, quarter = sp.cos(q), sp.sin(q), sp.pi / 2
    slide = sp.Matrix([[0, 1, 0, 0], [0, 0, 1, q], [1, 0, 0, 0], [0, 0, 0, 1]])
    as_printed = {
        "1T2, 2T3": (hayati(0, -quarter, 0, -quarter, q), slide),
        "4T5": (
            hayati(0, -quarter, 0, q - quarter, 0),
            sp.Matrix([[c, c, 0, 0], [0, 0, 1, 0], [c, -s, 0, 0], [0, 0, 0, 1]]),
        ),
        "5T6": (
            hayati(0, -quarter, 0, q, 0),
            sp.Matrix([[c, -s, 0, 0], [0, 0, 1, 0], [-s, -c, 0, 0], [0, 0, 0, 1]]),
        ),
    }
    wrong = {
        name: [(i, j) for i in range(4) for j in range(4) if sp.simplify(right[i, j] - found[i, j]) != 0]
        for name, (right, found) in as_printed.items()
    }
    assert wrong == {"1T2, 2T3": [], "4T5": [(0, 0)], "5T6": []}
    assert sp.simplify(as_printed["4T5"][0][0, 0] - s) == 0


def test_the_extrinsic_transforms_of_the_paper_are_right() -> None:
    """Equations 13 and 14."""
    b, t, x, y, z = sp.symbols("b t x y z")
    cb, sb, ct, st = sp.cos(b), sp.sin(b), sp.cos(t), sp.sin(t)
    fibre = sp.Matrix([[ct, -st, 0, x], [cb * st, ct * cb, -sb, y], [sb * st, ct * sb, cb, z], [0, 0, 0, 1]])
    mirror = sp.Matrix([[ct, 0, st, 0], [st * sb, cb, -ct * sb, 0], [-cb * st, sb, ct * cb, z], [0, 0, 0, 1]])
    assert sp.simplify(_shift(x, y, z) * _turn(0, b) * _turn(2, t) - fibre) == sp.zeros(4)
    assert sp.simplify(_shift(0, 0, z) * _turn(0, b) * _turn(1, t) - mirror) == sp.zeros(4)


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_one_joint_and_its_derivatives(tmp_path: Path, kind: str) -> None:
    machine = written(tmp_path, f"mechanism: {{type: serial, joints: [{{name: q, kind: {kind}}}]}}\n" + POSE)
    model, q = symbolic_model(machine), sp.symbols("q")
    beta, alpha, d, theta, r = CONSTANTS
    moved = (
        hayati(beta, alpha, d, theta + q, r) if kind == "revolute" else hayati(beta, alpha, d, theta, r + q)
    )
    symbols = (*CONSTANTS, q)
    expected = sp.lambdify(symbols, [sp.Matrix(moved.T.reshape(16, 1)).jacobian(symbols), moved])
    rng = np.random.default_rng(1)
    own, turn = ca.vertcat(model.p[:5], model.q), ca.vec(model.pose)
    found = ca.Function("f", [model.p, model.q], [ca.densify(ca.jacobian(turn, own)), model.pose])
    for _ in range(5):
        at = rng.uniform(-2, 2, 6)
        slopes, value = expected(*at)
        p = np.append(at[:5], np.zeros(model.p.numel() - 5))
        jacobian, pose = (out.full() for out in found(p, at[5]))
        np.testing.assert_allclose(pose, value, atol=1e-14)
        np.testing.assert_allclose(jacobian, slopes, atol=1e-14)


@pytest.mark.parametrize("joints", [2, 3])
def test_a_planar_arm_by_every_constant_and_reading(tmp_path: Path, joints: int) -> None:
    """Position and rotation of a 2R and a 3R arm, by SymPy from the product of its rows."""
    lengths = (0.0, 300.0, 200.0)[:joints]
    rows = "".join(f"    - {{name: q{k}, kind: revolute, d: {d}}}\n" for k, d in enumerate(lengths, start=1))
    machine = written(tmp_path, f"mechanism:\n  type: serial\n  joints:\n{rows}" + POSE)
    constants = [sp.symbols(f"beta{k} alpha{k} d{k} theta{k} r{k}") for k in range(joints)]
    q = sp.symbols(f"q0:{joints}")
    pose = sp.eye(4)
    for (beta, alpha, d, theta, r), angle in zip(constants, q, strict=True):
        pose = pose * hayati(beta, alpha, d, theta + angle, r)
    symbols = [s for row in constants for s in row]
    entries = sp.Matrix(pose[:3, :].T.reshape(12, 1))
    slopes = sp.lambdify([*symbols, *q], entries.jacobian([*symbols, *q]), cse=True)
    model = symbolic_model(machine)
    assert list(model.names[: 5 * joints]) == [
        f"q{k + 1}.{name}" for k in range(joints) for name in ("beta", "alpha", "d", "theta", "r")
    ]
    own = ca.vertcat(model.p[: 5 * joints], model.q)
    found = ca.Function("f", [model.p, model.q], [ca.densify(ca.jacobian(ca.vec(model.pose[:3, :]), own))])
    rng = np.random.default_rng(2)
    p = model.p_home.copy()
    p[: 5 * joints] += rng.uniform(-0.3, 0.3, 5 * joints)
    angles = rng.uniform(-2, 2, joints)
    expected = np.array(slopes(*p[: 5 * joints], *angles), dtype=float)
    np.testing.assert_allclose(found(p, angles).full(), expected, atol=1e-12 * np.abs(expected).max())


def test_a_rods_equation_and_its_derivatives(tmp_path: Path) -> None:
    """Leg 1 of the 6-PUS: (|upper - lower|^2 - l^2)/2l by pose, ends, rail, length, offset and gain."""
    machine = written(tmp_path, PUS + POSE)
    model = symbolic_model(machine)
    names = [n for n in model.names if n.startswith("leg1.")]
    c = {name: sp.Symbol(name.replace(".", "_")) for name in names}
    x, q = sp.symbols("x0:6"), sp.Symbol("q")
    s = sp.Matrix(x[3:])
    square, cross = s.dot(s), sp.Matrix([[0, -x[5], x[4]], [x[5], 0, -x[3]], [-x[4], x[3], 0]])
    turn = sp.eye(3) + (4 * (1 - square) * cross + 8 * cross * cross) / (1 + square) ** 2
    upper = sp.Matrix(x[:3]) + turn * sp.Matrix([c[f"leg1.b.{a}"] for a in "xyz"])
    ux, uy = c["leg1.u.x"], c["leg1.u.y"]
    rail = sp.Matrix([ux, uy, sp.sqrt(1 - ux**2 - uy**2)])
    slide = c["leg1.offset"] + c["leg1.gain"] * q
    span = upper - sp.Matrix([c[f"leg1.a.{a}"] for a in "xyz"]) - slide * rail
    length = c["leg1.length"]
    gap = (span.dot(span) - length**2) / (2 * length)
    symbols = [*x, *c.values(), q]
    expected = sp.lambdify(symbols, [gap, sp.Matrix([gap]).jacobian(symbols)], cse=True)
    own = ca.vertcat(model.x, *(model.p[model.names.index(n)] for n in names), model.q[0])
    function = ca.Function(
        "f", [model.x, model.p, model.q], [model.closure[0], ca.densify(ca.jacobian(model.closure[0], own))]
    )
    rng = np.random.default_rng(3)
    for _ in range(5):
        at = model.home + rng.uniform(-1, 1, 6) * [30, 30, 30, 0.1, 0.1, 0.1]
        p = drawn(machine, rng)
        readings_ = rng.uniform(-20, 20, 6)
        value, slopes = function(at, p, readings_)
        own_p = [p[model.names.index(n)] for n in names]
        wanted, gradient = expected(*at, *own_p, readings_[0])
        assert float(value) == pytest.approx(float(wanted), rel=1e-12, abs=1e-10)
        np.testing.assert_allclose(slopes.full(), np.array(gradient, dtype=float), rtol=1e-11, atol=1e-12)


def test_a_cavitys_length_and_its_derivatives(tmp_path: Path) -> None:
    """From the intersection of a line and a plane, by a small twist of the tool and every constant."""
    machine = written(tmp_path, "mechanism: {type: serial, joints: [{name: q, kind: revolute}]}\n" + CAVITY)
    (sensor,) = machine.sensors
    own = [p.name for p in sensor.parameters]
    s = {name: sp.Symbol(name.replace(".", "_")) for name in own}
    v, w = sp.symbols("v0:3"), sp.symbols("w0:3")
    rng = np.random.default_rng(4)
    turn, at = lie.exp_so3(rng.uniform(-1, 1, 3) * 0.3), np.array([20.0, 500.0, -30.0])
    turn = turn @ lie.exp_so3(np.array([-np.pi / 2, 0, 0]))  # the mirror faces the beam
    skew = sp.Matrix([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    world = sp.eye(4)
    world[:3, :3], world[:3, 3] = (sp.eye(3) + skew) * sp.Matrix(turn), sp.Matrix(at) + sp.Matrix(v)
    light = (_turn(0, s["beam.rx"]) * _turn(2, s["beam.rz"]))[:3, 2]
    source = sp.Matrix([s["beam.x"], s["beam.y"], s["beam.z"]])
    mirror = world * _shift(0, 0, s["mirror.z"]) * _turn(0, s["mirror.rx"]) * _turn(1, s["mirror.ry"])
    normal = mirror[:3, 2]
    length = normal.dot(mirror[:3, 3] - source) / normal.dot(light)
    symbols = [*v, *w, *s.values()]
    expected = sp.lambdify(symbols, [length, sp.Matrix([length]).jacobian(symbols)])
    small, c = ca.SX.sym("small", 6), ca.SX.sym("c", len(own))
    moved = lie.transform((ca.SX.eye(3) + lie.skew(small[3:])) @ ca.DM(turn), ca.DM(at) + small[:3])
    value = sensor.predict(moved, dict(zip(own, ca.vertsplit(c), strict=True)))
    found = ca.Function("f", [small, c], [value, ca.densify(ca.jacobian(value, ca.vertcat(small, c)))])
    constants = np.array([p.nominal for p in sensor.parameters]) + rng.uniform(-0.05, 0.05, len(own))
    wanted, gradient = expected(*np.zeros(6), *constants)
    length_, slopes = found(np.zeros(6), constants)
    assert float(length_) == pytest.approx(float(wanted), rel=1e-13)
    np.testing.assert_allclose(slopes.full(), np.array(gradient, dtype=float), rtol=1e-11, atol=1e-11)


SMALL = (1e-2, 1e-4, 1e-6, 1e-8)


def _twists(names: Sequence[str], values: Mapping[str, float]) -> Array:
    """(6, k) twists of link 3 in the frame of link 1 by constants of joints 2 and 3, at link 3's origin."""
    before = dict(zip(CONSTANTS, sp.symbols("beta2 alpha2 d2 theta2 r2"), strict=True))
    after = dict(zip(CONSTANTS, sp.symbols("beta3 alpha3 d3 theta3 r3"), strict=True))
    pose = hayati(*before.values()) * hayati(*after.values())
    at = {sp.Symbol(name): values.get(name, 0.0) for name in map(str, [*before.values(), *after.values()])}
    value = np.array(pose.subs(at), dtype=float)
    columns = []
    for name in names:
        slope = np.array(pose.diff(sp.Symbol(name)).subs(at), dtype=float)
        spin = slope[:3, :3] @ value[:3, :3].T
        size = 300.0 if name[0] in "dr" else 1.0  # a length and an angle that matter alike
        columns.append(size * np.array([*slope[:3, 3] / 300.0, spin[2, 1], spin[0, 2], spin[1, 0]]))
    return np.array(columns).T


@pytest.mark.parametrize("tilt", SMALL)
def test_nearly_parallel_axes_are_described_without_loss(tilt: float) -> None:
    """With beta the map to the relative pose keeps its rank as the axes become parallel; without, it loses it."""
    at = {"d3": 300.0, "alpha3": tilt, "theta2": 0.3, "theta3": 0.5, "r3": 20.0}
    classic = ("theta2", "r2", "alpha3", "d3", "theta3", "r3")
    with_beta = ("theta2", "beta3", "alpha3", "d3", "theta3", "r3")
    assert np.linalg.svd(_twists(with_beta, at), compute_uv=False)[-1] > 0.1
    lost = np.linalg.svd(_twists(classic, at), compute_uv=False)[-1]
    assert lost < tilt


@pytest.mark.parametrize("tilt", SMALL)
def test_a_tilt_is_a_small_change_with_beta_and_a_jump_without(tilt: float) -> None:
    """The second of two parallel axes 300 mm apart leans by a tilt about y, towards the first axis."""
    axis, point = np.array([np.sin(tilt), 0.0, np.cos(tilt)]), np.array([300.0, 0.0, 0.0])
    # Hayati: beta is the tilt, d reaches the axis along the turned x, everything else stays
    along = 300.0 * np.sin(tilt)  # the common point of axis and turned x axis is that far down the axis
    pose = np.array(hayati(tilt, 0, 300.0 * np.cos(tilt), 0, along), dtype=float)
    np.testing.assert_allclose(pose[:3, 2], axis, atol=1e-15)
    np.testing.assert_allclose(pose[:3, 3], point, atol=1e-12)
    assert max(tilt, 300.0 * (1 - np.cos(tilt)), along) <= 300.0 * tilt
    # classic: the common normal of the two axes decides. They meet, so that d jumps from 300 to nothing, the
    # normal is y, a quarter turn from x, and the point where they meet runs off to infinity
    normal = np.cross([0.0, 0.0, 1.0], axis) / np.sin(tilt)
    distance = abs(float(normal @ point))
    meeting = float(np.linalg.lstsq(np.column_stack([[0.0, 0.0, 1.0], -axis]), point, rcond=None)[0][0])
    assert distance < 1e-12
    assert abs(normal[1]) == pytest.approx(1.0)
    assert abs(meeting) == pytest.approx(300.0 / np.tan(tilt), rel=1e-6)
