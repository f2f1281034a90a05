"""Generated C: compiled with every warning an error, run through ctypes, held against the Python model."""

from __future__ import annotations

import csv
import ctypes
import re
import shutil
import subprocess
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from truepose.codegen.c import generate
from truepose.codegen.names import identifiers
from truepose.codegen.printer import Real
from truepose.errors import InputError
from truepose.models.kinematics import SymbolicModel, symbolic_model
from truepose.models.load import load_machine
from truepose.models.machine import Machine
from truepose.models.mechanism import Actuator, Joint, Mechanism, Step
from truepose.models.parameters import Parameter

Array = NDArray[np.float64]
COMPILER = shutil.which("gcc") or shutil.which("cc")
WARNINGS = [
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Werror",
]
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler found")

HEAD = "schema: truepose/machine/1\nname: {name}\ngravity: [0, 0, -9.80665]\nmechanism:\n"
ARM = """  type: serial
  joints:
    - {name: q1, kind: revolute, beta: 0.03, alpha: 0.1, d: 0.4, theta: 0.2, r: 128.1, range: [-360, 360]}
    - {name: q2, kind: revolute, beta: -0.05, alpha: 90.1, d: 0.6, theta: -0.1, r: 0.3, range: [-360, 360]}
    - {name: q3, kind: revolute, beta: 0.07, alpha: 0.05, d: -612.7, theta: 0.3, r: -0.2, range: [-160, 160]}
    - {name: q4, kind: revolute, beta: 0.1, alpha: -0.08, d: -571.9, theta: 0.2, r: 163.2, range: [-360, 360]}
    - {name: q5, kind: revolute, beta: -0.02, alpha: 89.8, d: 0.3, theta: 0.15, r: 115.2, range: [-360, 360]}
    - {name: q6, kind: revolute, beta: 0.04, alpha: -90.2, d: -0.5, theta: 0.4, r: 92.7}
frames: {tool: {in: flange, xyz: [12, -7, 93], rpy: [3, -5, 20]}}
masses:
  link2: {kg: 12.0, com: [-300, 0, 0], in: link2}
  payload: {kg: 2.0, com: [0, 12, 60], in: tool}
drivers: [payload, temperature.link3]
effects:
  - {effect: actuator-scale, place: [q4], parameters: {s: {value: 8.0e-4, unit: "1"}}}
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 2.1e-6, unit: rad/(N*m)}}}
  - {effect: thermal-expansion, place: [link3], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
"""
NANO = """  type: serial
  joints:
    - {name: q1, kind: prismatic, alpha: -90.2, theta: 0.1, range: [-0.15, 0.15]}
    - {name: q2, kind: prismatic, alpha: 90.1, theta: 90.05, d: 0.3, range: [-0.15, 0.15]}
    - {name: q3, kind: prismatic, alpha: 90, theta: -0.2, r: 5.1, range: [-0.15, 0.15]}
    - {name: q4, kind: revolute, alpha: -90.1, theta: -90, d: 0.2, range: [-3, 3]}
    - {name: q5, kind: revolute, alpha: -90, theta: 90.2, r: 0.3, range: [-3, 3]}
    - {name: q6, kind: revolute, alpha: 90.1, d: -0.1, r: 1.7, range: [-3, 3]}
frames: {tool: {in: flange, xyz: [0, 1, 20], rpy: [0, 0, 5]}}
"""
TURNS = """  type: 6-ups
  legs:
    - {name: leg1, joint: n1, a: [-385.3, -140.2, 0.4],
       b: [-197.4, 95.0, 0.1], offset: 640.2, gain: 75.7}
    - {name: leg2, joint: n2, a: [-314.1, -263.5, 0],
       b: [-16.4, -218.5, 0], offset: 639.8, gain: 71.2}
    - {name: leg3, joint: n3, a: [314.1, -263.5, -0.3],
       b: [16.4, -218.5, 0], offset: 640.2, gain: 72.3}
    - {name: leg4, joint: n4, a: [385.3, -140.2, 0],
       b: [197.4, 95.0, -0.2], offset: 641.1, gain: 70.8}
    - {name: leg5, joint: n5, a: [71.2, 403.8, 0],
       b: [181.0, 123.5, 0], offset: 640.2, gain: 70.6, range: [-1.5, 1.5]}
    - {name: leg6, joint: n6, a: [-71.2, 403.8, 0.2],
       b: [-181.0, 123.5, 0], offset: 640.3, gain: 71.3}
  home: [0, 0, 565, 0, 0, 0]
units: {joint: turn}
frames: {tool: {in: flange, xyz: [10, 0, 80], rpy: [0, 4, 0]}}
"""
RAILS = """  type: 6-pus
  legs:
    - {name: leg1, joint: rho1, a: [391.3, -83.2, 0.1],
       u: [0.01, 0, 1], b: [173.7, -179.8, 0], length: 500.1, range: [-20, 20]}
    - {name: leg2, joint: rho2, a: [391.3, 83.2, 0],
       u: [0, 0.02, 1], b: [173.7, 179.8, 0.2], length: 499.9, range: [-20, 20]}
    - {name: leg3, joint: rho3, a: [-123.6, 380.4, 0],
       u: [0, 0, 1], b: [68.9, 240.3, 0], length: 500.2, range: [-20, 20]}
    - {name: leg4, joint: rho4, a: [-267.7, 297.3, -0.2],
       u: [0, 0, 1], b: [-242.6, 60.5, 0], length: 500, range: [-20, 20]}
    - {name: leg5, joint: rho5, a: [-267.7, -297.3, 0],
       u: [0, 0.01, 1], b: [-242.6, -60.5, 0.1], length: 499.7, range: [-20, 20]}
    - {name: leg6, joint: rho6, a: [-123.6, -380.4, 0],
       u: [0, 0, 1], b: [68.9, -240.3, 0], length: 500, range: [-20, 20]}
  home: [0, 0, 439.7, 0, 0, 0]
frames: {tool: {in: flange, xyz: [0, 5, 120], rpy: [1, 0, 30]}}
masses: {payload: {kg: 30, com: [20, 0, 90], in: platform}}
drivers: [payload, approach.rho4]
effects:
  - {effect: leg-compliance, place: [leg3], parameters: {c: {value: 2.0e-4, unit: mm/N}}}
  - {effect: backlash, place: [rho4], parameters: {b: {value: 0.02, unit: mm}}}
"""
FOUR_AXES = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, d: 325, range: [-140, 140]}
    - {name: q3, kind: prismatic, alpha: 0.1, d: 275, range: [-200, 0]}
    - {name: q4, kind: revolute, alpha: 179.9}
