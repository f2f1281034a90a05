"""Instruments of the small simulators: what each reads of true poses of the tool, its section of the file, its noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..pairs import ANGLES, TURNS, XYZ, Array
from ..rotations import columns, turn

POINT, TURN = (0.01, 0.03), (0.002, 0.01)
"""Ranges of sigmas, mm and deg."""
LEVER = 300.0
"""mm at which a turn counts as what it moves."""


@dataclass(frozen=True)
class Instrument:
    """kind as ``sensor.type``; sigma mm, turn deg; points by name, centre of a ball bar (mm)."""

    kind: str
    sigma: float
    turn: float
    points: dict[str, list[float]]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def section(self) -> dict[str, Any]:
        """Of the machine file."""
        if self.kind == "pose":
            return {"type": "pose", "sigma": {"xyz": self.sigma, "rot": self.turn}}
        if self.kind == "position":
            return {"type": "position", "sigma": {"xyz": self.sigma}}
        if self.kind == "targets":
            own = {"points": self.points, "sigma": {"xyz": self.sigma}, "tolerance": {"points": 0.02}}
            return {"type": "targets", **own}
        if self.kind == "direction":
            return {"type": "direction", "of": "origin", "sigma": {"angle": self.turn}}
        if self.kind == "distance":
            beam = {"in": "world", "xyz": list(self.centre), "rx": 0.0, "rz": 0.0}
            mirror = {"in": "tool", "z": 0.0, "rx": 0.0, "ry": 0.0}
            tolerance = {"beam.xyz": 2.0, "beam.angle": 0.0, "mirror.z": 0.0, "mirror.angle": 0.5}
            own = {"beam": beam, "mirror": mirror, "tolerance": tolerance}
            return {"type": "distance", **own, "sigma": {"distance": self.sigma}}
        ends = {"centre": list(self.centre), "ball": [0.0, 0.0, 0.0]}
        tolerance = {"centre": 3.0, "ball": 0.0}
        return {"type": "ballbar", **ends, "sigma": {"distance": self.sigma}, "tolerance": tolerance}

    def read(self, tool: Array, rng: np.random.Generator) -> pd.DataFrame:
        """Columns of poses (n, 4, 4), with noise."""
        n = len(tool)
        if self.kind == "pose":
            noise = np.radians(self.turn) * rng.standard_normal((n, 3))
            seen = tool @ turn("x", noise[:, 0]) @ turn("y", noise[:, 1]) @ turn("z", noise[:, 2])
            seen[:, :3, 3] += self.sigma * rng.standard_normal((n, 3))
            return pd.DataFrame(columns(seen), columns=[*XYZ, *TURNS])
        if self.kind == "ballbar":
            far = np.linalg.norm(tool[:, :3, 3] - self.centre, axis=1)
            return pd.DataFrame({"length": far + self.sigma * rng.standard_normal(n)})
        if self.kind == "direction":
            x, y, z = tool[:, :3, 3].T
            noise = np.radians(self.turn) * rng.standard_normal((2, n))
            lift = np.arctan2(z, np.hypot(x, y))
            turned = -np.arctan2(y, x) + noise[0] / np.cos(lift)  # clockwise, seen from above
            return pd.DataFrame(np.degrees(np.column_stack([turned, lift + noise[1]])), columns=list(ANGLES))
        if self.kind == "distance":
            normal, off = tool[:, :3, 2], tool[:, :3, 3] - self.centre
            cavity = np.einsum("ni,ni->n", normal, off) / normal[:, 2]  # the light travels along z
            change = cavity - cavity[0] + self.sigma * rng.standard_normal(n)
            change[0] = 0.0  # a row that counts from itself
            return pd.DataFrame({"from": 1, "dL": change})
        out: dict[str, Array] = {}
        for name, point in (self.points or {"": [0.0, 0.0, 0.0]}).items():
            error = 0.02 * rng.standard_normal(3) if name else 0.0
            at = tool[:, :3, :3] @ (np.array(point) + error) + tool[:, :3, 3]
            at = at + self.sigma * rng.standard_normal((n, 3))
            out |= {f"{name}.{a}" if name else a: at[:, k] for k, a in enumerate(XYZ)}
        return pd.DataFrame(out)

    def with_sigma(self, sigma: float) -> Instrument:
        """Return the instrument with another noise (mm) of points, and that of turns which does as much at ``LEVER``."""
        return replace(self, sigma=sigma, turn=float(f"{np.degrees(sigma / LEVER):.3g}"))


def instrument(kind: str, rng: np.random.Generator, reach: float) -> Instrument:
    """One whose noise suits a machine of that reach (mm)."""
    sigma = float(np.round(rng.uniform(*POINT) * min(1.0, reach / 1000.0), 5))
    names = [f"P{k}" for k in range(1, int(rng.integers(3, 5)) + 1)]
    size = 0.08 * reach
    points = {name: np.round(size * rng.uniform(-1, 1, 3), 2).tolist() for name in names}
    centre = tuple(np.round(reach * np.array([*rng.uniform(-0.8, 0.8, 2), -0.2]), 1).tolist())
    turned = float(np.round(rng.uniform(*TURN), 4))
    return Instrument(kind, sigma, turned, points if kind == "targets" else {}, centre)
