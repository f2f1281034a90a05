"""Masses and centres as unknowns: a compliant arm in numpy that carries what nobody weighed."""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from support.plain_kinematics import frame
from support.simulated import machine_from
from truepose.api import calibrate, diagnose
from truepose.arrays import Array
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import predict
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

AXES = ("z", "y", "y")
ARM = (8.0, (0.0, 0.0, 200.0))  # kg and centre (mm) of the upper arm
KG, COM = 3.2, np.array([25.0, -10.0, 80.0])  # what is really carried
SOFT = (0.0, 2e-5, 4e-5)  # rad/(N m)
TEXT = """schema: truepose/machine/1
name: carrier
gravity: [0, 0, -9.80665]
mechanism:
  type: graph
  bodies: [base, shoulder, upper, fore]
  joints:
    - {name: q1, kind: revolute, parent: base, child: shoulder, xyz: [0, 0, 300], axis: [0, 0, 1], actuated: true}
    - {name: q2, kind: revolute, parent: shoulder, child: upper, axis: [0, 1, 0], actuated: true}
    - {name: q3, kind: revolute, parent: upper, child: fore, xyz: [0, 0, 400], axis: [0, 1, 0], actuated: true}
frames: {tool: {in: flange, xyz: [0, 0, 350]}}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.005}}
tolerances: {offset: 0.1}
masses:
  arm: {kg: 8, com: [0, 0, 200], in: upper}
  payload: {kg: 2, com: [0, 0, 60], in: tool, tolerance: {kg: 1, com: 30}}
"""
EFFECTS = """effects:
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 2.0e-5, unit: rad/(N*m), std: 1.0e-7}}}
  - {effect: joint-compliance, place: [q3], parameters: {c: {value: 4.0e-5, unit: rad/(N*m), std: 1.0e-7}}}
"""


def bodies(q: Array) -> list[Array]:
    """Frames (4, 4) of shoulder, upper arm, forearm and tool, mm."""
    turning = (
        frame([0, 0, 300], [0, 0, q[0]]),
        frame([0, 0, 0], [0, q[1], 0]),
        frame([0, 0, 400], [0, q[2], 0]),
    )
    return list(accumulate([*turning, frame([0, 0, 350])], np.matmul))


def energy(q: Array, kg: float, com: Array) -> float:
    """N m."""
    frames = bodies(q)
    arm = ARM[0] * (frames[1] @ [*ARM[1], 1.0])[2]
    return 9.80665e-3 * float(arm + kg * (frames[3] @ [*com, 1.0])[2])


def recorded(
    kg: Array, com: Array = COM, seed: int = 4, soft: tuple[float, float, float] = SOFT
) -> pd.DataFrame:
    """Rows that carry ``kg`` (n,): the joints stand off by compliance ``soft`` times torque, in numpy."""
    rng, rows = np.random.default_rng(seed), []
    for mass in kg.tolist():
        q = rng.uniform([-2, -1.4, -1.8], [2, 1.4, 1.8])
        step = 1e-5 * np.eye(3)
        torque = [-(energy(q + s, mass, com) - energy(q - s, mass, com)) / 2e-5 for s in step]
        tool = bodies(q + np.multiply(soft, torque))[3]
        turn = Rotation.from_matrix(tool[:3, :3]) * Rotation.from_rotvec(
            np.radians(0.005) * rng.standard_normal(3)
        )
        at = tool[:3, 3] + 0.01 * rng.standard_normal(3)
        names = ("q1", "q2", "q3", "x", "y", "z", "rx", "ry", "rz")
        values = [*np.degrees(q), *at, *turn.as_rotvec(degrees=True)]
        rows.append(dict(zip(names, values, strict=True)))
    return pd.DataFrame(rows)


def machine_of(folder: Path, text: str = TEXT) -> Machine:
    return machine_from(folder, text, "carrier")


def constants(fit: Estimate) -> dict[str, tuple[float, float]]:
    return dict(zip(fit.prior.names, zip(fit.p.tolist(), fit.std.tolist(), strict=True), strict=True))


