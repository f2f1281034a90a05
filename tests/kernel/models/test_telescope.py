"""The telescope's models: constant Jacobian, bent flexures, their derivatives, files and C. mm, N, rad."""

from __future__ import annotations

import subprocess
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from support.generated_c import needs_compiler
from support.simulated import machine_from
from support.telescope_models import (
    LENGTH,
    MODELS,
    TOOL,
    TRAVEL,
    apart,
    hinged,
    lower_centres,
    machine_of,
    model_text,
    number,
    poses_of,
    recording_of,
    upper_centres,
)
from truepose import simulate
from truepose.codegen.c import generate
from truepose.errors import InputError
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.assembly import SHAPE, flexure_gain
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
NEAR_HOME = ("linear", "stiffness")


def bending(machine: Machine, values: dict[str, float], form: float = 2.0) -> PlacedEffect:
    kind = effects.get("platform-deformation", "test")()
    return PlacedEffect.at(kind, machine, ("platform",), {"form": form}, values)


# -- constant Jacobian ---------------------------------------------------------------------------------


@pytest.mark.parametrize("model", NEAR_HOME)
def test_models_about_home_err_by_the_square_of_the_travel(tmp_path: Path, model: str) -> None:
    # soft flexures on stiff legs: only the directions that are kept at home separate them from ball joints
    soft = (("flexure: {length: 30", "flexure: {length: 30, beta: 0.25"),) if model == "linear" else ()
    near = machine_of(tmp_path, model, *soft)
    if model == "stiffness":
        near = machine_of(tmp_path, model, *hinged(near))
    exact = machine_of(tmp_path, "spherical")
    errors = [
        apart(poses_of(tmp_path, near, s * TRAVEL), poses_of(tmp_path, exact, s * TRAVEL))
        for s in (1.0, 0.5, 0.25)
    ]
    # a cubic term of the travel's share of the machine (1.3 of 400 mm, lever 1 to 2) bends the ratio by 1 %
    assert np.allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.03)
    assert errors[0] > 1e-3


def test_the_linear_model_is_the_inverse_jacobian_of_home(tmp_path: Path) -> None:
    """Equations 8 and 9, written out in numpy, with a platform that bends."""
    machine = machine_of(tmp_path, "linear")
    k = 0.01 * np.random.default_rng(3).standard_normal((6, 6))
    placed = bending(machine, {f"K[{i + 1},{j + 1}]": float(k[i, j]) for i in range(6) for j in range(6)})
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL), (placed,))
    x, good = predictor.assemble(predictor.model.p_home)
    assert good.all()
    home, upper = x[0, 6:9], upper_centres()
    z = home + upper - lower_centres(np.zeros(6))
    z /= np.linalg.norm(z, axis=1)[:, None]
    # home has no turn worth mentioning (1e-8 rad): modified Rodrigues parameters there are angle / 4
    moved = (x[:, :3] - home) @ z.T + 4 * (x[:, 3:6] - x[0, 9:]) @ np.cross(upper, z).T
    assert np.allclose((moved + (TRAVEL @ k.T) * z[:, 2]) / z[:, 2], TRAVEL, rtol=0, atol=1e-7)


# -- flexures as beam theory bends them ----------------------------------------------------------------


def grown(angle: float, shape: float = SHAPE) -> float:
    return number(flexure_gain(ca.SX(LENGTH), ca.SX(shape), ca.SX(np.cos(angle))))


@pytest.mark.parametrize("shape", [0.0, 0.1, 0.25, 0.4])
@pytest.mark.parametrize("angle", [0.001, 0.02, 0.3])
def test_the_tip_of_a_flexure_stays_on_its_circle(shape: float, angle: float) -> None:
    """Equation 15: (1 - beta) l from a point (1/2 - beta) l behind the middle, along the straight flexure."""
    reach = LENGTH / 2 + grown(angle, shape)
    tip = np.array([(0.5 - shape) * LENGTH + reach * np.cos(angle), reach * np.sin(angle)])
    assert np.linalg.norm(tip) == pytest.approx((1 - shape) * LENGTH, rel=1e-14)


def test_a_flexure_shortens_like_an_arc_of_its_length() -> None:
    for angle in np.radians([0.2, 0.6, 1.0]):
        arc = LENGTH * np.array([np.sin(angle), 1 - np.cos(angle)]) / angle
        reach = LENGTH / 2 + grown(float(angle))
        model = np.array([LENGTH / 2 + reach * np.cos(angle), reach * np.sin(angle)])
        # across, the tip of the arc lags by l d^3/24 (7 nm at 1 deg); along, both agree to the order d^4
        assert abs(model[0] - arc[0]) < 0.01 * LENGTH * angle**4 * 10
        assert abs(model[1] - arc[1]) == pytest.approx(LENGTH * angle**3 / 24, rel=0.01)
        ball = LENGTH / 2 * (1 + np.cos(angle))
        assert model[0] - ball == pytest.approx(LENGTH * angle**2 / 12, rel=1e-3)


def test_short_flexures_and_those_that_turn_about_their_middle_are_ball_joints(tmp_path: Path) -> None:
    ball = poses_of(tmp_path, machine_of(tmp_path, "spherical"), TRAVEL)
    bent = poses_of(tmp_path, machine_of(tmp_path, "beam"), TRAVEL)
    assert 1e-4 < apart(bent, ball) < 1e-3  # 0.5 um
    centred = (("flexure: {length: 30", "flexure: {length: 30, beta: 0.5"),)
    assert apart(poses_of(tmp_path, machine_of(tmp_path, "beam", *centred), TRAVEL), ball) < 1e-11
    short = (("flexure: {length: 30", "flexure: {length: 0.003"),)
    # the shift is proportional to the length
    assert apart(poses_of(tmp_path, machine_of(tmp_path, "beam", *short), TRAVEL), ball) < 1e-7