"""
SEVEN_AXES = """  type: serial
  joints:
    - {name: q1, kind: revolute, r: 333, range: [-166, 166]}
    - {name: q2, kind: revolute, alpha: -90, range: [-101, 101]}
    - {name: q3, kind: revolute, alpha: 90, r: 316, range: [-166, 166]}
    - {name: q4, kind: revolute, alpha: 90, d: 82.5, range: [-176, -4]}
    - {name: q5, kind: revolute, alpha: -90, d: -82.5, r: 384, range: [-166, 166]}
    - {name: q6, kind: revolute, alpha: 90, range: [-1, 215]}
    - {name: q7, kind: revolute, alpha: 90, d: 88, r: 107, range: [-166, 166]}
"""
HYBRID = """  {type: 3ups-up-3r, base_radius: 340, platform_radius: 165, platform_offset: 127.5, wrist_offset: 120,
    head: 90, limb_range: [600, 880], wrist_range: [-60, 60], screw_pitch: 5}
drivers: [temperature.leg2]
effects:
  - {effect: actuator-scale, place: [leg3], parameters: {s: {value: 8.0e-4, unit: "1"}}}
  - {effect: thermal-expansion, place: [leg2], parameters: {alpha: {value: 1.2e-5, unit: 1/K}}}
"""
PLANAR = """  type: graph
  bodies: [ground, crank1, crank2, crank3, rod1, rod2, rod3, corner1, corner2, corner3, platform]
  joints:
    - {name: a1, kind: revolute, parent: ground, child: crank1, xyz: [-141, -255, 0], actuated: true, range: [15, 45]}
    - {name: b1, kind: revolute, parent: crank1, child: rod1, xyz: [100, 0, 0.2], rpy: [0.1, 0, 0]}
    - {name: p1, kind: revolute, parent: rod1, child: corner1, xyz: [150, 0, 0]}
    - {name: mount1, kind: fixed, parent: corner1, child: platform, xyz: [130, 75, 0]}
    - {name: a2, kind: revolute, parent: ground, child: crank2, xyz: [291, 5, 0], actuated: true, range: [136, 166]}
    - {name: b2, kind: revolute, parent: crank2, child: rod2, xyz: [103, 0, 0]}
    - {name: mount2, kind: fixed, parent: platform, child: corner2, xyz: [130, -74, 0]}
    - {name: p2, kind: revolute, parent: rod2, child: corner2, xyz: [147, 0, 0]}
    - {name: a3, kind: revolute, parent: ground, child: crank3, xyz: [-150, 250, 0.1], actuated: true, range: [-106, -76]}
    - {name: b3, kind: revolute, parent: crank3, child: rod3, xyz: [98, 0, 0]}
    - {name: mount3, kind: fixed, parent: platform, child: corner3, xyz: [1, 150, 0]}
    - {name: p3, kind: revolute, parent: rod3, child: corner3, xyz: [152, 0, 0], rpy: [0, 0.05, 0]}
  home: {a1: 30, a2: 151, a3: -91, b1: 90, b2: 90, b3: 90, p1: -120}
