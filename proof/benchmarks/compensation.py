"""Seconds that a path of a million points takes: read, solve, write; a polisher, a hexapod and a six-axis arm.

    python -m benchmarks.compensation [-n 1000000] [polisher] [hexapod] [arm]

Machines stand as far off their drawings as their tolerances say, the arm gives way under a payload that the path logs.
The path is a smooth curve. The first solution of a machine includes its compiler; it is solved again without.

Seen on two cores of a shared virtual machine: 0.9 to 1.6 s to solve 40,000 rows, some 40 us a row for longer paths.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.identification.compensation.compensate import compensate
from truepose.identification.compensation.path_table import commands, path_rows
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predict import simulate, with_inputs
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.table import read_table
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ARM = """
schema: truepose/machine/1
name: arm
units: {length: mm, angle: deg}
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: -90, d: 25, theta: -90, range: [-120, 60]}
    - {name: q3, kind: revolute, d: 455, range: [-100, 120]}
    - {name: q4, kind: revolute, alpha: -90, d: 35, r: 420, range: [-180, 180]}
    - {name: q5, kind: revolute, alpha: 90, range: [-120, 120]}
    - {name: q6, kind: revolute, alpha: -90, r: 80, range: [-350, 350]}
frames: {tool: {in: flange, xyz: [10, 0, 120], rpy: [0, 20, 0], tolerance: {xyz: 1, rpy: 0.5}}}
sensor: {type: pose, sigma: {xyz: 0.01, rot: 0.001}}
tolerances: {length: 0.2, angle: 0.05}
masses:
  forearm: {kg: 12, com: [0, 0, 100], in: link4}
  payload: {kg: 2, com: [0, 0, 50], in: tool}
drivers: [payload]
effects:
  - {effect: joint-compliance, place: [q2], parameters: {c: {value: 4.0e-6, unit: rad/(N*m)}}}
"""
HEXAPOD = """
schema: truepose/machine/1
name: hexapod
units: {length: mm, angle: deg}
mechanism:
  type: 6-ups
  legs:
    - {name: leg1, joint: m1, a: [200, -40, 0], b: [70, -120, 0], range: [270, 340]}
    - {name: leg2, joint: m2, a: [200, 40, 0], b: [70, 120, 0], range: [270, 340]}
    - {name: leg3, joint: m3, a: [-65, 193, 0], b: [69, 121, 0], range: [270, 340]}
    - {name: leg4, joint: m4, a: [-135, 153, 0], b: [-139, 1, 0], range: [270, 340]}
    - {name: leg5, joint: m5, a: [-135, -153, 0], b: [-139, -1, 0], range: [270, 340]}
    - {name: leg6, joint: m6, a: [-65, -193, 0], b: [69, -121, 0], range: [270, 340]}
  home: [0, 0, 260, 0, 0, 0]
frames: {tool: {in: flange, xyz: [0, 0, 25], rpy: [0, 0, 5], tolerance: {xyz: 1, rpy: 0.5}}}
sensor: {type: pose, sigma: {xyz: 0.005, rot: 0.002}}
tolerances: {length: 0.1, angle: 0.1}
"""
POLISHER = files("truepose.models") / "machines" / "polisher" / "machine.yaml"
MACHINES = {"polisher": POLISHER.read_text(encoding="utf-8"), "hexapod": HEXAPOD, "arm": ARM}
MIDDLE = {"arm": (0.2, 0.3, 0.2, 0.1, 0.9, 0.3)}
"""Joints around which a machine moves, where the middle of the ranges would be singular."""
SHARE = 0.1
"""Of a range that a joint moves by, to either side."""


def calibrated(name: str, folder: Path) -> Machine:
    """The machine off its drawing by its tolerances, as a calibration would have written it."""
    drawing = folder / "machine.yaml"
    drawing.write_text(MACHINES[name], encoding="utf-8")
    machine = load_machine(drawing)
    poses = folder / "poses.csv"
    _path(machine, name, 40).to_csv(poses, index=False)
    read = load_recording(machine, [poses], need_observations=False)
    with_inputs(read_table(poses), simulate(machine, read, seed=1)).to_csv(
        folder / "recording.csv", index=False
    )
    recording = load_recording(machine, [folder / "recording.csv"])
    fit = estimate(machine, recording)
    off = np.where(np.isfinite(fit.prior.sigma), fit.prior.sigma, 0.0)
    off *= np.random.default_rng(2).normal(size=len(off)) * np.array(["@" not in n for n in fit.prior.names])
    write_calibrated(folder / "calibrated.yaml", replace(fit, p=fit.prior.mean + off), recording)
    return load_machine(folder / "calibrated.yaml")


def _path(machine: Machine, name: str, count: int) -> pd.DataFrame:
    """Every joint to and fro, each at its own pace; a payload that grows where the machine has one."""
    data, share = {}, np.linspace(0.0, 1.0, count)
    for k, actuator in enumerate(machine.mechanism.actuators):
        low, high = actuator.range or (-1.0, 1.0)
        middle = MIDDLE[name][k] if name in MIDDLE else (low + high) / 2
        column = middle + SHARE * (high - low) / 2 * np.sin(2 * np.pi * (3 * k + 5) * share + k)
        data[f"{actuator.reading} [{actuator.reading_unit}]"] = column
    return pd.DataFrame({**data, "payload": 5 * share} if name == "arm" else data)


def run(name: str, count: int, folder: Path, say: Callable[[str], object] = print) -> None:
    """Time one machine."""
    machine, path = calibrated(name, folder), folder / "path.csv"
    _path(machine, name, count).to_csv(path, index=False)
    marks = [time.perf_counter()]
    table, rows = path_rows(machine, read_table(path))
    marks.append(time.perf_counter())
    found = compensate(machine, rows)
    marks.append(time.perf_counter())
    found = compensate(machine, rows)
    marks.append(time.perf_counter())
    commands(table, machine, found).to_csv(folder / "commands.csv", index=False)
    marks.append(time.perf_counter())
    read, first, again, write = np.diff(marks)
    before, after = (np.max(np.linalg.norm(twists[:, :3], axis=1)) for twists in (found.before, found.after))
    say(
        f"{name}, {count} rows: read {read:.2f} s, solve {first:.2f} s (again: {again:.2f} s), "
        f"write {write:.2f} s; {before:.3g} mm before, {after:.2g} mm after"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Time the machines named."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("machines", nargs="*", metavar="|".join(MACHINES), help="which (default: all)")
    parser.add_argument("-n", type=int, default=1_000_000, help="rows of the path")
    options = parser.parse_args(arguments)
    for name in options.machines or MACHINES:
        with tempfile.TemporaryDirectory() as folder:
            run(name, options.n, Path(folder))


if __name__ == "__main__":
    main()