def test_what_a_fit_tells_of_a_payload_that_nobody_weighed(tmp_path: Path) -> None:
    """Beside compliances only the product of mass and compliance is seen; where the centre stands sideways is seen well."""
    machine = machine_of(tmp_path, TEXT + EFFECTS)
    recording = load_recording(machine, recorded(np.full(80, KG)))
    done = calibrate(machine, recording)
    found = constants(done.fit)
    slope = found["joint-compliance@q3:c"][0] / SOFT[2]  # only the product with the mass is seen at q3
    assert found["payload.kg"][0] * slope == pytest.approx(KG, rel=0.1)
    for axis, value, known in (("x", COM[0], 10.0), ("z", COM[2], 30.0)):  # 30 mm before
        at, sigma = found[f"payload.{axis}"]
        assert abs(at - value) < 4 * sigma
        assert sigma < known
    write_calibrated(tmp_path / "out.yaml", done.fit, done.recording)
    again = load_machine(tmp_path / "out.yaml")
    assert again.geometry["payload.x"].nominal == pytest.approx(found["payload.x"][0], rel=1e-12)
    told = predict(again, recording)[["x", "y", "z"]].to_numpy()
    assert np.std(told - recorded(np.full(80, KG))[["x", "y", "z"]].to_numpy()) < 0.012


def test_derivatives_by_mass_and_centre_are_those_of_differences(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, TEXT + EFFECTS)
    predictor = Predictor(machine, load_recording(machine, recorded(np.full(5, KG))), machine.effects)
    p, x = predictor.model.p_home, np.zeros((5, 0))
    slopes = predictor.columns(p, x)[2]
    for name in ("payload.kg", "payload.x", "payload.y", "payload.z"):
        step = 1e-2 * (np.array(predictor.model.names) == name)
        difference = (predictor.columns(p + step, x)[1] - predictor.columns(p - step, x)[1]) / 2e-2
        own = slopes[..., predictor.model.names.index(name)]
        np.testing.assert_allclose(own, difference, atol=1e-9)
        assert np.abs(own).max() > 1e-6 or name == "payload.y"  # no axis is along x: y tilts nothing


def test_a_recorded_payload_leaves_the_centre_alone(tmp_path: Path) -> None:
    """kg is the column's: the constant stays at its nominal, and the centre and both compliances are found."""
    kg = np.tile([0.0, 2.0, 5.0], 30)
    table = recorded(kg)
    table["payload"] = kg
    fit = calibrate(machine_of(tmp_path, TEXT + EFFECTS), table).fit
    found = constants(fit)
    assert found["payload.kg"] == pytest.approx((2.0, 1.0))
    for name, value in (("payload.x", COM[0]), ("payload.z", COM[2])):
        assert abs(found[name][0] - value) < 4 * found[name][1]
        assert found[name][1] < 10
    for name, value in (("q2", SOFT[1]), ("q3", SOFT[2])):
        at, sigma = found[f"joint-compliance@{name}:c"]
        assert abs(at - value) < 4 * sigma


@pytest.mark.nightly
def test_a_compliance_is_told_with_the_doubt_that_an_unweighed_payload_leaves(tmp_path: Path) -> None:
    """c of q3 carries the payload alone: its own 1-sigma must be that of the payload's kg, 1 of 2."""
    table = recorded(
        np.full(60, KG), seed=8, soft=(0.0, 0.0, SOFT[2])
    )  # q2 would tell kg: the arm's own is known
    known = TEXT.replace("kg: 2,", "kg: 3.2,").replace("[0, 0, 60]", "[25, -10, 80]")
    sure = diagnose(machine_of(tmp_path, known.replace(", tolerance: {kg: 1, com: 30}", "")), table)
    unsure = diagnose(machine_of(tmp_path), table)
    spread = []
    for result in (sure, unsure):
        found = [f for f in result.findings if f.effect == "joint-compliance" and f.place == ("q3",)]
        assert found
        value, sigma = found[0].parameters["c"].value, found[0].parameters["c"].std
        assert abs(value - SOFT[2]) < 4 * sigma
        spread.append(sigma / value)
    assert spread[0] < 0.05
    assert spread[1] == pytest.approx(1.0 / 2.0, rel=0.25)