frames: {tool: {in: flange, xyz: [10, 5, 30], rpy: [0, 0, 20]}}
"""
BODIES = {
    "arm": ARM,
    "nano": NANO,
    "turns": TURNS,
    "rails": RAILS,
    "scara": FOUR_AXES,
    "redundant": SEVEN_AXES,
    "hybrid": HYBRID,
    "planar": PLANAR,
}
CASES: list[tuple[str, Real]] = [(name, real) for real in ("double", "float") for name in BODIES]
CLOSED = ("turns", "rails", "hybrid", "planar")


@dataclass(frozen=True)
class Built:
    """A machine's C, compiled and loaded, beside its model."""

    machine: Machine
    model: SymbolicModel
    real: Real
    directory: Path
    library: ctypes.CDLL

    @property
    def dtype(self) -> type[np.floating]:
        return np.float64 if self.real == "double" else np.float32

    @property
    def n(self) -> int:
        return len(self.model.readings)

    def define(self, name: str) -> int:
        header = (self.directory / f"{self.machine.name}_kin.h").read_text()
        found = re.search(rf"#define {self.machine.name}_{name} (\d+)", header)
        assert found, name
        return int(found.group(1))

    def call(
        self, function: str, *inputs: Array, out: Array, p: Array | None = None, z: Array | None = None
    ) -> tuple[int, Array]:
        """Return code and output, which starts as a copy of ``out``."""
        arguments = [
            None if a is None else np.ascontiguousarray(a, dtype=self.dtype) for a in (p, z, *inputs)
        ]
        result = np.array(out, dtype=self.dtype)
        pointers = [None if a is None else a.ctypes.data_as(ctypes.c_void_p) for a in (*arguments, result)]
        code = getattr(self.library, f"{self.machine.name}_{function}")(*pointers)
        return int(code), result.astype(float)

    def fk(self, q: Array, p: Array | None = None, z: Array | None = None) -> tuple[int, Array]:
        return self.call("fk", q, out=np.full(12, -7.0), p=p, z=z)

    def ik(
        self, pose: Array, guess: Array, p: Array | None = None, z: Array | None = None
    ) -> tuple[int, Array]:
        return self.call("ik", pose, guess, out=np.full(self.n, -7.0), p=p, z=z)

    def samples(self, count: int = 8) -> Array:
        text = (self.directory / "test_vectors.csv").read_text()
        rows = list(csv.reader(text.splitlines()))[1:]
        return np.array([[float(v) for v in row] for row in rows[1 : count + 1]])


@pytest.fixture(scope="module")
def root_directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("codegen")


@cache
def build(where: Path, name: str, real: Real) -> Built:
    assert COMPILER is not None
    machine = machine_of(where, name)
    directory = where / f"{name}_{real}"
    generate(machine, directory, real)
    arguments = [
        COMPILER,
        *WARNINGS,
        "-O1",
        "-shared",
        "-fPIC",
        f"{name}_kin.c",
        "-lm",
        "-o",
        f"lib{name}.so",
    ]
    subprocess.run(arguments, cwd=directory, check=True)
    library = ctypes.CDLL(str(directory / f"lib{name}.so"))
    return Built(machine, symbolic_model(machine, machine.effects), real, directory, library)


