"""Whether the way that joints came is told from the order of rows alone: play, readings before standstill, and neither.

Simulated by plain numpy, by other means than the catalogue: joints follow synchronised trapezoids, the link hangs in a
clearance and is pushed along in small steps of time, an early reading is a point of that motion, a controller's tail decays
or swings. Beside it some arms have gear waves and joints that yield. ``python -m benchmarks.arrival_study --arms 12``.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import truepose
from truepose.identification.diagnosis.result import Diagnosis

Array = NDArray[np.float64]
ARMS = {
    "elbow": [(0, 0, 330), (-90, 75, 0), (0, 320, 0), (-90, 35, 340), (90, 0, 0), (-90, 0, 80)],
    "cobot": [(0, 0, 128), (90, 0, 0), (0, -612, 0), (0, -572, 164), (90, 0, 116), (-90, 0, 92)],
}
"""alpha (deg), d, r (mm) of each joint: RotX(alpha) TransX(d) RotZ(q) TransZ(r)."""
RANGE = np.radians([160, 110, 130, 170, 115, 175])
LENGTH, ANGLE, XYZ, TURN = 0.2, np.radians(0.05), 0.02, np.radians(0.003)
GRAVITY, KG, COM = 9.81, (12.0, 8.0, 3.0), (1, 2, 5)
"""N / kg, masses and the bodies (0-based) that carry them, at their frames' origins 150 mm along x."""
LEVER = np.array([150.0, 0.0, 0.0])
NOT_FIRST = np.array([0.0, 1, 1, 1, 1, 1])
"""The first joint's constants are the base's, which stands anywhere."""
KINDS = ("play", "early", "neither")
FASTEST = np.radians([120, 120, 150, 220, 220, 300])
BRAKES = {"elbow": np.radians([400, 350, 500, 900, 900, 1200]), "cobot": np.full(6, np.radians(500))}
"""rad/s, rad/s^2. A cobot's joints brake alike; a wrist that brakes harder makes the longest way another than the slowest."""
SMALL_STEPS = 400


@dataclass(frozen=True)
class Arm:
    """What is true of one arm: geometry with its errors, where (a joint, or None for all), and how large."""

    name: str
    alpha: Array
    d: Array
    theta: Array
    r: Array
    tool: Array
    waves: Array
    yields: Array
    joint: int | None
    size: float
    tail: str = ""

    def bodies(self, q: Array) -> list[Array]:
        """(4, 4) of every body at joint angles (6,)."""
        out, at = [], np.eye(4)
        for alpha, d, theta, r in zip(self.alpha, self.d, self.theta + q, self.r, strict=True):
            turn = Rotation.from_euler("x", alpha) * Rotation.from_euler("z", theta)
            step = np.eye(4)
            step[:3, :3] = turn.as_matrix()
            step[:3, 3] = np.array([d, 0.0, 0.0]) + Rotation.from_euler("x", alpha).apply([0, 0, r])
            at = at @ step
            out.append(at)
        return out

    def height(self, q: Array) -> float:
        """Potential energy, N mm."""
        bodies = self.bodies(q)
        return sum(GRAVITY * kg * float((bodies[k] @ [*LEVER, 1])[2]) for kg, k in zip(KG, COM, strict=True))

    def stands(self, q: Array) -> Array:
        """(6,) where joints are that should be at q: gears wave, and gravity pulls."""
        off = self.waves[:, 0] * np.sin(self.waves[:, 1] * q + self.waves[:, 2])
        if self.yields.any():
            h = 1e-4
            pull = [self.height(q - h * e) - self.height(q + h * e) for e in np.eye(6)]
            off = off + self.yields * np.array(pull) / (2 * h) / 1000.0
        return q + off


