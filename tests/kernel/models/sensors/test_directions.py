"""Sensors of angles: stars, theodolites, inclinometers. Readings come from plain numpy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.plain_kinematics import chain, frame
from support.simulated import machine_from
from truepose.errors import InputError
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

Array = NDArray[np.float64]
ARM = """schema: truepose/machine/1
name: arm
gravity: [0, 0, -9.81]
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 300}}
    - {{name: q2, kind: revolute, alpha: -90, d: 50}}
    - {{name: q3, kind: revolute, d: 400}}
frames:
  base: {{in: world, xyz: [900, 300, 100], rpy: [2, -3, 40], tolerance: {{xyz: 0, rpy: 0}}}}
  tool: {{in: flange, xyz: [120, 30, 60], rpy: [0, 20, 0]}}
sensor:
{sensor}
tolerances: {{angle: 0, length: 0, theta: .inf}}
"""
ROWS = ((0, 0, 0, 0, 300), (0, -np.pi / 2, 50, 0, 0), (0, 0, 400, 0, 0))
Q = np.random.default_rng(4).uniform(-1.2, 1.2, (40, 3))


def _fk(q: Array, offset: Array) -> tuple[Array, Array]:
    """Rotation and place of the tool in the world."""
    base, tool = frame([900, 300, 100], np.radians([2, -3, 40])), frame([120, 30, 60], np.radians([0, 20, 0]))
    pose = chain(ROWS, q + offset, base, tool)
    return pose[:3, :3], pose[:3, 3]


def _table(seen: dict[str, Array]) -> dict[str, Array]:
    return {f"q{k + 1}": np.degrees(Q[:, k]) for k in range(3)} | seen


def _angles(v: Array, sense: float) -> tuple[Array, Array]:
    az = np.degrees(np.arctan2(sense * v[:, 1], v[:, 0])) % 360.0
    return az, np.degrees(np.arcsin(v[:, 2] / np.linalg.norm(v, axis=1)))


def _readings(sensor: str, offset: Array) -> dict[str, Array]:
    poses = [_fk(q, offset) for q in Q]
    if sensor == "origin":
        v = np.array([at - [100.0, -200.0, 50.0] for _, at in poses])
        v = v @ Rotation.from_euler("Z", 30, degrees=True).as_matrix()
        return dict(zip(("t.hz", "t.v"), _angles(v, -1.0), strict=True))
    if sensor == "vector":
        return {f"u{a}": np.array([r[k, 2] for r, _ in poses]) for k, a in enumerate("xyz")}
    if sensor == "tilt":
        base = Rotation.from_euler("ZYX", [40, -3, 2], degrees=True).as_matrix()
        up = np.array([r.T @ base[:, 2] for r, _ in poses])
        return {f"tilt.{a}": np.degrees(np.arcsin(up[:, k])) for k, a in enumerate("xy")}
    v = np.array([r[:, 0] for r, _ in poses])
    return dict(zip(("azimuth", "elevation"), _angles(v, 1.0), strict=True))


SENSORS = {
    "axis": "  {type: direction, turn: counterclockwise, sigma: {angle: 1 arcsec}}",
    "vector": "  {type: direction, of: z, columns: vector, sigma: {angle: 1 arcsec}}",
    "origin": "  {type: direction, of: origin, name: t, angles: [hz, v], sigma: {angle: 1 arcsec},"
    " station: {xyz: [100, -200, 50], rpy: [0, 0, 30]}}",
    "tilt": "  {type: tilt, sigma: {angle: 1 arcsec}}",
}


@pytest.mark.parametrize("sensor", list(SENSORS))
def test_offsets_come_back(tmp_path: Path, sensor: str) -> None:
    machine = machine_from(tmp_path, ARM.format(sensor=SENSORS[sensor]), "arm")
    offset = np.radians([0.1, -0.2, 0.15])
    recording = load_recording(machine, _table(_readings(sensor, offset)))
    nominal = load_recording(machine, _table(_readings(sensor, np.zeros(3))))
    predictor = Predictor(machine, nominal)
    x, _ = predictor.assemble(predictor.model.p_home)
    blocks = list(predictor.blocks(predictor.model.p_home, x))
    # 1e-9 sigma is 5e-15 rad: rounding of angles
    assert max(np.abs(block.residual).max() for block in blocks) < 1e-6
    fit = calibrate(machine, recording).fit
    found = [fit.p[fit.prior.names.index(f"q{k}.theta")] for k in (1, 2, 3)]
    # parallel joints turn axes by their sum; a level hardly sees the first, whose axis leans by 3 deg
    assert found[1] + found[2] == pytest.approx(offset[1] + offset[2], abs=1e-8)
    if sensor != "tilt":
        assert found[0] == pytest.approx(offset[0], abs=1e-8)
    if sensor == "origin":
        np.testing.assert_allclose(found, offset, atol=1e-8)
    write_calibrated(tmp_path / "back.yaml", fit, recording)
    assert load_machine(tmp_path / "back.yaml").geometry["q1.theta"].nominal == pytest.approx(found[0])


@pytest.mark.parametrize("sensor", list(SENSORS))
def test_jacobians_are_those_of_the_residuals(tmp_path: Path, sensor: str) -> None:
    machine = machine_from(tmp_path, ARM.format(sensor=SENSORS[sensor]), "arm")
    recording = load_recording(machine, _table(_readings(sensor, np.full(3, 0.02))))
    predictor = Predictor(machine, recording)
    p = predictor.model.p_home

    def residual(at: Array) -> Array:
        x, _ = predictor.assemble(at)
        return np.concatenate([b.residual for b in predictor.blocks(at, x)]) * machine.channels[0].sigma

    x, _ = predictor.assemble(p)
    exact = np.concatenate([b.jacobian for b in predictor.blocks(p, x)]) * machine.channels[0].sigma
    for k in range(len(machine.parameters)):
        step = np.zeros(len(p))
        step[k] = 1e-5 if machine.parameters[k].unit == "rad" else 1e-2
        slope = (residual(p + step) - residual(p - step)) / (2 * step[k])
        np.testing.assert_allclose(slope, exact[:, :, k], atol=1e-6)  # steep where an axis is near the zenith


def test_a_level_needs_gravity(tmp_path: Path) -> None:
    text = ARM.format(sensor=SENSORS["tilt"]).replace("gravity: [0, 0, -9.81]\n", "")
    with pytest.raises(InputError, match="inclinometer reads which way is down"):
        machine_from(tmp_path, text)


def test_two_angles_of_one_name_are_refused(tmp_path: Path) -> None:
    sensor = "  {type: direction, angles: [a, a], sigma: {angle: 1 arcsec}}"
    with pytest.raises(InputError, match="two names that differ"):
        machine_from(tmp_path, ARM.format(sensor=sensor))
