"""Springs and balancers: loads against differences of an energy in numpy, what a fit makes of them, and what is refused."""

from __future__ import annotations

from itertools import accumulate
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.plain_kinematics import step
from support.simulated import machine_from
from truepose.api import calibrate
from truepose.errors import InputError
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
GRAVITY, KG, COM = 9.81, 20.0, np.array([0.0, 40.0, 0.0, 1.0])
ON_BASE, ON_ARM = np.array([100.0, 0.0, 50.0]), np.array([250.0, -30.0, 0.0, 1.0])
STIFFNESS, FREE, PUSH = 4.0, 180.0, -300.0
ROWS = ((0.0, 0.0, 0.0, 0.0, 300.0), (0.0, -np.pi / 2, 0.0, 0.0, 0.0), (0.0, 0.0, 400.0, 0.0, 0.0))
SOFT = 3e-5  # rad/(N m)
TEXT = """schema: truepose/machine/1
name: balanced
gravity: [0, 0, -9.81]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, range: [-100, 100]}
    - {name: q3, kind: revolute, d: 400, range: [-120, 120]}
frames: {tool: {in: flange, xyz: [350, 0, 0]}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {q2.theta: 0.1}
masses: {arm: {kg: 20, com: [0, 40, 0], in: link3}}
loads:
  spring: {from: {in: link1, at: [100, 0, 50]}, to: {in: link2, at: [250, -30, 0]}, stiffness: 4, free_length: 180}
  gas: {from: {in: base, at: [0, 0, 100]}, to: {in: link2, at: [250, -30, 0]}, force: -300}
"""
EFFECT = """effects:
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 3.0e-5, unit: rad/(N*m), std: 1.0e-9}}}
"""


def links(q: Array) -> list[Array]:
    """Frames (4, 4) of link1, link2, link3, mm."""
    return list(accumulate(map(step, ROWS, q), np.matmul))


def energy(q: Array, stiffness: float = STIFFNESS) -> float:
    """N m."""
    one, two, three = links(q)
    hooked = (two @ ON_ARM)[:3]
    long = float(np.linalg.norm(hooked - (one @ [*ON_BASE, 1.0])[:3]))
    gas = float(np.linalg.norm(hooked - [0.0, 0.0, 100.0]))
    spring = stiffness * (long - FREE) ** 2 / 2 + PUSH * gas
    return (KG * GRAVITY * float((three @ COM)[2]) + spring) / 1000


def torque(q: Array, joint: int, stiffness: float = STIFFNESS) -> float:
    step = 1e-5 * np.eye(3)[joint]
    return -(energy(q + step, stiffness) - energy(q - step, stiffness)) / 2e-5


def machine_of(folder: Path, text: str = TEXT) -> Machine:
    return machine_from(folder, text, "balanced")


def rows(q: Array) -> dict[str, Array]:
    return {f"q{k + 1}": np.degrees(q[:, k]) for k in range(3)}


METRES = (
    ("name: balanced", "name: balanced\nunits: {length: m, angle: rad}"),
    ("r: 300, range: [-170, 170]", "r: 0.3"),
    ("alpha: -90, range: [-100, 100]", "alpha: -1.5707963267948966"),
    ("d: 400, range: [-120, 120]", "d: 0.4"),
    ("xyz: [350, 0, 0]", "xyz: [0.35, 0, 0]"),
    ("[0, 40, 0]", "[0, 0.04, 0]"),
    ("[100, 0, 50]", "[0.1, 0, 0.05]"),
    ("[250, -30, 0]", "[0.25, -0.03, 0]"),
    ("[0, 0, 100]", "[0, 0, 0.1]"),
    ("free_length: 180", "free_length: 0.18"),
    ("stiffness: 4", "stiffness: 4000 N/m"),
)


@pytest.mark.parametrize("changes", [(), METRES], ids=["mm", "m"])
def test_loads_are_slopes_of_the_energy(tmp_path: Path, changes: tuple[tuple[str, str], ...]) -> None:
    text = TEXT
    for change in changes:
        assert change[0] in text
        text = text.replace(*change)
    machine, q = machine_of(tmp_path, text), np.random.default_rng(2).uniform(-1.2, 1.2, (6, 3))
    table = rows(q) if not changes else {f"q{k + 1}": q[:, k] for k in range(3)}
    predictor = Predictor(machine, load_recording(machine, table, need_observations=False), ports=True)
    loads = predictor.loads(predictor.model.p_home, np.zeros((6, 0)))
    for k in range(3):
        expected = [torque(row, k) for row in q]
        np.testing.assert_allclose(loads[f"q{k + 1}.displacement"], expected, rtol=1e-6, atol=1e-6)


def test_an_unknown_stiffness_is_found_and_written_back(tmp_path: Path) -> None:
    """The joint's compliance is known, and the spring is 5 N/mm for 4 on the drawing."""
    rng, read = np.random.default_rng(6), []
    q = rng.uniform(-1.4, 1.4, (60, 3))
    for row in q:
        moved = row + SOFT * np.array([0.0, torque(row, 1, 5.0), 0.0])
        read.append((links(moved)[2] @ [350, 0, 0, 1])[:3] + 0.01 * rng.standard_normal(3))
    table = pd.DataFrame(rows(q) | dict(zip("xyz", np.transpose(read), strict=True)))
    text = TEXT.replace("free_length: 180}", "free_length: 180, tolerance: {stiffness: 1}}") + EFFECT
    done = calibrate(machine_of(tmp_path, text), table)
    found = dict(zip(done.fit.prior.names, zip(done.fit.p, done.fit.std, strict=True), strict=True))
    stiffness, sigma = found["spring.stiffness"]
    product = (
        stiffness * found["joint-compliance@q2:c"][0]
    )  # the gas spring and the arm's weight tell them apart
    assert product == pytest.approx(5.0 * SOFT, rel=0.05)
    assert abs(stiffness - 5.0) < 4 * sigma
    assert sigma < 0.5
    write_calibrated(tmp_path / "out.yaml", done.fit, done.recording)
    again = load_machine(tmp_path / "out.yaml")
    assert again.geometry["spring.stiffness"].nominal == pytest.approx(float(stiffness), rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("from: {in: link1,", "from: {in: lnik1,", "loads.spring.from.in: found 'lnik1'"),
        ("from: {in: link1,", "from: {in: link2,", "loads.spring: found both ends in 'link2'"),
        ("stiffness: 4, ", "", "loads.spring"),
        ("stiffness: 4", "stiffness: 4 kg", "loads.spring.stiffness"),
        ("force: -300", "forces: -300", "loads.gas.forces: unknown field"),
    ],
)
def test_what_is_wrong_is_told(tmp_path: Path, old: str, new: str, found: str) -> None:
    with pytest.raises(InputError) as told:
        machine_of(tmp_path, TEXT.replace(old, new))
    assert found in str(told.value)
