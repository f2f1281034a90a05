"""A machine that is compared with itself has no size: no fit may prefer the smaller one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from support.simulated import machine_from
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.reading_errors import estimate_reading_errors
from truepose.identification.load import load_recording
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

MILL = """
schema: truepose/machine/1
name: mill
mechanism:
  type: graph
  bodies: [table, cradle, bed, saddle, column, spindle]
  flange: spindle
  joints:
    - {name: C, kind: revolute, parent: table, child: cradle, axis: [0, 0, -1], actuated: true}
    - {name: A, kind: revolute, parent: cradle, child: bed, axis: [-1, 0, 0], actuated: true}
    - {name: Y, kind: prismatic, parent: bed, child: saddle, axis: [0, 1, 0], actuated: true}
    - {name: X, kind: prismatic, parent: saddle, child: column, axis: [1, 0, 0], actuated: true}
    - {name: Z, kind: prismatic, parent: column, child: spindle, axis: [0, 0, 1], actuated: true}
sensor: {type: socket, sigma: {xyz: 0.002}}
tolerances: {length: 0.03, angle: 0.01}
"""
ARM = """
schema: truepose/machine/1
name: arm
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, beta: 0, alpha: 0, d: 0, theta: 0, r: 200}
    - {name: q2, kind: revolute, beta: 0, alpha: -90, d: 0, theta: 0, r: 0}
    - {name: q3, kind: revolute, beta: 0, alpha: 0, d: 300, theta: 0, r: 0}
    - {name: q4, kind: revolute, beta: 0, alpha: -90, d: 0, theta: 0, r: 0}
