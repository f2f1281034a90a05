"""A six-axis arm in plain numpy: forward kinematics, gravity's torques about its joints, and its machine file.

Khalil and Kleinfinger's convention, mm and rad, written out here apart from the library.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from support.plain_kinematics import frame, step
from truepose.arrays import Array

JOINTS: Mapping[str, Mapping[str, float]] = {
    "q1": {"r": 400.0},
    "q2": {"alpha": -90.0, "d": 120.0, "theta": -90.0},
    "q3": {"d": 560.0},
    "q4": {"alpha": -90.0, "d": 90.0, "r": 620.0},
    "q5": {"alpha": 90.0},
    "q6": {"alpha": -90.0, "r": 100.0},
}
LOW = np.array([-150.0, -60.0, -60.0, -170.0, -110.0, -170.0])
HIGH = np.array([150.0, 60.0, 70.0, 170.0, 110.0, 170.0])
TOOL = (60.0, 20.0, 140.0)
POINTS = {"P1": (0.0, 0.0, 0.0), "P2": (120.0, 0.0, 40.0), "P3": (0.0, 130.0, -30.0)}
LENGTH, ANGLE = 0.1, 0.05
"""Tolerances, mm and deg."""
SIGMA = 0.015
GRAVITY = np.array([0.0, 0.0, -9.80665])
WEIGHTS = {
    "link2": (14.0, (260.0, 0.0, 30.0)),
    "link3": (9.0, (40.0, 10.0, 60.0)),
    "link4": (5.0, (0.0, 0.0, -180.0)),
    "link6": (2.0, (0.0, 0.0, -20.0)),
}
"""kg and centre in the frame of the link."""
KEYS = ("beta", "alpha", "d", "theta", "r")


def constants(rng: np.random.Generator | None = None) -> dict[str, float]:
    """Every constant of the drawing (mm, rad), or of a machine as built: off by its tolerance."""
    out = {}
    for name, own in JOINTS.items():
        for key in KEYS:
            value = own.get(key, 0.0)
            if rng is not None and not (name == "q1" or (key == "beta" and name != "q3")):
                value += rng.normal() * (LENGTH if key in "dr" else ANGLE)
            out[f"{name}.{key}"] = value if key in "dr" else float(np.radians(value))
    return out


def frames(p: Mapping[str, float], q: Array) -> Array:
    """(6, 4, 4) frames of the links in the base, joint variables ``q`` (6,) in rad."""
    out, here = np.empty((6, 4, 4)), np.eye(4)
    for k, name in enumerate(JOINTS):
        here = here @ step([p[f"{name}.{key}"] for key in KEYS], q[k])
        out[k] = here
    return out


def torques(p: Mapping[str, float], q: Array, payload: float) -> Array:
    """(6,) torque that gravity exerts about each joint, N m; the payload hangs at the tool's origin."""
    at = frames(p, q)
    masses = [(at[int(name[4:]) - 1], kg, com) for name, (kg, com) in WEIGHTS.items()]
    masses.append((at[5], payload, TOOL))
    out = np.zeros(6)
    for link, kg, com in masses:
        place = link[:3, :3] @ np.array(com) + link[:3, 3]
        carried = next(k for k in range(6) if np.array_equal(at[k], link)) + 1
        for k in range(carried):
            lever = (place - at[k][:3, 3]) / 1000.0
            out[k] += at[k][:3, 2] @ np.cross(lever, kg * GRAVITY)
    return out


def readings(p: Mapping[str, float], q: Array, rng: np.random.Generator) -> dict[str, float]:
    """What a tracker reads of the points, mm, in a frame that is turned and shifted against the base."""
    flange = frames(p, q)[5]
    stand = frame([1500.0, 0.0, 300.0], [0.02, 0.0, 0.7])
    out: dict[str, float] = {}
    for name, point in POINTS.items():
        seen = stand @ flange @ np.array([*(np.array(TOOL) + point), 1.0])
        noise = rng.normal(scale=SIGMA, size=3)
        out |= {f"{name}.{axis}": seen[i] + noise[i] for i, axis in enumerate("xyz")}
    return out


def document(*, weighs: bool, **more: Any) -> dict[str, Any]:
    """The machine file: drawing, tolerances, base unknown; ``weighs``: with gravity and the links' masses."""
    joints = [
        {"name": name, "kind": "revolute", **own, "range": [float(LOW[k] - 5), float(HIGH[k] + 5)]}
        for k, (name, own) in enumerate(JOINTS.items())
    ]
    masses = {n: {"kg": kg, "com": list(com), "in": n} for n, (kg, com) in WEIGHTS.items()}
    weight = {"gravity": GRAVITY.tolist(), "masses": masses} if weighs else {}
    free = {"xyz": float("inf"), "rpy": float("inf")}
    base = {"xyz": [1500.0, 0.0, 300.0], "rpy": [0.0, 0.0, 40.0], "tolerance": free}
    points = {name: list(point) for name, point in POINTS.items()}
    return {
        "schema": "truepose/machine/1",
        "name": "arm",
        "mechanism": {"type": "serial", "joints": joints},
        "frames": {"base": {"in": "world", **base}, "tool": {"in": "flange", "xyz": list(TOOL)}},
        "sensor": {"type": "targets", "points": points, "sigma": {"xyz": SIGMA}},
        "tolerances": {"length": LENGTH, "angle": ANGLE, "beta": 0, "q3.beta": ANGLE},
        **weight,
        **more,
    }


def soft_arm(seed: int) -> tuple[dict[str, Any], pd.DataFrame, dict[str, float], float]:
    """Machine file, recording, compliances (rad/(N m)) by joint, and 1 where torques are those of gravity, -1 of the drives."""
    rng = np.random.default_rng(1000 + seed)
    true, ideal = constants(rng), constants()
    names = sorted(rng.choice(["q2", "q3", "q4", "q5"][: 2 + seed % 3], 1 + seed % 2, replace=False).tolist())
    c = {name: rng.uniform(2e-6, 8e-6) * (1 if name in ("q2", "q3") else 8) for name in names}
    sign, payloads, rows = float(rng.choice([-1.0, 1.0])), rng.choice([0.0, 6.0, 12.0], 60), []
    for payload in payloads:
        q = rng.uniform(LOW, HIGH)
        load = torques(ideal, np.radians(q), payload)
        give = np.array([c.get(f"q{k + 1}", 0.0) for k in range(6)]) * load
        row = dict(zip(JOINTS, q, strict=True))
        row |= {f"torque.q{k + 1}": sign * load[k] + rng.normal(scale=0.5) for k in range(6)}
        rows.append(row | readings(true, np.radians(q) + give, rng))
    names_of = [f"torque.{name}" for name in JOINTS]
    machine = document(weighs=bool(seed % 2), drivers=[{"name": n, "unit": "N*m"} for n in names_of])
    return machine, pd.DataFrame(rows), c, sign
