"""Which measurement poses calibrate the telescope best? Figs. 13-14 of the paper, by ``truepose plan``'s methods.

    python -m benchmarks.telescope.pose_choice_study [REPEATS] [JOBS] [OUTDIR]

A perfect 6-PUS is the true machine; the calibration starts from a drawing that is off by N(0, 0.5 mm) on joint
centres and legs and N(0, 0.1 deg) on the rails. 8 to 40 poses are chosen on that drawing inside the actuators'
+-1.3 mm: at random, by exchange among 600 random poses, by exchange among the candidates of ``truepose plan``
(half of them stand at the ends or the middle of each range), or continuously. There the true machine's poses are
measured with 2 um and 8 urad (``inverse.py``, which shares no code with truepose), truepose calibrates, and the
calibrated parameters' poses are compared with the true ones at 200 other travels. Prints tables and draws
OUTDIR/telescope_pose_choice.svg.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from figures import Series, write_chart
from truepose.identification.fit.estimate import estimate
from truepose.identification.leaves.planning.information import CANDIDATES
from truepose.identification.leaves.planning.plan import Plan, plan
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

from .inverse import TRAVEL, Geometry, drawing, pose

Array = NDArray[np.float64]
COUNTS = (8, 10, 14, 20, 30, 40)
METHODS = ("random", "exchange among random", "exchange", "continuous")
UNCERTAIN, TILT = 0.5, float(np.radians(0.1))  # mm, rad
SIGMA, SIGMA_TURN = 0.002, 8e-6  # mm, rad: 2 um at the platform's radius
CHECKS = 200
EDGE = 0.01  # of the range
FIGURES = Path(__file__).resolve().parents[3] / "docs" / "figures"


@dataclass(frozen=True)
class Run:
    """One design: error (um and urad, means over the checks), criterion, seconds, shares at the ranges' ends."""

    count: int
    method: str
    position: float
    rotation: float
    criterion: float
    seconds: float
    values_at_end: float
    poses_at_end: float


def machine_text(geometry: Geometry) -> str:
    """Machine file with the drawing ``geometry`` and the tolerances it was drawn with."""
    legs = "\n".join(
        f"    - {{name: leg{i + 1}, joint: rho{i + 1}, a: {_row(geometry.a[i])}, u: {_row(geometry.rails[i])}, "
        f"b: {_row(geometry.b[i])}, length: {float(geometry.length[i])!r}, range: [{-TRAVEL}, {TRAVEL}]}}"
        for i in range(6)
    )
    across = f"[{UNCERTAIN}, {UNCERTAIN}, 0]"
    overrides = ", ".join(f"leg{i}.a: {across}, leg{i}.b: {across}, leg{i}.offset: 0" for i in range(1, 7))
    return f"""schema: truepose/machine/1
name: telescope
units: {{length: mm, angle: rad}}
mechanism:
  type: 6-pus
  legs:
{legs}
  home: [0, 0, 440, 0, 0, 0]
sensor: {{type: pose, sigma: {{xyz: {SIGMA}, rot: {SIGMA_TURN}}}}}
tolerances: {{length: {UNCERTAIN}, angle: {TILT!r}, {overrides}}}
"""


def recording_text(true: Geometry, rho: Array, rng: np.random.Generator) -> str:
    """CSV of travels (n, 6) and of the true machine's poses as measured."""
    lines = ["rho1,rho2,rho3,rho4,rho5,rho6,x,y,z,rx,ry,rz"]
    for row in rho:
        position, turn = pose(true, row)
        seen = position + SIGMA * rng.standard_normal(3)
        noise = Rotation.from_rotvec(SIGMA_TURN * rng.standard_normal(3)).as_matrix()
        vector = Rotation.from_matrix(turn @ noise).as_rotvec()
        lines.append(",".join(repr(float(v)) for v in (*row, *seen, *vector)))
    return "\n".join(lines) + "\n"


def run(count: int, method: str, repeat: int) -> Run:
    """Choose poses on a wrong drawing, measure the true machine there, calibrate, and judge elsewhere."""
    true = drawing()
    guess = true.moved(np.random.default_rng([1, repeat]), UNCERTAIN, TILT)
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        (at / "machine.yaml").write_text(machine_text(guess))
        machine = load_machine(at / "machine.yaml")
        begun = time.perf_counter()
        chosen = choice(machine, count, method, repeat)
        seconds = time.perf_counter() - begun
        rng = np.random.default_rng([2, count, repeat])  # the same noise for every method
        (at / "recording.csv").write_text(recording_text(true, chosen.q, rng))
        fit = estimate(machine, load_recording(machine, [at / "recording.csv"]))
    values = {parameter.name: float(v) for parameter, v in zip(machine.parameters, fit.p, strict=True)}
    position, rotation = judged(true, calibrated(values))
    ends = np.abs(chosen.q) >= TRAVEL * (1 - 2 * EDGE)
    shares = (float(ends.mean()), float(ends.any(axis=1).mean()))
    return Run(count, method, position, rotation, chosen.value, seconds, *shares)