frames: {tool: {in: flange, xyz: [250, 0, 0]}}
sensor: {type: socket, sigma: {xyz: 0.02}}
tolerances: {length: 1, angle: 0.1}
"""
SOCKETS = np.array([[80.0, 30.0, 60.0], [-60.0, 40.0, 60.0], [20.0, -50.0, 90.0]])


def seated_mill(rows: int = 60, noise: float = 0.002) -> dict[str, list[object]]:
    """Return readings of a perfect mill whose ball sits in three sockets, by the closed form of its inverse."""
    rng = np.random.default_rng(4)
    a, c = rng.uniform(-60.0, 60.0, rows), rng.uniform(-180.0, 180.0, rows)
    which = np.arange(rows) % 3
    x, y, z = SOCKETS[which].T
    cos, sin = np.cos(np.radians(-c)), np.sin(np.radians(-c))
    x, y = cos * x + sin * y, -sin * x + cos * y  # the table turns by -c about z
    cos, sin = np.cos(np.radians(-a)), np.sin(np.radians(-a))
    y, z = cos * y + sin * z, -sin * y + cos * z
    slides = np.column_stack([x, y, z]) + noise * rng.standard_normal((rows, 3))
    table: dict[str, list[object]] = {"placement": [1] * rows, "socket": [f"S{k}" for k in which]}
    return table | dict(zip("XYZAC", [*slides.T.tolist(), a.tolist(), c.tolist()], strict=True))


def loaded(folder: Path, text: str) -> Machine:
    """Load a machine from its text."""
    return machine_from(folder, text, "machine")


def squares(machine: Machine, recording: Recording, p: np.ndarray) -> float:
    """Return the sum of squared residuals at parameters ``p``."""
    predictor = Predictor(machine, recording, machine.effects)
    return float(sum(np.sum(b.residual**2) for b in predictor.blocks(p, predictor.assemble(p)[0])))


def ball(q: np.ndarray) -> np.ndarray:
    """Return the ball of the arm, mm: a column of 200 mm, a shoulder, 300 mm to an elbow, and a wrist that swings 250 mm."""
    arm = np.array([300.0 * np.cos(q[1]), -300.0 * np.sin(q[1])])  # along the arm's plane, and up
    inner = q[1] + q[2]
    along = np.array([np.cos(inner), -np.sin(inner)])
    outer = 250.0 * np.array(
        [np.cos(q[3]), -np.sin(q[3])]
    )  # in the last link's frame: along it, and out of the plane
    radial = arm[0] + outer[0] * along[0]
    height = 200.0 + arm[1] + outer[0] * along[1]
    turn = np.array([[np.cos(q[0]), -np.sin(q[0])], [np.sin(q[0]), np.cos(q[0])]])
    return np.append(turn @ [radial, outer[1]], height)


def seated(goal: np.ndarray, swing: float) -> np.ndarray:
    """Return joint angles, rad, that put the ball at a point with the wrist swung."""

    def missed(q: np.ndarray) -> np.ndarray:
        return np.asarray(ball(np.append(q, swing)) - goal)

    found = least_squares(missed, [0.0, -0.7, 1.4])
    assert found.cost < 1e-12
    return np.append(found.x, swing)


def arm_recording(machine: Machine, noise: float = 1e-4) -> Recording:
    """Return rows of a perfect arm that seats its ball in two sockets with its wrist swung in many ways."""
    rng, rows = np.random.default_rng(5), []
    for k in range(40):
        goal = ([350.0, 60.0, 250.0], [280.0, -120.0, 180.0])[k % 2]
        rows.append(seated(np.array(goal), rng.uniform(-0.9, 0.9)) + noise * rng.standard_normal(4))
    table = {"placement": [1] * 40, "socket": [f"S{k % 2}" for k in range(40)]}
    joints = dict(zip(("q1", "q2", "q3", "q4"), np.degrees(rows).T.tolist(), strict=True))
    return load_recording(machine, table | joints)


def test_correction_of_readings_leaves_the_stated_machine_its_residuals(tmp_path: Path) -> None:
    machine = loaded(tmp_path, MILL)
    measured = load_recording(machine, seated_mill())
    corrected = estimate_reading_errors(machine, measured)
    p = Predictor(machine, measured).model.p_home
    # a perfect mill: the fit, at which the errors are estimated, is near; the rest is of second order
    assert squares(machine, corrected, p) == pytest.approx(squares(machine, measured, p), rel=1e-3)
    assert np.max(np.abs(corrected.positions - measured.q)) < 0.05
    np.testing.assert_array_equal(corrected.q, measured.q)


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[Machine, Recording, Recording]]:
    """Return machines that are compared with themselves, with their recordings as read and corrected."""
    out = []
    for text in (ARM, MILL + "effects: [{effect: actuator-scale, place: [X, Y, Z]}]\n"):
        machine = loaded(tmp_path_factory.mktemp("size"), text)
        measured = arm_recording(machine) if text is ARM else load_recording(machine, seated_mill())
        out.append((machine, measured, estimate_reading_errors(machine, measured)))
    return out


@pytest.mark.parametrize("size", [0.5, 0.9, 0.99, 1.1, 2.0])
def test_a_machine_of_another_size_fits_as_well_where_no_length_is_measured(
    compared: list[tuple[Machine, Recording, Recording]], size: float
) -> None:
    for machine, measured, corrected in compared:  # alike but for second-order terms of the errors
        p = estimate(machine, corrected, machine.effects).p
        lengths = np.array([parameter.unit == "mm" for parameter in machine.parameters])
        scaled = p.copy()
        scaled[: len(lengths)][lengths] *= size
        scaled[len(lengths) :] = size * (1.0 + p[len(lengths) :]) - 1.0  # the slides' common scale
        assert squares(machine, corrected, scaled) == pytest.approx(squares(machine, corrected, p), rel=5e-3)
        # without the correction the smaller machine fits better: the law can fail
        ratio = squares(machine, measured, scaled) / squares(machine, measured, p)
        assert ratio == pytest.approx(size**2, rel=1e-6)


def test_calibration_keeps_the_stated_size_of_an_arm_of_unknown_lengths(tmp_path: Path) -> None:
    machine = loaded(tmp_path, ARM.replace("length: 1,", "length: 50,"))
    fit = calibrate(machine, arm_recording(machine)).fit
    lengths = [k for k, p in enumerate(machine.parameters) if p.unit == "mm" and p.nominal != 0.0]
    assert np.all(np.abs(fit.p[lengths] - [machine.parameters[k].nominal for k in lengths]) < 10.0)


def test_a_known_distance_of_sockets_measures_the_size(tmp_path: Path) -> None:
    text = MILL.replace("type: socket,", "type: socket, spacing: 140.3567,")
    table = seated_mill()
    pairs = [k for k, name in enumerate(table["socket"]) if name != "S2"]
    table = {name: [values[k] for k in pairs] for name, values in table.items()}
    machine = loaded(tmp_path, text + "effects: [{effect: actuator-scale, place: [X, Y, Z]}]\n")
    corrected = estimate_reading_errors(machine, load_recording(machine, table))
    p = Predictor(machine, corrected, machine.effects).model.p_home
    larger = p.copy()
    larger[-1] = 0.01
    assert squares(machine, corrected, larger) > 100.0 * squares(machine, corrected, p)