def test_bent_legs_are_as_long_as_equations_14_to_17_say(tmp_path: Path) -> None:
    poses = poses_of(tmp_path, machine_of(tmp_path, "beam"), TRAVEL)
    home = poses_of(tmp_path, machine_of(tmp_path, "spherical"), np.zeros((1, 6)))[0]
    tool = np.eye(4)
    tool[2, 3] = TOOL

    def legs(pose: Array, rho: Array) -> Array:
        platform = pose @ np.linalg.inv(tool)
        return np.asarray(upper_centres() @ platform[:3, :3].T + platform[:3, 3] - lower_centres(rho))

    straight = legs(home, np.zeros(6))
    straight /= np.linalg.norm(straight, axis=1)[:, None]
    for pose, rho in zip(poses, TRAVEL, strict=True):
        leg = legs(pose, rho)
        z = leg / np.linalg.norm(leg, axis=1)[:, None]
        total = 500.0 - LENGTH
        for against in (straight, straight @ pose[:3, :3].T):
            c = 0.5 * np.sum(z * against, axis=1)
            total = total + LENGTH / 2 * (np.sqrt(2.0 + c**2) - c)
        # home is turned by 1e-8 rad, which R alone counts as bending
        assert np.allclose(np.linalg.norm(leg, axis=1), total, rtol=0, atol=1e-8)


# -- derivatives, files, C -----------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_poses_by_every_constant(tmp_path: Path, model: str) -> None:
    machine = machine_of(tmp_path, model)
    placed = bending(machine, {f"K[{i},{i}]": 0.01 for i in range(1, 7)}, 1.0)
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL[:3]), (placed,))
    p = predictor.model.p_home
    x, _ = predictor.assemble(p)
    twist = predictor.twists(p, x)[1]
    for k, name in enumerate(predictor.model.names):
        step = 1e-5 * max(1.0, abs(p[k]))
        moved = []
        for sign in (1, -1):
            shifted = p.copy()
            shifted[k] += sign * step
            moved.append(predictor.poses(shifted)[0])
        slope = np.hstack(
            [
                (moved[0] - moved[1])[:, :3, 3],
                lie.log_so3(moved[0][:, :3, :3] @ moved[1][:, :3, :3].transpose(0, 2, 1)),
            ]
        ) / (2 * step)
        # rounding of poses (500 mm) over the step, and its square; a stiffness moves hardly anything
        size = 1e-13 * 500 / step + 1e-5 * np.abs(twist[:, :, k]).max()
        assert np.allclose(twist[:, :, k], slope, rtol=0, atol=size), name


@pytest.mark.parametrize(
    ("model", "old", "new", "message"),
    [
        ("beam", "flexure: {length: 30", "flexure: {length: 600", r"legs: leg1: found flexures of 600 mm"),
        ("beam", "flexure: {length: 30", "flexure: {length: -30", r"flexure.*expected a number > 0"),
        ("beam", "flexure: {length: 30", "flexure: {length: 30, beta: 0.8", r"beta: expected a number < 0.75"),
        ("stiffness", "rod: {", "# {", r"mechanism.rod: found none, expected one: model stiffness"),
        ("stiffness", "flexure: {length: 30, bending: ", "flexure: {length: 30}  # ", r"flexure.bending: found none"),
        ("linear", "model: linear", "model: lineal", r"mechanism.model"),
    ],
)  # fmt: skip
def test_what_a_model_lacks_is_told(tmp_path: Path, model: str, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, model, (old, new))


def test_beam_theory_without_flexures_is_refused(tmp_path: Path) -> None:
    text = model_text("beam")
    kept = [line for line in text.splitlines() if not line.strip().startswith("flexure:")]
    with pytest.raises(InputError, match=r"mechanism.flexure: found none, expected one: model beam"):
        machine_from(tmp_path, "\n".join(kept).replace("beta: 0.025, ", ""))


@pytest.mark.parametrize("model", ["beam", "elastic"])
def test_a_calibrated_file_holds_flexures_and_stiffnesses(tmp_path: Path, model: str) -> None:
    machine = machine_of(tmp_path, model)
    readings = simulate(machine, recording_of(tmp_path, machine, TRAVEL), [], seed=1)
    readings[list(machine.mechanism.readings)] = TRAVEL
    recording = load_recording(machine, readings)
    fit = estimate(machine, recording)
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    read = load_machine(tmp_path / "calibrated.yaml")
    names = [p.name for p in machine.parameters]
    assert names == [p.name for p in read.parameters]
    assert any(name.endswith(".flexure") for name in names)
    assert np.allclose([p.nominal for p in read.parameters], fit.p[: len(names)], rtol=1e-12, atol=1e-12)


@needs_compiler
@pytest.mark.parametrize("model", ["linear", "beam"])
def test_generated_c_meets_the_models_own_poses(tmp_path: Path, model: str) -> None:
    generate(machine_of(tmp_path, model), tmp_path / "c")
    sources = [str(path) for path in (tmp_path / "c").glob("*.c")]
    command = [
        "gcc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        *sources,
        "-o",
        str(tmp_path / "example"),
        "-lm",
    ]
    subprocess.run(command, check=True, capture_output=True)
    run = subprocess.run(
        [str(tmp_path / "example")], cwd=tmp_path / "c", check=True, capture_output=True, text=True
    )
    assert "0 of" in run.stdout
