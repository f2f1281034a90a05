"""Whether a line of 81 to 160 cycles a turn of a joint is named without a stated gear ratio, and none where there is none.

Arms of six joints in plain numpy, apart from the library: the joint turns by a sine beside its reading, a tracker reads the
tool's point. Every fourth arm has no line. ``python -m benchmarks.lines_study 24``.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

Array = NDArray[np.float64]
ROWS, SIGMA, AMPLITUDE = 150, 0.02, 2.5e-4
"""Poses, the tracker's noise (mm), and how far the joint errs (rad)."""
ORDERS = (81, 100, 101, 128, 160)
LINKS = ((0, 0, 400, 0), (-90, 25, 0, -90), (0, 455, 0, 0), (-90, 35, 420, 0), (90, 0, 0, 0), (-90, 0, 80, 0))
"""alpha (deg), d, r (mm), theta (deg) of each joint."""
RANGES = ((-160, 160), (-60, 120), (-120, 60), (-180, 180), (-110, 110), (-180, 180))
TAIL = """
frames: {base: {tolerance: {xyz: 5, rpy: 1}}, tool: {in: flange, xyz: [0, 0, 100], tolerance: {xyz: 1}}}
sensor: {type: position, sigma: {xyz: 0.02}}
tolerances: {length: 0.1, angle: 0.05}
"""


def point(q: Array) -> Array:
    """(3,) the tool's point, mm, for joint angles (6,), rad."""
    turn, at = Rotation.identity(), np.zeros(3)
    for (alpha, d, r, theta), angle in zip(LINKS, q, strict=True):
        turn = turn * Rotation.from_euler("x", alpha, degrees=True)
        at = at + turn.apply([d, 0.0, 0.0])
        turn = turn * Rotation.from_euler("z", np.radians(theta) + angle)
        at = at + turn.apply([0.0, 0.0, r])
    return np.asarray(at + turn.apply([0.0, 0.0, 100.0]))


def line_of(seed: int) -> tuple[int, int] | None:
    """Joint and order of an arm's line."""
    rng = np.random.default_rng(1000 + seed)
    joint, order = int(rng.integers(0, 5)), int(rng.choice(ORDERS))
    return (joint, order) if seed % 4 else None


def write(folder: Path, seed: int) -> None:
    """Machine file and recording of one arm."""
    rng, line = np.random.default_rng(seed), line_of(seed)
    low, high = np.radians(RANGES).T
    q = rng.uniform(low, high, (ROWS, 6))
    turned = q + rng.normal(0.0, 5e-4, 6)
    if line is not None:
        joint, order = line
        turned[:, joint] += AMPLITUDE * np.sin(order * q[:, joint] + rng.uniform(0.0, 2.0 * np.pi))
    seen = np.array([point(row) for row in turned]) + rng.normal(0.0, SIGMA, (ROWS, 3))
    text = "schema: truepose/machine/1\nname: arm\nmechanism:\n  type: serial\n  joints:\n"
    for k, ((alpha, d, r, theta), ends) in enumerate(zip(LINKS, RANGES, strict=True), start=1):
        own = (
            f"name: q{k}, kind: revolute, alpha: {alpha}, d: {d}, theta: {theta}, r: {r}, range: {list(ends)}"
        )
        text += f"    - {{{own}}}\n"
    (folder / "arm.yaml").write_text(text + TAIL)
    columns = {f"q{k + 1}": np.degrees(q[:, k]) for k in range(6)}
    pd.DataFrame(columns | dict(zip("xyz", seen.T, strict=True))).to_csv(folder / "arm.csv", index=False)


def right(folder: Path, seed: int) -> bool:
    """Whether the line alone is named, at its joint and order; or nothing, where there is none."""
    write(folder, seed)
    machine, line = load_machine(folder / "arm.yaml"), line_of(seed)
    found = diagnose(machine, load_recording(machine, [folder / "arm.csv"]))
    named = [(f.effect, f.place) for f in found.findings]
    if line is None:
        return not named
    joint, order = line
    labels = {e.label for e in found.after.effects}
    place = (f"q{joint + 1}",)
    return (
        named == [("transmission-error", place)] and f"transmission-error@{place[0]},order={order}" in labels
    )


def main(count: int) -> None:
    """Counts of arms with and without a line."""
    with tempfile.TemporaryDirectory() as folder:
        good = [right(Path(folder), seed) for seed in range(count)]
    for what, own in (("a line", [k for k in range(count) if k % 4]), ("none", list(range(0, count, 4)))):
        sys.stdout.write(f"{what}: right in {sum(good[k] for k in own)} of {len(own)}\n")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 24)