def machine_of(where: Path, name: str) -> Machine:
    file = where / f"{name}.yaml"
    file.write_text(HEAD.format(name=name) + BODIES[name])
    return load_machine(file)


@pytest.fixture
def built(root_directory: Path, request: pytest.FixtureRequest) -> Built:
    return build(root_directory, *request.param)


def cases(
    names: tuple[str, ...] = tuple(BODIES), reals: tuple[str, ...] = ("double", "float")
) -> pytest.MarkDecorator:
    chosen = [case for case in CASES if case[0] in names and case[1] in reals]
    return pytest.mark.parametrize("built", chosen, indirect=True, ids=["-".join(c) for c in chosen])


def python_pose(model: SymbolicModel, q: Array, p: Array | None = None, z: Array | None = None) -> Array:
    """Pose (12,) from the expressions themselves, loops closed by scipy."""
    p, z = model.p_home if p is None else p, model.z_home if z is None else z
    inputs = [model.q, model.z, model.p, model.x]
    closure = ca.Function("g", inputs, [model.closure, ca.jacobian(model.closure, model.x)])
    x = model.home
    if len(x):

        def residual(v: Array) -> Array:
            return np.array(closure(q, z, p, v)[0]).ravel()

        def derivative(v: Array) -> Array:
            return np.array(closure(q, z, p, v)[1])

        x = root(residual, x, jac=derivative, tol=1e-13).x
    pose: Array = np.array(ca.Function("pose", inputs, [ca.densify(model.pose)])(q, z, p, x))
    return pose[:3].ravel()


def differences(a: Array, b: Array) -> tuple[float, float]:
    """Position (mm) and rotation (rad) between two poses (12,)."""
    a, b = a.reshape(3, 4), b.reshape(3, 4)
    turn = Rotation.from_matrix(a[:, :3] @ b[:, :3].T).magnitude()
    return float(np.linalg.norm(a[:, 3] - b[:, 3])), float(turn)


def reach(built: Built) -> float:
    return float(max(np.linalg.norm(row[[-9, -5, -1]]) for row in built.samples(64)))


def tolerance(built: Built) -> tuple[float, float]:
    return (1e-6, 1e-9) if built.real == "double" else (max(2e-6 * reach(built), 2e-6 * 300), 2e-6)


@needs_compiler
@cases()
def test_forward_kinematics_is_the_models(built: Built) -> None:
    allowed = (1e-9, 1e-12) if built.real == "double" else tolerance(built)
    for row in built.samples():
        code, pose = built.fk(row[: built.n])
        assert code == 0
        expected = python_pose(built.model, row[: built.n])
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
            assert np.less(differences(python_pose(built.model, q), pose), tolerance(built)).all()
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
        ahead, behind = (python_pose(built.model, row[: built.n] + s).reshape(3, 4) for s in (step, -step))
        v = (ahead[:, 3] - behind[:, 3]) / 2e-5
        w = Rotation.from_matrix(ahead[:, :3] @ behind[:, :3].T).as_rotvec() / 2e-5
        relative = 1e-6 if built.real == "double" else 2e-4
        np.testing.assert_allclose(
            jacobian[:3, j], v, rtol=0, atol=relative * max(1.0, np.abs(v).max(), np.abs(jacobian[:3]).max())
        )
        np.testing.assert_allclose(jacobian[3:, j], w, rtol=0, atol=relative)


@needs_compiler
@cases()
def test_outputs_stay_as_they_were_on_bad_input(built: Built) -> None:
    row = built.samples()[0]
    q, pose = row[: built.n], row[built.n :]
    sentinel = np.arange(20.0)
    for place in range(built.n):
        for bad in (np.nan, np.inf):
            wrong = q.copy()
            wrong[place] = bad
            for function, inputs, size in (
                ("fk", (wrong,), 12),
                ("ik", (pose, wrong), built.n),
                ("compensate", (wrong,), built.n),
            ):
                code, out = built.call(function, *inputs, out=sentinel[:size])
                assert code == 4
                np.testing.assert_array_equal(out, sentinel[:size])
    skewed, mirrored, nan = pose.copy(), pose.copy(), pose.copy()
    skewed[0] += 1e-3
    mirrored[[0, 4, 8]] *= -1
    nan[3] = np.nan
    for wrong in (skewed, mirrored, nan):
        for function, inputs, size in (("ik", (wrong, q), built.n), ("fk_from", (q, wrong), 12)):
            code, out = built.call(function, *inputs, out=sentinel[:size])
            assert code == 4
            np.testing.assert_array_equal(out, sentinel[:size])
    p = built.model.p_home.copy()
    p[0] = np.nan
    assert built.fk(q, p=p)[0] == 4
    code, out = built.call(
        "jac", q, out=np.full(6 * built.n, -7.0), z=np.full(max(1, len(built.model.drivers)), np.nan)
    )
    assert code == 4
    assert (out == -7.0).all()


