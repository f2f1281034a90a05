"""What a telescope can have that the interface has no word for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from . import heat
from .base import Imperfection, Kind, Place
from .joint_physics import phase, places
from .mount_physics import body_temperature
from .ported import Physics, Stage, Work
from .rigid import rotation_vector
from .telescope_geometry import LEGS, TRAVEL, Assembled
from .telescope_physics import tilt


def unnamed() -> tuple[Physics, ...]:
    """Five of them."""
    return (_bowed_seat(), _slipping_hub(), _sagging_rail(), _buckling_flexure(), _pulling_cable())


def _bowed_seat() -> Physics:
    """A seat shared by two neighbouring legs bows where both slides stand far out, on the same side: ``size`` mm."""

    def act(work: Work, i: Imperfection) -> None:
        k = LEGS.index(i.place[0])
        one, two = work.campaign.q[:, k] / TRAVEL, work.campaign.q[:, (k + 1) % 6] / TRAVEL
        work.add(f"{LEGS[k]}.a.z", i.size * one * two * np.abs(one + two))

    return Physics(Kind("seat-bowed-by-two-slides", places(LEGS), 0.05), act)


def _slipping_hub() -> Physics:
    """A bolt of the hub slips by ``size`` mm once it carries a load, and springs back when the load is gone."""

    def act(work: Work, i: Imperfection) -> None:
        heavy = 1 / (1 + np.exp(-(work.campaign.payload - i.shape["kg"]) / 0.3))
        uneven = np.tanh(np.sum(work.campaign.q[:, :3] - work.campaign.q[:, 3:], axis=1) / TRAVEL)
        work.add("tool.motion.x", i.size * heavy * uneven * np.cos(i.shape["phase"]))
        work.add("tool.motion.y", i.size * heavy * uneven * np.sin(i.shape["phase"]))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"kg": float(rng.choice([2.0, 6.0])), "phase": float(rng.uniform(0, 2 * np.pi))}

    return Physics(Kind("hub-bolt-slips", (("tool",),), 0.03, needs=("payload",)), act, shape)


def _sagging_rail() -> Physics:
    """A rail tilts as the leg across the base warms, late: ``size`` mm per kelvin at the end of its travel."""

    def act(work: Work, i: Imperfection) -> None:
        k = LEGS.index(i.place[0])
        across = LEGS[(k + 3) % 6]
        warm = body_temperature(work, across, i.shape["lag"]) - heat.REFERENCE
        work.add(f"{LEGS[k]}.a.z", i.size * warm * (1 + work.campaign.q[:, k] / TRAVEL))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lag": float(rng.uniform(1200, 5400))}

    kind = Kind("rail-sags-with-heat-across", places(LEGS), 0.006, needs=("temperature.leg1",))
    return Physics(kind, act, shape)


def _buckling_flexure() -> Physics:
    """A flexure with a crack gives way beyond a tilt: its leg is ``size`` mm shorter at twice that tilt."""

    def act(work: Work, i: Imperfection) -> None:
        over = np.maximum(tilt(work, LEGS.index(i.place[0])) / i.shape["limit"] - 1, 0.0)
        work.add(f"{i.place[0]}.length", -i.size * np.tanh(over))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"limit": float(rng.uniform(0.01, 0.02))}

    return Physics(Kind("flexure-buckles", places(LEGS), 0.04), act, shape, Stage.LOADS)


def _pulling_cable() -> Physics:
    """A cable to the hub pulls its instrument aside as the platform turns: ``size`` mm, as the sine of the turn."""

    def act(work: Work, i: Imperfection) -> None:
        solved: Assembled = work.solved
        turn = rotation_vector(solved.platform[:, :3, :3])
        wound = np.sin(i.shape["rate"] * (turn[:, 2] + turn[:, 0]) + i.shape["phase"])
        work.add("tool.motion.x", i.size * wound)
        work.add("tool.motion.z", 0.5 * i.size * wound)

    def shape(place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {**phase(place, rng), "rate": float(rng.uniform(80, 160))}

    return Physics(Kind("cable-pulls-tool", (("tool",),), 0.02), act, shape, Stage.LOADS)


__all__ = ["unnamed"]
