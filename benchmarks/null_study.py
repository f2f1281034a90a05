"""Nothing is missing: how often does the diagnosis say so?

    python benchmarks/null_study.py [SEEDS PER MACHINE] [JOBS]

Two machines: the telescope (``telescope_simulator``, rigid platform) and a 6R arm whose forward kinematics are
written out here in numpy. Both log payload, approach, time and temperatures that do nothing. Prints the share
of recordings found ``adequate``, with its Wilson interval, and every other verdict.
"""

from __future__ import annotations

import io
import sys

import numpy as np
import pandas as pd
from joblib import Parallel, delayed
from studies import diagnose_texts, wilson
from telescope_simulator import draw_machine, machine_text, paper_poses, recording_text, simulate

# Khalil-Kleinfinger rows: beta, alpha (deg), d, theta (deg), r (mm)
ARM = [
    (0, 0, 0, 0, 450),
    (0, -90, 200, -90, 0),
    (0, 0, 800, 0, 0),
    (0, -90, 30, 0, 700),
    (0, 90, 0, 0, 0),
    (0, -90, 0, 0, 190),
]
RANGES = [160, 70, 70, 150, 100, 170]
LENGTH, ANGLE, SIGMA = 0.3, 0.03, 0.015
BASE, TOOL = (1800.0, -200.0, 100.0), (40.0, -20.0, 120.0)


def arm_machine() -> str:
    """The arm's machine file."""
    fields = ("beta", "alpha", "d", "theta", "r")
    joints = "\n".join(
        f"    - {{name: q{k}, kind: revolute, {', '.join(f'{f}: {v}' for f, v in zip(fields, row, strict=True))}, "
        f"range: [{-limit}, {limit}], gear_ratio: 121}}"
        for k, (row, limit) in enumerate(zip(ARM, RANGES, strict=True), start=1)
    )
    masses = "\n".join(
        f"  link{k}: {{kg: {kg}, com: [{x}, 0, {z}], in: link{k}}}"
        for k, kg, x, z in (
            (2, 150, 380, 0),
            (3, 90, 0, 40),
            (4, 50, 0, -300),
            (5, 25, 0, 20),
            (6, 6, 0, -40),
        )
    )
    return f"""schema: truepose/machine/1
name: arm
units: {{length: mm, angle: deg}}
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
{joints}
frames:
  base: {{in: world, xyz: {list(BASE)}, rpy: [0, 0, 150], tolerance: {{xyz: 5, rpy: 1}}}}
  tool: {{in: flange, xyz: {list(TOOL)}, rpy: [0, 0, 0], tolerance: {{xyz: 1, rpy: 0.5}}}}
sensor: {{type: position, sigma: {{xyz: {SIGMA}}}}}
tolerances: {{length: {LENGTH}, angle: {ANGLE}}}
masses:
{masses}
  payload: {{kg: 0, com: [0, 0, 60], in: tool}}
"""


def arm_recording(seed: int, poses: int = 40) -> str:
    """Positions of the tool of one drawn arm, each pose measured twice, from both sides."""
    rng = np.random.default_rng(seed)
    rows = np.array(ARM, dtype=float)
    rows[:, [0, 1, 3]] = np.deg2rad(rows[:, [0, 1, 3]] + rng.normal(0, ANGLE, (6, 3)))
    rows[:, [2, 4]] += rng.normal(0, LENGTH, (6, 2))
    base = _rpy(np.deg2rad(np.array([0, 0, 150]) + rng.normal(0, 1, 3)))
    origin, tool = np.array(BASE) + rng.normal(0, 5, 3), np.array(TOOL) + rng.normal(0, 1, 3)
    q = np.round(rng.uniform(-1, 1, (poses, 6)) * RANGES, 3)
    table = pd.DataFrame(np.repeat(q, 2, axis=0), columns=[f"q{k}" for k in range(1, 7)])
    n = len(table)
    side = np.tile([1, -1], poses)
    columns = {
        "pose": np.repeat(np.arange(1, poses + 1), 2),
        "time": np.cumsum(rng.uniform(30, 80, n)).round(1),
    }
    columns |= {f"approach.q{k}": side for k in range(1, 7)} | {"payload": rng.choice([0, 5, 20], n)}
    columns |= {
        f"temperature.{p}": (21 + np.cumsum(rng.normal(0, 0.05, n))).round(4)
        for p in ("base", "link2", "link3")
    }
    points = np.array([origin + base @ _tip(rows, np.deg2rad(row), tool) for row in table.to_numpy()])
    points += rng.normal(0, SIGMA, points.shape)
    table = pd.concat([pd.DataFrame(columns), table, pd.DataFrame(points, columns=["x", "y", "z"])], axis=1)
    out = io.StringIO()
    table.to_csv(out, index=False, float_format="%.7f")
    return out.getvalue()


def _tip(rows: np.ndarray, q: np.ndarray, tool: np.ndarray) -> np.ndarray:
    rotation, position = np.eye(3), np.zeros(3)
    for (beta, alpha, d, theta, r), angle in zip(rows, q, strict=True):
        rotation = rotation @ _axis(beta, 1) @ _axis(alpha, 0)
        position = position + rotation[:, 0] * d
        rotation = rotation @ _axis(theta + angle, 2)
        position = position + rotation[:, 2] * r
    tip: np.ndarray = position + rotation @ tool
    return tip


def _axis(angle: float, axis: int) -> np.ndarray:
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.eye(3)
    out[i, i] = out[j, j] = np.cos(angle)
    out[i, j], out[j, i] = -np.sin(angle), np.sin(angle)
    return out


def _rpy(angles: np.ndarray) -> np.ndarray:
    turn: np.ndarray = _axis(angles[2], 2) @ _axis(angles[1], 1) @ _axis(angles[0], 0)
    return turn


def one(machine: str, seed: int) -> tuple[str, int, str, str]:
    """Machine, seed, verdict and what was named or left."""
    if machine == "arm":
        found = diagnose_texts(arm_machine(), arm_recording(seed))
    else:
        roles, rho = paper_poses()
        drawn = simulate(draw_machine(seed=seed), rho, ring_stiffness=np.inf, seed=seed)
        found = diagnose_texts(machine_text(), recording_text(drawn, roles))
    said = ", ".join(f"{f.effect}@{'+'.join(f.place)}" for f in found.findings)
    return machine, seed, found.verdict, said or (found.remainder.form if found.remainder else "")


def main(seeds: int, jobs: int) -> None:
    """Run the study and print its table."""
    tasks = [(machine, seed) for machine in ("telescope", "arm") for seed in range(1000, 1000 + seeds)]
    rows = Parallel(n_jobs=jobs)(delayed(one)(*task) for task in tasks)
    quiet = sum(verdict == "adequate" for _, _, verdict, _ in rows)
    low, high = wilson(quiet, len(rows))
    lines = [f"{m} seed {s}: {v} {said}" for m, s, v, said in rows if v != "adequate"]
    lines.append(
        f"adequate {quiet} of {len(rows)} ({100 * quiet / len(rows):.1f} %, 95 % {100 * low:.1f}-{100 * high:.1f} %)"
    )
    sys.stdout.write("\n".join(lines) + "\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, int(sys.argv[2]) if len(sys.argv) > 2 else 2)