@needs_compiler
@cases(("arm", "nano", "rails", "scara", "redundant"))
def test_a_far_pose_is_refused(built: Built) -> None:
    row = built.samples()[0]
    pose = row[built.n :].copy()
    pose[[3, 7]] += 5000.0
    code, q = built.ik(pose, row[: built.n])
    # slides without end would reach it
    assert code == (3 if built.machine.name == "nano" else 1)
    assert (q == -7.0).all()


@needs_compiler
@cases(("nano", "rails", "turns"))
def test_joint_ranges_hold(built: Built) -> None:
    row = built.samples()[0]
    pose = row[built.n :].copy()
    pose[11] += 1.0 if built.machine.name == "nano" else 150.0
    code, q = built.ik(pose, row[: built.n])
    assert code == 3
    assert (q == -7.0).all()


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
    assert np.less(differences(python_pose(built.model, q), row[built.n :]), tolerance(built)).all()


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
    expected = python_pose(model, row[: built.n], p, z)
    assert differences(expected, row[built.n :])[0] > 0.05
    assert np.less(differences(pose, expected), (1e-9, 1e-12)).all()
    code, q = built.ik(expected, row[: built.n], p=p, z=z if len(z) else np.zeros(1))
    assert code == 0
    assert np.less(differences(python_pose(model, q, p, z), expected), (1e-6, 1e-9)).all()
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


def four_bar() -> Machine:
    """A planar loop in space: five closure equations too many for what moves."""
    lengths = {"crank.length": 40.0, "coupler.length": 120.0, "frame.length": 100.0, "rocker.length": 110.0}
    crank, coupler, frame, rocker = ((Step("tx", name),) for name in lengths)
    joints = (
        Joint("crank", "revolute", "base", "b1"),
        Joint("knee", "revolute", "b1", "b2", crank, home=(0.9,)),
        Joint("pivot", "revolute", "base", "b3", frame, home=(1.6,)),
        Joint("end", "revolute", "b3", "b4", rocker, home=(0.5,)),
        Joint("weld", "fixed", "b2", "b4", coupler),
    )
    parameters = tuple(Parameter(name, "mm", value, 0.1) for name, value in lengths.items())
    turn = Actuator("crank", "crank", "rad", "rad", range=(-2.5, 2.5))
    axes = {"x": "mm", "y": "mm", "z": "mm", "rx": "rad", "ry": "rad", "rz": "rad"}
    frames = tuple(Parameter(f"{f}.{a}", unit, 0.0) for f in ("base", "tool") for a, unit in axes.items())
    return Machine("fourbar", Mechanism(parameters, joints, (turn,), "b2"), frames, ())


@needs_compiler
@pytest.mark.parametrize("real", ["double", "float"])
def test_a_loop_with_more_equations_than_unknowns(tmp_path: Path, real: Real) -> None:
    generate(four_bar(), tmp_path, real)
    assert COMPILER is not None
    arguments = [COMPILER, *WARNINGS, "-O1", "example.c", "fourbar_kin.c", "-lm", "-o", "example"]
    subprocess.run(arguments, cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "example"], check=True, capture_output=True)


@needs_compiler
def test_loops_that_cannot_close_are_reported(root_directory: Path) -> None:
    built = build(root_directory, "turns", "double")
    q = np.array([6.0, -6.0, 6.0, -6.0, 6.0, -6.0])
    for code, out in (built.fk(q), built.call("jac", q, out=np.full(36, -7.0))):
        assert code in (1, 2)
        assert (out == -7.0).all()


