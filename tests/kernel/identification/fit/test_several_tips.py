"""A fit of both arms of a torso at once: recovery of a known machine, each derivative, and rows that saw one arm only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import least_squares

from support import two_arms
from support.two_arms import (
    FRAMES,
    JOINTS,
    LEFT,
    MECHANISM,
    RIGHT,
    RIGHT_TOOL,
    TARGETS,
    TOOL,
    chain,
    pose,
)
from truepose.api import calibrate
from truepose.arrays import Array
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

OFFSETS = {"l2": 0.004, "r1": -0.003, "r3": 0.005}  # rad, by which the real joints stand off
POINTS = {"1": (40, 0, 0), "2": (0, 50, 0), "3": (0, 0, 30)}
STANDS = pose((-700, 900, 150), (0.3, -0.2, 2.1))  # where nobody said that the base stands


def measured(rows: int, seed: int = 2) -> pd.DataFrame:
    """A recording of the real pair in numpy, mm and deg: noise of 0.02 mm."""
    rng = np.random.default_rng(seed)
    out = []
    for q in rng.uniform(-1.2, 1.2, (rows, len(JOINTS))):
        joints = dict(zip(JOINTS, q.tolist(), strict=True))
        real = {name: value + OFFSETS.get(name, 0.0) for name, value in joints.items()}
        row = {name: float(np.degrees(value)) for name, value in joints.items()}
        for side, names, tool in (("L", LEFT, TOOL), ("R", RIGHT, RIGHT_TOOL)):
            tip = STANDS @ chain(names, real) @ pose(*tool)
            for key, point in POINTS.items():
                at = (tip @ [*point, 1.0])[:3] + 0.02 * rng.standard_normal(3)
                row |= {f"{side}{key}.{axis}": float(v) for axis, v in zip("xyz", at, strict=True)}
        out.append(row)
    return pd.DataFrame(out)


def exact(text: str) -> str:
    """The tolerances of ``TARGETS`` for the offsets of joints alone."""
    return text.replace("tolerances: {length: 0.2, angle: 0.1}", "tolerances: {offset: 0.5}")


def test_both_arms_are_found_in_one_fit(tmp_path: Path) -> None:
    """Offsets of both arms within four of their own sigmas, from a base that nobody measured."""
    machine = load_machine(two_arms.write(tmp_path, MECHANISM + FRAMES + exact(TARGETS)))
    fit = calibrate(machine, measured(30)).fit
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.15)  # 540 readings: one sigma is 0.06
    values = dict(zip(fit.prior.names, zip(fit.p, fit.std, strict=True), strict=True))
    for name in JOINTS:
        if name != "waist":  # the base is unknown, and turns with it
            value, sigma = values[f"{name}.offset"]
            assert abs(value - OFFSETS.get(name, 0.0)) < 4 * sigma
            assert sigma < 0.0036  # the tools are known to 0.2 deg


def test_derivatives_of_each_sensor_are_those_of_differences(tmp_path: Path) -> None:
    frames = FRAMES.replace("tolerance: {xyz: .inf, rpy: .inf}", "tolerance: {xyz: 1, rpy: 1}")
    riding = "  - {type: pose, name: hands, sigma: {xyz: 0.1, rot: 0.1}, tip: right, in: tool}\ntolerances"
    machine = load_machine(
        two_arms.write(tmp_path, MECHANISM + frames + TARGETS.replace("tolerances", riding))
    )
    rows = measured(4)[list(JOINTS)]
    predictor = Predictor(machine, load_recording(machine, rows, need_observations=False))
    p, x = predictor.model.p_home, np.zeros((4, 0))
    names, _values, slopes, _ = predictor.columns(p, x)
    assert "hands.rz" in names
    for k, name in enumerate(predictor.model.names):
        step = 1e-3 if machine.geometry[name].unit == "mm" else 1e-6
        ends = [predictor.columns(p + sign * step * (np.arange(len(p)) == k), x)[1] for sign in (1, -1)]
        np.testing.assert_allclose(slopes[..., k], (ends[0] - ends[1]) / (2 * step), atol=2e-5)
    assert not slopes[:, [names.index("L1.x")], predictor.model.names.index("r2.offset")].any()
    assert not slopes[:, [names.index("hands.x")], predictor.model.names.index("base.x")].any()


def test_rows_that_saw_one_arm_only_are_used(tmp_path: Path) -> None:
    table = measured(40)
    right = [name for name in table.columns if name.startswith("R")]
    table.loc[::2, right] = np.nan
    table.loc[1::4, [n for n in table.columns if n.startswith("L")]] = np.nan
    machine = load_machine(two_arms.write(tmp_path, MECHANISM + FRAMES + exact(TARGETS)))
    fit = calibrate(machine, table).fit
    assert fit.n_observations == int(table.drop(columns=list(JOINTS)).notna().to_numpy().sum())
    value = dict(zip(fit.prior.names, fit.p, strict=True))
    assert value["r3.offset"] == pytest.approx(OFFSETS["r3"], abs=1e-3)


def test_a_camera_of_unknown_pose_on_one_hand_is_found(tmp_path: Path) -> None:
    """Targets of the left hand, read in a frame of the right hand that nobody measured."""
    rng, camera = np.random.default_rng(3), pose((80, -20, 40), (2.0, 0.4, -1.1))
    rows = []
    for q in rng.uniform(-1.2, 1.2, (20, len(JOINTS))):
        joints = dict(zip(JOINTS, q.tolist(), strict=True))
        across = np.linalg.inv(chain(RIGHT, joints) @ camera) @ chain(LEFT, joints) @ pose(*TOOL)
        row = {name: float(np.degrees(v)) for name, v in joints.items()}
        for key, point in POINTS.items():
            at = (across @ [*point, 1.0])[:3] + 0.02 * rng.standard_normal(3)
            row |= {f"L{key}.{axis}": float(v) for axis, v in zip("xyz", at, strict=True)}
        rows.append(row)
    frames = "frames:\n  tool: {in: flange, xyz: [60, 0, 20], rpy: [10, 0, 30]}\n" + (
        "  camera: {in: r_hand, tolerance: {xyz: .inf, rpy: .inf}}\n"
    )
    sensor = exact(TARGETS).split("\n")
    text = "\n".join([sensor[0], sensor[1].replace("}, sigma", "}, in: camera, sigma"), *sensor[3:]])
    path = two_arms.write(tmp_path, MECHANISM + frames + text.replace("offset: 0.5", "offset: 0"))
    machine = load_machine(path)
    fit = calibrate(machine, pd.DataFrame(rows)).fit
    value = dict(zip(fit.prior.names, fit.p, strict=True))
    found = pose([value[f"camera.{a}"] for a in "xyz"], [value[f"camera.r{a}"] for a in "xyz"])
    np.testing.assert_allclose(found[:3, 3], camera[:3, 3], atol=0.1)
    np.testing.assert_allclose(found[:3, :3], camera[:3, :3], atol=2e-3)


@pytest.mark.nightly
def test_closed_contact_of_both_hands_needs_no_instrument(tmp_path: Path) -> None:
    """The left tool's ball touches two points of a rod in the right hand, nobody knows where: no reading but the joints."""
    rng, rows = np.random.default_rng(11), []

    def apart(q: Array, point: Array) -> Array:
        real = dict(zip(JOINTS, q.tolist(), strict=True))
        real = {name: value + OFFSETS.get(name, 0.0) for name, value in real.items()}
        right = chain(RIGHT, real) @ pose(*RIGHT_TOOL)
        return np.asarray((chain(LEFT, real) @ pose(*TOOL))[:3, 3] - (right @ point)[:3])

    for name in ("a", "b"):
        first = dict(zip(JOINTS, rng.uniform(-0.5, 0.5, 7).tolist(), strict=True))
        touched = (chain(LEFT, first) @ pose(*TOOL))[:, 3]
        point = np.linalg.inv(chain(RIGHT, first) @ pose(*RIGHT_TOOL)) @ touched
        for _ in range(40):
            start = np.array(list(first.values())) + rng.uniform(-0.8, 0.8, 7)
            found = least_squares(apart, start, args=(point,), max_nfev=40)
            if np.linalg.norm(found.fun) < 1e-3 and np.abs(found.x).max() < 1.5:
                degrees = np.degrees(found.x + 1e-6 * rng.standard_normal(7)).tolist()
                rows.append({**dict(zip(JOINTS, degrees, strict=True)), "placement": "rod", "socket": name})
    assert len(rows) > 30
    sensor = "sensor: {type: socket, in: right, sigma: {xyz: 0.01}}\n"
    frames = FRAMES.replace("tolerance: {xyz: 1, rpy: 0.2}", "tolerance: {xyz: 0, rpy: 0}")
    tolerances = "tolerances: {l2.offset: 0.5, l3.offset: 0.5, r1.offset: 0.5, r2.offset: 0.5}\n"
    machine = load_machine(two_arms.write(tmp_path, MECHANISM + frames + sensor + tolerances))
    fit = calibrate(machine, pd.DataFrame(rows)).fit
    value = dict(zip(fit.prior.names, zip(fit.p, fit.std, strict=True), strict=True))
    for name in ("l2", "l3", "r1", "r2"):  # r3 turns the points that it touches, too: it is left as it is
        assert abs(value[f"{name}.offset"][0] - OFFSETS.get(name, 0.0)) < 2e-3
        assert value[f"{name}.offset"][1] < 2e-3


def test_a_calibrated_file_predicts_what_the_fit_does(tmp_path: Path) -> None:
    machine = load_machine(two_arms.write(tmp_path, MECHANISM + FRAMES + exact(TARGETS)))
    recording = load_recording(machine, measured(30))
    fit = calibrate(machine, recording).fit
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    told = predict(load_machine(tmp_path / "calibrated.yaml"), recording)
    read: Array = measured(30)[["R2.x", "R2.y", "R2.z"]].to_numpy()
    assert np.abs(told[["R2.x", "R2.y", "R2.z"]].to_numpy() - read).max() < 0.1
