"""Generated C against the Python model: poses, inverses, Jacobians, parameters and drivers, compensation."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.generated_c import Built, build, built_of, cases, needs_compiler
from support.generated_machines import machine_of
from truepose.codegen.texts import identifiers

Array = NDArray[np.float64]
CLOSED = ("turns", "rails", "hybrid", "planar")


def differences(a: Array, b: Array) -> tuple[float, float]:
    """Position (mm) and rotation (rad) between two poses (12,)."""
    a, b = a.reshape(3, 4), b.reshape(3, 4)
    turn = Rotation.from_matrix(a[:, :3] @ b[:, :3].T).magnitude()
    return float(np.linalg.norm(a[:, 3] - b[:, 3])), float(turn)


def reach(built: Built) -> float:
    return float(max(np.linalg.norm(row[[-9, -5, -1]]) for row in built.samples(63)))


def tolerance(built: Built) -> tuple[float, float]:
    return (1e-6, 1e-9) if built.real == "double" else (max(2e-6 * reach(built), 2e-6 * 300), 2e-6)


@needs_compiler
@cases()
def test_forward_kinematics_is_the_models(built: Built) -> None:
    allowed = (1e-9, 1e-12) if built.real == "double" else tolerance(built)
    for row in built.samples():
        code, pose = built.fk(row[: built.n])
        assert code == 0
        expected = built.pose(row[: built.n])
        assert np.less(differences(pose, expected), allowed).all()
        np.testing.assert_allclose(row[built.n :], expected, rtol=0, atol=1e-9)


@needs_compiler
@cases()
def test_inverse_meets_the_pose_from_near_and_far(built: Built) -> None:
    rows = built.samples()
    for row, other in zip(rows, np.roll(rows, 1, axis=0), strict=True):
        pose = row[built.n :]
        for guess in (row[: built.n] + 0.01 * (other - row)[: built.n], other[: built.n]):
            code, q = built.ik(pose, guess)
            assert code == 0
            assert np.less(differences(built.pose(q), pose), tolerance(built)).all()
            for value, actuator in zip(q, built.machine.mechanism.actuators, strict=True):
                low, high = actuator.range or (-np.inf, np.inf)
                assert low - 1e-3 <= value <= high + 1e-3


@needs_compiler
@cases()
def test_jacobian_is_the_derivative_of_forward_kinematics(built: Built) -> None:
    row = built.samples()[3]
    code, flat = built.call("jac", row[: built.n], out=np.zeros(6 * built.n))
    assert code == 0
    jacobian = flat.reshape(6, built.n)
    for j in range(built.n):
        step = 1e-5 * np.eye(built.n)[j]
        ahead, behind = (built.pose(row[: built.n] + s).reshape(3, 4) for s in (step, -step))
        v = (ahead[:, 3] - behind[:, 3]) / 2e-5
        w = Rotation.from_matrix(ahead[:, :3] @ behind[:, :3].T).as_rotvec() / 2e-5
        relative = 1e-6 if built.real == "double" else 2e-4
        np.testing.assert_allclose(
            jacobian[:3, j], v, rtol=0, atol=relative * max(1.0, np.abs(v).max(), np.abs(jacobian[:3]).max())
        )
        np.testing.assert_allclose(jacobian[3:, j], w, rtol=0, atol=relative)


@needs_compiler
@cases(("arm",), ("double",))
def test_turning_joints_come_back_into_their_ranges(built: Built) -> None:
    row = built.samples()[2]
    guess = row[: built.n].copy()
    guess[2] += 2 * np.pi  # outside +-160 deg
    guess[5] += 6 * np.pi  # no range: stays near the guess
    code, q = built.ik(row[built.n :], guess)
    assert code == 0
    assert abs(q[2]) <= np.radians(160) + 1e-9
    assert abs(q[5] - guess[5]) < 4
    assert np.less(differences(built.pose(q), row[built.n :]), tolerance(built)).all()


@needs_compiler
@cases(("arm", "turns", "rails"))
def test_output_may_be_the_guess(built: Built) -> None:
    row = built.samples()[1]
    q = np.array(row[: built.n] * 0.99, dtype=built.dtype)
    pose = np.array(row[built.n :], dtype=built.dtype)
    pointer = q.ctypes.data_as(ctypes.c_void_p)
    name = built.machine.name
    separate = built.ik(row[built.n :], q)[1]
    assert (
        getattr(built.library, f"{name}_ik")(
            None, None, pose.ctypes.data_as(ctypes.c_void_p), pointer, pointer
        )
        == 0
    )
    np.testing.assert_array_equal(q.astype(float), separate)
    assert getattr(built.library, f"{name}_compensate")(None, None, pointer, pointer) == 0


@needs_compiler
@cases(("arm", "turns", "rails"), ("double",))
def test_parameters_and_drivers_are_read_at_run_time(built: Built) -> None:
    rng = np.random.default_rng(3)
    row, model = built.samples()[4], built.model
    p = model.p_home * (1 + 1e-3 * rng.standard_normal(len(model.p_home)))
    z = model.z_home + rng.uniform(0.1, 2.0, len(model.z_home))
    code, pose = built.fk(row[: built.n], p=p, z=z if len(z) else np.zeros(1))
    assert code == 0
    expected = built.pose(row[: built.n], p, z)
    assert differences(expected, row[built.n :])[0] > 0.05
    assert np.less(differences(pose, expected), (1e-9, 1e-12)).all()
    code, q = built.ik(expected, row[: built.n], p=p, z=z if len(z) else np.zeros(1))
    assert code == 0
    assert np.less(differences(built.pose(q, p, z), expected), (1e-6, 1e-9)).all()
    for k, name in enumerate(identifiers(model.names)):
        assert built.define(f"P_{name}") == k
    for k, name in enumerate(identifiers(model.drivers)):
        assert built.define(f"Z_{name}") == k


@needs_compiler
@cases(CLOSED, ("double",))
def test_forward_from_a_pose_nearby(built: Built) -> None:
    for row in built.samples(4):
        near = np.array(row[built.n :])
        near[[3, 7, 11]] += 4.0
        code, pose = built.call("fk_from", row[: built.n], near, out=np.zeros(12))
        assert code == 0
        assert np.less(differences(pose, row[built.n :]), (1e-9, 1e-12)).all()


@needs_compiler
@pytest.mark.parametrize("name", ["arm", "rails"])
def test_compensation_puts_the_real_tool_where_the_drawing_says(root_directory: Path, name: str) -> None:
    machine = machine_of(root_directory, name)
    built = build(root_directory, name, "double")
    values = {p.name: round(p.nominal, 0 if p.unit == "mm" else 2) for p in machine.mechanism.parameters}
    other = built_of(machine, root_directory / f"{name}_nominal", "double", nominal=values)
    row, model = built.samples()[5], built.model
    code, q = other.call("compensate", row[: built.n], out=np.zeros(built.n))
    assert code == 0
    geometry = machine.geometry
    drawing = [values.get(n, geometry[n].nominal if n in geometry else 0.0) for n in model.names]
    wanted = built.pose(row[: built.n], np.array(drawing))
    assert differences(wanted, row[built.n :])[0] > 0.05
    assert np.less(differences(built.pose(q), wanted), (1e-6, 1e-9)).all()