@needs_compiler
@pytest.mark.parametrize("name", ["arm", "rails"])
def test_compensation_puts_the_real_tool_where_the_drawing_says(root_directory: Path, name: str) -> None:
    machine = machine_of(root_directory, name)
    built = build(root_directory, name, "double")
    values = {p.name: round(p.nominal, 0 if p.unit == "mm" else 2) for p in machine.mechanism.parameters}
    directory = root_directory / f"{name}_nominal"
    generate(machine, directory, nominal=values)
    assert COMPILER is not None
    subprocess.run(
        [COMPILER, *WARNINGS, "-shared", "-fPIC", f"{name}_kin.c", "-lm", "-o", "lib.so"],
        cwd=directory,
        check=True,
    )
    other = replace(built, library=ctypes.CDLL(str(directory / "lib.so")))
    row, model = built.samples()[5], built.model
    code, q = other.call("compensate", row[: built.n], out=np.zeros(built.n))
    assert code == 0
    geometry = machine.geometry
    drawing = [values.get(n, geometry[n].nominal if n in geometry else 0.0) for n in model.names]
    wanted = python_pose(model, row[: built.n], np.array(drawing))
    assert differences(wanted, row[built.n :])[0] > 0.05
    assert np.less(differences(python_pose(model, q), wanted), (1e-6, 1e-9)).all()


@needs_compiler
@cases(("arm", "turns"))
def test_example_runs_clean_under_sanitizers(built: Built) -> None:
    assert COMPILER is not None
    flags = [*WARNINGS, "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
    made = subprocess.run(
        [COMPILER, *flags, "example.c", f"{built.machine.name}_kin.c", "-lm", "-o", "example"],
        cwd=built.directory,
        capture_output=True,
        text=True,
        check=False,
    )
    if "cannot find" in made.stderr:
        pytest.skip("the compiler has no sanitizers")
    assert made.returncode == 0, made.stderr
    ran = subprocess.run([built.directory / "example"], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert ran.stderr == ""


def test_the_same_bytes_from_the_same_input(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "rails")
    first, second = (generate(machine_of(tmp_path, "rails"), tmp_path / part, "float") for part in ("a", "b"))
    assert [f.name for f in first] == [
        "rails_kin.h",
        "rails_kin.c",
        "example.c",
        "CMakeLists.txt",
        "README.md",
        "test_vectors.csv",
    ]
    for one, other in zip(first, second, strict=True):
        assert one.read_bytes() == other.read_bytes()
    assert not list(tmp_path.glob(".*"))
    texts = [(tmp_path / "b" / f.name).read_bytes() for f in first]
    (tmp_path / "a" / "mine.c").write_text("kept")
    generate(machine, tmp_path / "a", "double")
    assert [f.read_bytes() == text for f, text in zip(first, texts, strict=True)] == [
        False,
        False,
        False,
        True,
        False,
        True,
    ]
    assert (tmp_path / "a" / "mine.c").read_text() == "kept"


def test_nothing_but_math_is_needed(tmp_path: Path) -> None:
    files = generate(machine_of(tmp_path, "arm"), tmp_path / "out")
    code = next(f for f in files if f.name == "arm_kin.c").read_text()
    assert re.findall(r"#include (\S+)", code) == ['"arm_kin.h"', "<math.h>"]
    for word in ("malloc", "static real", "truepose 0"):
        assert not re.search(rf"\b{word} \w+ ?[;=]", code)


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        ("", "empty"),
        ("_arm", "underscore"),
        ("6axis", "begins with '6'"),
        ("my-arm", "contains '-'"),
        ("arm 2", "contains ' '"),
        ("bräs", "contains 'ä'"),
        ("double", "keyword"),
        ("a" * 64, "64 characters"),
    ],
)
def test_a_name_that_is_no_identifier_is_refused(tmp_path: Path, name: str, rule: str) -> None:
    machine = replace(machine_of(tmp_path, "nano"), name=name)
    with pytest.raises(InputError, match=rule):
        generate(machine, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unknown_nominal_parameter_is_refused(tmp_path: Path) -> None:
    for nominal, words in (({"q9.r": 1.0}, r"q9\.r"), ({"q1.r": np.nan}, r"q1\.r = nan")):
        with pytest.raises(InputError, match=words):
            generate(machine_of(tmp_path, "nano"), tmp_path / "out", nominal=nominal)


def test_identifiers_stay_apart() -> None:
    assert identifiers(["a.b", "a-b", "a_b_2", "scale@rho4:s"]) == ["a_b", "a_b_3", "a_b_2", "scale_rho4_s"]
