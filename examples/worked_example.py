"""A worked example: plain calibration hides an error; truepose finds it, proves it on new rows and corrects it in C.

    python examples/worked_example.py

A swing arm on a lift: the lift goes up and down, the swing turns an arm of 500 mm about the vertical. A laser tracker of 20 um
stands somewhere beside it and sees the arm's tip. The swing's encoder tape is 0.2 % too long, and nobody knows.
``docs/worked-example.md`` explains what is printed.
"""

from __future__ import annotations

import runpy
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import truepose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

MACHINE = """
schema: truepose/machine/1
name: swing_arm
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: lift, kind: prismatic, range: [-200, 200]}
    - {name: swing, kind: revolute, range: [-60, 60]}
frames:
  base: {in: world, tolerance: {xyz: .inf, rpy: .inf}}                   # nobody knows where the tracker stands
  tool: {in: flange, xyz: [500, 0, 0], tolerance: {xyz: 0.1, rpy: 0}}    # the arm's length, from the drawing
sensor: {type: position, sigma: {xyz: 0.02}}
tolerances: {length: 0.1, angle: 0.02}
"""
SCALE, LENGTH, NOISE = 1.002, 499.95, 0.02
"""The machine as built: true turn over reading, length of the arm (mm), 1-sigma of the tracker (mm)."""
Array = NDArray[np.float64]


def tip(lift: Array, swing: Array) -> Array:
    """(n, 3) where the real arm's tip is, mm, in the frame of the lift. Readings in mm and deg. Uses nothing of truepose."""
    turn = np.radians(SCALE * swing)
    return np.column_stack([LENGTH * np.cos(turn), LENGTH * np.sin(turn), lift])


def seen(lift: Array, swing: Array) -> Array:
    """(n, 3) the same in the frame of the tracker, which stands 2 m away and is turned by 30 deg."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    where: Array = tip(lift, swing) @ turned + [2000.0, 300.0, 900.0]
    return where


def measure(rows: int, widest: float, role: str, rng: np.random.Generator) -> pd.DataFrame:
    """A recording at random poses, the swing within ``widest`` deg, with the tracker's noise."""
    lift, swing = rng.uniform(-200.0, 200.0, rows), rng.uniform(-widest, widest, rows)
    x, y, z = (seen(lift, swing) + NOISE * rng.standard_normal((rows, 3))).T
    return pd.DataFrame({"lift": lift, "swing": swing, "x": x, "y": y, "z": z, "role": role})


def calibrate(machine: Machine, recording: Recording) -> Iterator[str]:
    """Plain calibration: the residuals are as small as the noise, and the arm is longer than the drawing allows."""
    plain = truepose.estimate(machine, recording)
    length = plain.to_frame().set_index("parameter").loc["tool.x"]
    rms, noise = NOISE * np.sqrt([np.mean(np.sum(plain.residual[plain.used] ** 2, axis=1)), 3.0])
    yield f"  residuals {1e3 * rms:.0f} um rms, noise {1e3 * noise:.0f} um; chi2 {plain.chi2_per_dof:.2f}"
    yield f"  arm {length.value:.2f} mm, drawing 500 mm: {length.in_tolerances:.1f} tolerances away"


def said(result: Diagnosis) -> Iterator[str]:
    """What is found, how sure each level of it is, and what it is worth on the rows of role validation."""
    for found in result.findings:
        size, levels = found.parameters["s"], found.levels
        yield f"  {found.effect} at {found.place[0]}, s = {size.value:.2e} +- {size.std:.1e}"
        yield f"  place {levels.place:.2f}, driver {levels.driver:.2f}, law {found.probability:.2f}"
        for other in (other for other in found.equivalents if other.probability > 0.05):
            yield f"  or else: {other.effect} {other.probability:.2f}"
    yield f"  concealed: {'yes' if result.concealed else 'no'}"
    if result.applied and result.applied.pose:
        plain, model = 1e3 * result.applied.pose.plain, 1e3 * result.applied.pose.model
        yield f"  new rows: {plain:.0f} um with plain calibration, {model:.0f} um with the improved model"


def control(result: Diagnosis, recording: Recording, folder: Path) -> Iterator[str]:
    """Generate C from the result, compile it, and let it correct a swing from one end to the other."""
    truepose.write_calibrated(folder / "improved.yaml", result.after, recording)
    truepose.generate(truepose.load_machine(folder / "improved.yaml"), folder / "controller")
    wrapper = runpy.run_path(str(folder / "controller" / "wrappers" / "swing_arm_kin.py"))
    wanted = np.linspace(-55.0, 55.0, 23)
    commands, _ = wrapper["build"]().compensate_n(np.column_stack([np.zeros(23), np.radians(wanted)]))
    ideal = tip(np.zeros(23), wanted / SCALE)
    for sender, swing in (("the drawing", wanted), ("the generated C", np.degrees(commands[:, 1]))):
        error = np.linalg.norm(tip(np.zeros(23), swing) - ideal, axis=1).max()
        yield f"  with commands of {sender} the tip is up to {error:.2f} mm off"


def story(folder: Path) -> Iterator[str]:
    """The lines of the whole example, in four steps."""
    rng = np.random.default_rng(1)
    near, wide = measure(60, 15.0, "calibration", rng), measure(20, 60.0, "calibration", rng)
    new = measure(20, 60.0, "validation", rng)
    (folder / "machine.yaml").write_text(MACHINE, encoding="utf-8")
    machine = truepose.load_machine(folder / "machine.yaml")
    recording = truepose.load_recording(machine, pd.concat([near, new]))
    yield "1 plain calibration, 60 rows, swing within 15 deg"
    yield from calibrate(machine, recording)
    yield "2 diagnosis of the same rows"
    yield from said(truepose.diagnose(machine, recording))
    yield "3 diagnosis with 20 rows more, swing within 60 deg"
    recording = truepose.load_recording(machine, pd.concat([near, wide, new]))
    result = truepose.diagnose(machine, recording)
    yield from said(result)
    yield "4 C for the controller"
    yield from control(result, recording, folder)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        sys.stdout.writelines(f"{line}\n" for line in story(Path(name)))