def choice(machine: Machine, count: int, method: str, repeat: int) -> Plan:
    """The plan of one of ``METHODS``."""
    if method != "exchange among random":
        return plan(machine, count, method=method, seed=repeat)
    given = np.random.default_rng([4, repeat]).uniform(-TRAVEL, TRAVEL, (CANDIDATES, 6))
    return plan(machine, count, method="exchange", seed=repeat, candidates=given)


def calibrated(values: dict[str, float]) -> Geometry:
    """The geometry that parameters by name describe."""
    legs = [f"leg{i}" for i in range(1, 7)]
    points = [np.array([[values[f"{leg}.{p}.{c}"] for c in "xyz"] for leg in legs]) for p in "ab"]
    u = np.array([[values[f"{leg}.u.{c}"] for c in "xy"] for leg in legs])
    return Geometry(points[0], points[1], u, np.array([values[f"{leg}.length"] for leg in legs]))


def judged(true: Geometry, found: Geometry) -> tuple[float, float]:
    """Mean errors of position (um) and rotation (urad) at travels that were not measured."""
    rho = np.random.default_rng(3).uniform(-TRAVEL, TRAVEL, (CHECKS, 6))
    errors = np.empty((CHECKS, 2))
    for k, row in enumerate(rho):
        (p, r), (q, s) = pose(true, row), pose(found, row)
        errors[k] = np.linalg.norm(p - q), np.linalg.norm(Rotation.from_matrix(r.T @ s).as_rotvec())
    return float(1e3 * errors[:, 0].mean()), float(1e6 * errors[:, 1].mean())


def table(runs: list[Run]) -> str:
    """Markdown: errors by number of poses and method, then what it took and where the poses lie."""
    rows = ["| poses | " + " | ".join(f"{m}: position, um | {m}: rotation, urad" for m in METHODS) + " |"]
    rows.append("|---" * (1 + 2 * len(METHODS)) + "|")
    for count in COUNTS:
        cells = []
        for method in METHODS:
            some = [r for r in runs if (r.count, r.method) == (count, method)]
            for values in ([r.position for r in some], [r.rotation for r in some]):
                cells.append(f"{np.mean(values):.2f} +- {np.std(values):.2f}")
        rows.append(f"| {count} | " + " | ".join(cells) + " |")
    rows += [
        "",
        "| method | criterion at 40 poses | time at 40 poses, s | travels at an end | poses with one |",
    ]
    rows.append("|---|---|---|---|---|")
    for method in METHODS:
        some = [r for r in runs if (r.count, r.method) == (COUNTS[-1], method)]
        c, t, v, p = (
            [getattr(r, field) for r in some]
            for field in ("criterion", "seconds", "values_at_end", "poses_at_end")
        )
        rows.append(
            f"| {method} | {np.mean(c):.2f} +- {np.std(c):.2f} | {np.mean(t):.1f} | {np.mean(v):.0%} | {np.mean(p):.0%} |"
        )
    return "\n".join(rows) + "\n"


def draw(runs: list[Run], path: Path) -> None:
    """Position error against the number of poses, as in Fig. 14."""
    series = []
    for k, method in enumerate(METHODS):
        errors = [[r.position for r in runs if (r.count, r.method) == (count, method)] for count in COUNTS]
        x = [count + 0.3 * (k - 1.5) for count in COUNTS]
        mean, spread = [float(np.mean(e)) for e in errors], [float(np.std(e)) for e in errors]
        series.append(Series(method, x, mean, "both", spread))
    title = "Telescope calibrated from chosen poses"
    write_chart(path, title, "measured poses", "position error after calibration, um", series)


def main(repeats: int, jobs: int, folder: Path) -> None:
    """Run the study, print its tables, draw its figure."""
    cases = [(c, m, r) for c in COUNTS for m in METHODS for r in range(repeats)]
    runs = list(Parallel(n_jobs=jobs)(delayed(run)(*case) for case in cases))
    draw(runs, folder / "telescope_pose_choice.svg")
    sys.stdout.write(table(runs))


def _row(values: Array) -> str:
    return "[" + ", ".join(repr(float(v)) for v in values) + "]"


if __name__ == "__main__":
    given = sys.argv[1:]
    main(
        int(given[0]) if given else 17,
        int(given[1]) if len(given) > 1 else -1,
        Path(given[2]) if len(given) > 2 else FIGURES,
    )