def drawn(kind: str, seed: int) -> tuple[Arm, int, str]:
    """An arm, its number of rows, and its sensor."""
    rng = np.random.default_rng([KINDS.index(kind), seed])
    name = str(rng.choice(list(ARMS)))
    alpha, d, r = np.array(ARMS[name], dtype=float).T
    waves = np.zeros((6, 3))
    if rng.random() < 0.5:
        own = rng.choice(6, 2, replace=False)
        waves[own] = np.column_stack(
            [rng.uniform(1e-4, 4e-4, 2), rng.integers(1, 4, 2), rng.uniform(0, 6, 2)]
        )
    yields = np.zeros(6)
    if rng.random() < 0.5:
        yields[[1, 2]] = rng.uniform(0.5e-6, 5e-6, 2)
    small = rng.uniform(2e-4, 1e-3) if kind == "play" else 10 ** rng.uniform(-4, -3.2)
    arm = Arm(
        name,
        np.radians(alpha) + ANGLE * rng.standard_normal(6) * NOT_FIRST,
        d + LENGTH * rng.standard_normal(6) * NOT_FIRST,
        ANGLE * rng.standard_normal(6) * NOT_FIRST,
        r + LENGTH * rng.standard_normal(6) * NOT_FIRST,
        np.array([30.0, 0.0, 120.0]),
        waves,
        yields,
        int(rng.integers(6)) if kind == "play" else None,
        small,
        "" if kind != "early" else str(rng.choice(["brakes", "decays", "swings"])),
    )
    return arm, int(rng.integers(120, 201)), str(rng.choice(["pose", "position"]))


def motion(arm: Arm, start: Array, end: Array) -> tuple[Callable[[Array], Array], float]:
    """Share of a synchronised trapezoid that is done at times (t,), and how long it lasts: the slowest joint sets the pace."""
    way = np.abs(end - start)
    speed = float(np.min(FASTEST / np.maximum(way, 1e-9)))
    brake = float(np.min(BRAKES[arm.name] / np.maximum(way, 1e-9)))
    speed = min(speed, np.sqrt(brake))  # short ways never reach full speed
    ramp = speed / brake
    total = 1.0 / speed + ramp

    def share(t: Array) -> Array:
        left = total - t
        return np.where(
            t < ramp, brake * t**2 / 2, np.where(left < ramp, 1 - brake * left**2 / 2, speed * (t - ramp / 2))
        )

    return share, total


def pushed(link: float, motor: Array, play: float) -> float:
    """Where a link in a clearance is left by a motor's way (t,)."""
    for at in motor:
        link = min(max(link, at - play / 2), at + play / 2)
    return float(link)


def read_at(arm: Arm, visits: Array) -> Array:
    """(n, 6) where joints were, before gears and gravity, when each visit was read."""
    out, link = visits.copy(), visits[0].copy()
    for k in range(1, len(visits)):
        share, total = motion(arm, visits[k - 1], visits[k])
        done = share(np.linspace(0, total, SMALL_STEPS))
        step = visits[k] - visits[k - 1]
        if arm.joint is not None:
            j = arm.joint
            link[j] = pushed(link[j], visits[k - 1, j] + done * step[j], arm.size)
            out[k, j] = link[j]
        elif arm.tail == "brakes":
            # read as long before the end of every motion, a moment in which the middle joint comes the last of its way
            moment = np.sqrt(2 * arm.size / np.median(BRAKES[arm.name]))
            out[k] = visits[k - 1] + step * share(np.array([max(total - moment, 0.0)]))
        elif arm.tail:
            wait = -np.log(arm.size / 2)  # so many time constants after the reference stood
            swing = np.cos(2.2 * wait) if arm.tail == "swings" else 1.0
            out[k] = visits[k] - step * np.exp(-wait) * (swing if abs(swing) > 0.3 else 0.3)
    return out


def recorded(arm: Arm, n: int, sensor: str, rng: np.random.Generator) -> pd.DataFrame:
    """The recording in degrees and mm, with nothing but joints and readings."""
    visits = RANGE * rng.uniform(-1, 1, (n, 6))
    rows = []
    for q in read_at(arm, visits):
        flange = arm.bodies(arm.stands(q))[-1]
        position = flange[:3, :3] @ arm.tool + flange[:3, 3] + XYZ * rng.standard_normal(3)
        turn = Rotation.from_matrix(flange[:3, :3]) * Rotation.from_rotvec(TURN * rng.standard_normal(3))
        rows.append([*position, *np.degrees(turn.as_rotvec())])
    names = [f"q{k}" for k in range(1, 7)]
    table = pd.DataFrame(np.degrees(visits), columns=names)
    table[["x", "y", "z", "rx", "ry", "rz"]] = rows
    return table if sensor == "pose" else table.drop(columns=["rx", "ry", "rz"])


