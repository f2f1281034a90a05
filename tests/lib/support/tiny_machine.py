"""A machine small enough for the examination to be quick: two joints, a tool, a tracker. mm, rad."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from challenge.simulator.base import (
    Campaign,
    Imperfection,
    Kind,
    Place,
    Plan,
    SimulatedMachine,
    Specimen,
)

Array = NDArray[np.float64]
SIGMA, LENGTH, ANGLE = 0.01, 0.1, 0.0005
MACHINE = """schema: truepose/machine/1
name: tiny
units: {{length: mm, angle: deg}}
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, r: 300, range: [-170, 170]}}
    - {{name: q2, kind: revolute, alpha: -90, d: 100, range: [-90, 90]}}
frames: {{tool: {{in: flange, xyz: [400, 50, 30], tolerance: {{xyz: {length}}}}}}}
sensor: {{type: position, sigma: {{xyz: {sigma}}}}}
tolerances: {{length: {length}, angle: {angle}}}
"""
NOMINAL = {
    "q1.alpha": 0.0, "q1.beta": 0.0, "q1.d": 0.0, "q1.theta": 0.0, "q1.r": 300.0,
    "q2.alpha": -np.pi / 2, "q2.beta": 0.0, "q2.d": 100.0, "q2.theta": 0.0, "q2.r": 0.0,
    "tool.x": 400.0, "tool.y": 50.0, "tool.z": 30.0,
}  # fmt: skip


class Tiny(SimulatedMachine):
    """Forward kinematics written out; gains, plays and a wave that no catalogue has."""

    name: ClassVar[str] = "tiny"
    readings: ClassVar[tuple[str, ...]] = ("q1", "q2")
    revolute: ClassVar[tuple[bool, ...]] = (True, True)
    columns: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    column_units: ClassVar[tuple[str, ...]] = ("mm", "mm", "mm")

    def machine_text(self, *, sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
        lengths, angles = LENGTH * tolerance_factor, float(np.degrees(ANGLE)) * tolerance_factor
        return MACHINE.format(length=lengths, angle=angles, sigma=SIGMA * sigma_factor)

    def kinds(self) -> tuple[Kind, ...]:
        joints = (("q1",), ("q2",))
        return (
            Kind("gain", joints, 1e-4, "actuator-scale"),
            Kind("slip", (("q2.d",),), 0.5, "wrong-constant", conceals=True),
            Kind("play", joints, 2e-4, "backlash", ("approach.q1", "approach.q2")),
            Kind("beat", (("q1",),), 2e-4),
        )

    def shape(self, kind: str, place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"phase": float(rng.uniform(0, 6))} if kind == "beat" else {}

    def specimen(self, rng: np.random.Generator, *, scale: float = 1.0) -> Specimen:
        spread = {n: LENGTH if n[-1] in "drxyz" else ANGLE for n in NOMINAL}
        return Specimen({n: v + scale * spread[n] * rng.standard_normal() for n, v in NOMINAL.items()})

    def campaign(self, plan: Plan, rng: np.random.Generator) -> Campaign:
        n, low = plan.poses * plan.repeats, 0.8 if plan.extreme else 0.0
        limits = np.radians([170.0, 90.0])
        q = limits * rng.uniform(low, 0.95, (plan.poses, 2)) * rng.choice([-1, 1], (plan.poses, 2))
        side = rng.choice([-1.0, 1.0], (n, 2)) if plan.both_sides else np.ones((n, 2))
        pose = np.tile(np.arange(plan.poses), plan.repeats)
        return Campaign(
            q=np.radians(np.degrees(q).round(6))[pose],
            time=np.arange(0.0, 60.0 * n, 60.0),
            pose=pose + 1,
            approach=side,
            session=np.repeat(np.arange(plan.sessions), -(-n // plan.sessions))[:n] + 1,
            payload=rng.choice([0.0, 5.0], n) if plan.loads else np.zeros(n),
            temperatures={"link1": 20 + 3 * rng.random(n) if plan.heat else np.full(n, 20.0)},
            pressure=np.full(n, 1013.0),
            validation=np.full(n, plan.extreme),
            origin=np.arange(n),
        )

    def measure(
        self, specimen: Specimen, imperfections: tuple[Imperfection, ...], campaign: Campaign
    ) -> Array:
        q, p = campaign.q.copy(), dict(specimen.parameters)
        for thing in imperfections:
            if thing.kind == "slip":
                p[thing.place[0]] += thing.size
                continue
            k = self.readings.index(thing.place[0])
            if thing.kind == "gain":
                q[:, k] += thing.size * campaign.q[:, k]
            elif thing.kind == "play":
                q[:, k] -= thing.size / 2 * campaign.approach[:, k]
            elif thing.kind == "beat":
                wave = np.sin(23.7 * campaign.q[:, 0] * campaign.q[:, 1] + thing.shape["phase"])
                q[:, k] += thing.size * wave * np.sign(campaign.q[:, 1])
            else:
                raise ValueError(f"found kind {thing.kind!r}")
        point = np.tile([p["tool.x"], p["tool.y"], p["tool.z"]], (len(q), 1))
        for k, joint in ((1, "q2"), (0, "q1")):
            about_z = Rotation.from_rotvec(np.outer(q[:, k] + p[f"{joint}.theta"], [0.0, 0.0, 1.0]))
            up, out = np.array([0.0, 0.0, p[f"{joint}.r"]]), np.array([p[f"{joint}.d"], 0.0, 0.0])
            point = about_z.apply(point + up) + out
            turn = Rotation.from_euler("y", p[f"{joint}.beta"]) * Rotation.from_euler(
                "x", p[f"{joint}.alpha"]
            )
            point = turn.apply(point)
        return np.asarray(point)

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        out: Array = exact + factor * SIGMA * rng.standard_normal(exact.shape)
        return out
