"""A Panda with a ball in sockets: no metrology, two sets, a force sensor mounted in one of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

import truepose
from truepose.identification.fit.estimated import Estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

EVERY = 5
SAGGING = ("q2", "q4")
"""Joints that carry the arm's weight at arm's length."""
PANDA = """schema: truepose/machine/1
name: panda
mechanism:
  type: urdf
  file: {urdf}
  base_link: panda_link0
  tip_link: panda_hand_tcp
  joints: {{{joints}}}
sensor:
{sensors}tolerances: {{length: 0.5, angle: 0.3}}
"""
"""Stated before any fit: 0.1 mm is the arm's repeatability as its maker states it; links of a light arm are good to
half a millimetre, its axes and the zeros of its joints to 0.3 deg, a ball in a gripper to 5 mm."""
_BALL = "type: socket, spacing: 50, sigma: {xyz: 0.1}"
SENSORS = {
    "panda_1": f"{{{_BALL}, ball: [0, 0, 30], tolerance: {{ball: 5}}, sets: [panda_1]}}",
    # a force sensor of unknown height between hand and ball
    "panda_1_with_sensor": f"{{{_BALL}, name: sensor, ball: [0, 0, 30], tolerance: {{ball: [5, 5, 50]}}, "
    "sets: [panda_1_with_sensor]}",
}


def panda_files(
    data: Path, work: Path, sets: Sequence[str] = tuple(SENSORS), name: str = "panda"
) -> tuple[Path, Path]:
    """Machine file and recording of some sets, every fifth row of a socket for validation."""
    folder = data / "panda-ball-socket"
    table = pd.read_csv(folder / "configurations.csv")
    place = table.groupby(["set", "placement", "socket"]).cumcount()
    table["role"] = np.where(place % EVERY == EVERY - 1, "validation", "calibration")
    table[table["set"].isin(sets)].to_csv(work / f"{name}.csv", index=False)
    joints = ", ".join(f"panda_joint{k}: q{k}" for k in range(1, 8))
    sensors = "".join(f"  - {SENSORS[one]}\n" for one in sets)
    text = PANDA.format(urdf=(folder / "panda.urdf").resolve(), joints=joints, sensors=sensors)
    (work / f"{name}.yaml").write_text(text, encoding="utf-8")
    return work / f"{name}.yaml", work / f"{name}.csv"


def panda_scatter(recording: Recording, fit: Estimate) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Distances (mm) of held-out balls, by set: from the mean of the held-out rows of their socket, from the socket."""
    sets = np.array(recording.labels["set"])
    seats = [
        " ".join(key)
        for key in zip(sets, *(recording.labels[c] for c in ("placement", "socket")), strict=True)
    ]
    poses, _ = Predictor(fit.nominal, recording).poses(fit.p)
    values = dict(zip(fit.prior.names, fit.p, strict=True))
    out = {}
    for name in dict.fromkeys(sets.tolist()):
        prefix = "sensor." if name.endswith("with_sensor") else ""
        ball = np.array([values[f"{prefix}ball.{axis}"] for axis in "xyz"])
        rows = np.flatnonzero(recording.validation & (sets == name))
        at = pd.DataFrame(poses[rows, :3, :3] @ ball + poses[rows, :3, 3])
        mean = at.groupby([seats[k] for k in rows]).transform("mean")
        residual = fit.residual[rows] * [c.sigma for s in fit.nominal.sensors for c in s.channels]
        out[str(name)] = (np.linalg.norm(at - mean, axis=1), np.linalg.norm(residual, axis=1))
    return out


def with_gravity(machine_file: Path) -> Machine:
    """The machine, where gravity pulls down in the arm's frame; its file says so from now on."""
    text = machine_file.read_text(encoding="utf-8") + "gravity: [0, 0, -9.80665]\n"
    machine_file.write_text(text, encoding="utf-8")
    return truepose.load_machine(machine_file)


def panda(data: Path, work: Path) -> Iterator[str]:
    """Lines of a table: both sets with one geometry, then each alone; and whether loads bend the same joint the same way."""
    work.mkdir(parents=True, exist_ok=True)
    yield "| fit | set | rows | from the held-out rows' mean | from the fitted socket |"
    yield "|---|---|---|---|---|"
    weighed = []
    for sets in (tuple(SENSORS), *((name,) for name in SENSORS)):
        machine_file, rows = panda_files(data, work, sets)
        machine = truepose.load_machine(machine_file)
        recording = truepose.load_recording(machine, [rows])
        scatter = panda_scatter(recording, truepose.calibrate(machine, recording).fit)
        told = " + ".join(sets)
        for name, (own, seat) in {**scatter, **_pooled(scatter)}.items():
            yield f"| {told} | {name} | {len(own)} | {_rms(own):.3f} mm | {_rms(seat):.3f} mm |"
        heavy = with_gravity(machine_file)
        weighed += [_gives_way(heavy, recording, told, joint) for joint in SAGGING]
    yield from weighed


def _gives_way(machine: Machine, recording: Recording, sets: str, joint: str) -> str:
    """Compliance of one joint alone, 1 kg in the hand, its sigma widened by what is left."""
    carried = len(machine.load_cases) - 1
    term = truepose.parse_effect(f"joint-compliance@{joint}:carries={carried}", machine)
    fit = truepose.estimate(machine, recording, [replace(term, spread=1.0)])
    wide = max(1.0, fit.chi2_per_dof) ** 0.5
    amount, std = 1e6 * fit.p[-1], 1e6 * wide * fit.std[-1]
    return f"{sets}: compliance of {joint} {amount:.0f} ± {std:.0f} µrad/(N m) times kg in the hand"


def _pooled(scatter: dict[str, tuple[np.ndarray, np.ndarray]]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    if len(scatter) == 1:
        return {}
    own, seat = zip(*scatter.values(), strict=True)
    return {"together": (np.concatenate(own), np.concatenate(seat))}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
