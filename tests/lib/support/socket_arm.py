"""A six-axis arm whose ball sits in sockets: the machine file, and recordings from plain numpy.

The numpy arm shares no code with the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import root

from support.plain_kinematics import step
from truepose.arrays import Array
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

ROWS = np.array(  # alpha, d, theta, r of each joint: deg and mm
    [[0, 0, 0, 300], [90, 50, 10, 0], [0, 400, 0, 20], [90, 30, 0, 350], [-90, 0, 0, 10], [90, 0, -20, 90]]
)
ARM = "schema: truepose/machine/1\nname: arm\nmechanism:\n  type: serial\n  joints:\n" + "".join(
    f"    - {{name: q{k}, kind: revolute, alpha: {a}, d: {d}, theta: {t}, r: {r}, range: [-170, 170]}}\n"
    for k, (a, d, t, r) in enumerate(ROWS, 1)
)
TOLERANCES = "tolerances: {length: 0.2, angle: 0.1, beta: 0}\n"
SOCKET = "{type: socket, ball: [5, -10, 80], spacing: 60, sigma: {xyz: 0.05}, tolerance: {ball: 1}}"
BAR = (
    "{type: ballbar, name: bar, centre: [400, 100, 50], ball: [0, 20, 60], sigma: {distance: 0.02}, "
    "tolerance: {centre: 2, ball: [1, 1, 0.5]}}"
)
POSITION = "{type: position, sigma: {xyz: 0.05}}"
SEATS = {  # placement: its two sockets, 60 mm apart
    "front": ((480.0, 60.0, 420.0), (480.0, 120.0, 420.0)),
    "left": ((150.0, 500.0, 380.0), (198.0, 536.0, 380.0)),
    "low": ((380.0, -280.0, 200.0), (380.0, -244.0, 248.0)),
}
NAMES = [f"q{k}.{field}" for k in range(1, 7) for field in ("alpha", "d", "theta", "r")]


def arm(q: Array, rows: Array) -> tuple[Array, Array]:
    """Rotations (n, 3, 3) and positions (n, 3) of the flange: RotX(alpha) TransX(d) RotZ(theta + q) TransZ(r)."""
    pose = np.tile(np.eye(4), (len(q), 1, 1))
    for k, row in enumerate(rows):
        pose = pose @ step([0.0, *row], q[:, k])
    return pose[:, :3, :3], pose[:, :3, 3]


def ball_at(q: Array, rows: Array, ball: Array) -> Array:
    """(n, 3) position of a point of the flange."""
    turn, at = arm(q, rows)
    return np.asarray(at + turn @ ball)


def nominal() -> Array:
    rows = ROWS.astype(float)
    rows[:, [0, 2]] = np.radians(rows[:, [0, 2]])
    return rows


def as_built(rng: np.random.Generator) -> Array:
    """Rows drawn from the tolerances of the machine file."""
    size = np.array([np.radians(0.1), 0.2, np.radians(0.1), 0.2])
    return np.asarray(nominal() + size * rng.standard_normal((6, 4)))


def seated(rng: np.random.Generator, rows: Array, ball: Array, point: Array) -> Array:
    """(6,) random joints that put the ball on a point: the last three at random, the first three solved for."""
    for _ in range(200):
        wrist = rng.uniform(-2.0, 2.0, 3)
        start = rng.uniform(-1.5, 1.5, 3)
        held = ball_at(wrist[None], rows[3:], ball)[0]

        def off(first: Array, held: Array = held) -> Array:
            gap: Array = ball_at(first[None], rows[:3], held)[0] - point
            return gap

        found = root(off, start, tol=1e-12)
        if found.success and np.max(np.abs(found.x)) < 2.9:
            return np.concatenate([found.x, wrist])
    raise AssertionError("the arm does not reach the socket")


def table(rng: np.random.Generator, rows: Array, ball: Array, each: int, sigma: float = 0.05) -> pd.DataFrame:
    """``each`` rows in every socket, with noise of the seat."""
    out = []
    for placement, sockets in SEATS.items():
        for k, point in enumerate(sockets):
            for _ in range(each):
                q = seated(rng, rows, ball, np.array(point) + sigma * rng.standard_normal(3))
                out.append(
                    {"placement": placement, "socket": k}
                    | {f"q{j + 1}": a for j, a in enumerate(np.degrees(q))}
                )
    return pd.DataFrame(out)


def machine_of(folder: Path, *sensors: str, more: str = "") -> Machine:
    path = folder / "arm.yaml"
    listed = "sensor:\n" + "".join(f"  - {sensor}\n" for sensor in sensors)
    path.write_text(ARM + listed + TOLERANCES + more, encoding="utf-8")
    return load_machine(path)


def read(folder: Path, machine: Machine, frame: pd.DataFrame) -> Recording:
    frame.to_csv(folder / "rows.csv", index=False)
    return load_recording(machine, [folder / "rows.csv"])


def campaign(folder: Path, seed: int, each: int = 4) -> tuple[Machine, Recording, Array, Array]:
    """A machine with a socket, rows of an arm drawn from its tolerances, and that arm: rows, ball."""
    rng = np.random.default_rng(seed)
    rows, ball = as_built(rng), np.array([5.0, -10.0, 80.0]) + rng.standard_normal(3)
    machine = machine_of(folder, SOCKET)
    return machine, read(folder, machine, table(rng, rows, ball, each)), rows, ball


def residuals(predictor: Predictor, p: Array, weight: Array | NDArray[np.bool_] | None = None) -> Array:
    x, _ = predictor.assemble(p)
    return np.concatenate([block.residual for block in predictor.blocks(p, x, weight)])