def machine_file(arm: Arm, sensor: str) -> str:
    """The machine file of the drawing."""
    joints = "\n".join(
        f"    - {{name: q{k + 1}, kind: revolute, alpha: {a}, d: {d}, r: {r}, "
        f"range: [{-np.degrees(RANGE[k]):.0f}, {np.degrees(RANGE[k]):.0f}]}}"
        for k, (a, d, r) in enumerate(ARMS[arm.name])
    )
    masses = "\n".join(
        f"  m{k}: {{kg: {kg}, com: {LEVER.tolist()}, in: link{k + 1}}}" for kg, k in zip(KG, COM, strict=True)
    )
    sigma = f"xyz: {XYZ}" + (f", rot: {np.degrees(TURN):.4f}" if sensor == "pose" else "")
    tool = ", ".join(f"{v}" for v in arm.tool)
    return f"""schema: truepose/machine/1
name: {arm.name}
gravity: [0, 0, -{GRAVITY}]
mechanism:
  type: serial
  joints:
{joints}
frames:
  base: {{in: world, tolerance: {{xyz: 1, rpy: 0.2}}}}
  tool: {{in: flange, xyz: [{tool}], tolerance: {{xyz: 0.5, rpy: 0.2}}}}
sensor: {{type: {sensor}, sigma: {{{sigma}}}}}
tolerances: {{length: {LENGTH}, angle: {np.degrees(ANGLE)}}}
masses:
{masses}
"""


def judged(kind: str, arm: Arm, found: Diagnosis) -> dict[str, bool]:
    """Place and driver, and law, of what is there; any arrival that is not."""
    arrivals = [f for f in found.findings if f.levels.kind == "arrival" and f.levels.driver >= 0.5]
    name = {"play": "backlash", "early": "early-reading"}.get(kind, "")
    joints = {f"q{arm.joint + 1}"} if arm.joint is not None else {f"q{k}" for k in range(1, 7)}
    own = [f for f in arrivals if name and set(f.place) <= joints and f.levels.place >= 0.5]
    return {
        "place and driver": any(set(f.place) == joints for f in own),
        "law": any(f.effect == name and set(f.place) == joints and f.probability >= 0.5 for f in own),
        "false": any(f not in own for f in arrivals),
    }


def tried(kind: str, seed: int, folder: Path) -> dict[str, bool]:
    """One arm: made, diagnosed, told and judged. Its files stay in the folder."""
    arm, n, sensor = drawn(kind, seed)
    table = recorded(arm, n, sensor, np.random.default_rng([7, KINDS.index(kind), seed]))
    file = folder / f"{kind}{seed}.yaml"
    file.write_text(machine_file(arm, sensor))
    table.to_csv(file.with_suffix(".csv"), index=False)
    began = time.process_time()
    found = truepose.diagnose(truepose.load_machine(file), table)
    right = judged(kind, arm, found)
    said = "; ".join(f"{f.effect}@{'+'.join(f.place)} {f.probability:.3f}" for f in found.findings)
    where = f"q{arm.joint + 1}" if arm.joint is not None else arm.tail
    sys.stdout.write(
        f"{kind} {seed} {arm.name} {sensor} {n} rows {where} {arm.size:.2e}: {found.verdict}: {said} "
        f"[{', '.join(key for key, value in right.items() if value)}] {time.process_time() - began:.0f} s\n"
    )
    sys.stdout.flush()
    return right


def main() -> None:
    """Every kind, so many arms of it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--arms", type=int, default=12)
    parser.add_argument("--kind", choices=KINDS, nargs="*", default=KINDS)
    parser.add_argument("--first", type=int, default=20, help="seed of the first arm")
    parser.add_argument("--keep", type=Path, help="directory for the machines and recordings")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as gone:
        folder = asked.keep or Path(gone)
        folder.mkdir(exist_ok=True)
        for kind in asked.kind:
            told = [tried(kind, seed, folder) for seed in range(asked.first, asked.first + asked.arms)]
            total = ", ".join(f"{key} {sum(one[key] for one in told)}" for key in told[0])
            sys.stdout.write(f"{kind}: {total} of {len(told)}\n")


if __name__ == "__main__":
    main()
