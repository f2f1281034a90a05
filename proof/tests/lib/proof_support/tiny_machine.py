"""A machine small enough for the examination to be quick: two joints, a tool, a tracker. mm, rad."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from challenge.simulator.base import (
    Campaign,
    Imperfection,
    Kind,
    Place,
    Plan,
    SimulatedMachine,
    Specimen,
)
from support.tiny_fleets import LIMITS, SIGMA, built, machine_text, points

Array = NDArray[np.float64]


class Tiny(SimulatedMachine):
    """Forward kinematics written out; gains, plays and a wave that no catalogue has."""

    name: ClassVar[str] = "tiny"
    readings: ClassVar[tuple[str, ...]] = ("q1", "q2")
    revolute: ClassVar[tuple[bool, ...]] = (True, True)
    columns: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    column_units: ClassVar[tuple[str, ...]] = ("mm", "mm", "mm")

    def machine_text(self, *, sigma_factor: float = 1.0, tolerance_factor: float = 1.0) -> str:
        return machine_text(sigma_factor, tolerance_factor)

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
        return Specimen(built(rng, scale))

    def campaign(self, plan: Plan, rng: np.random.Generator) -> Campaign:
        n, low = plan.poses * plan.repeats, 0.8 if plan.extreme else 0.0
        q = LIMITS * rng.uniform(low, 0.95, (plan.poses, 2)) * rng.choice([-1, 1], (plan.poses, 2))
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
        return points(p, q)

    def noisy(
        self, exact: Array, campaign: Campaign, rng: np.random.Generator, *, factor: float = 1.0
    ) -> Array:
        out: Array = exact + factor * SIGMA * rng.standard_normal(exact.shape)
        return out
