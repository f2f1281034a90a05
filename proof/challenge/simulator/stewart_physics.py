"""What legs and platform of the Stewart machine can have beside what any joint or mount can.

Static equilibrium of an elastic truss: forces are those of the loaded pose, repeated until nothing moves. Eccentric
pins of its universal joints are left out: an eye that turns with its leg only changes the leg's length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache

import numpy as np

from . import operators
from .base import Array, Imperfection, Kind, Place
from .cantilever import STEEL, Frame, Section, loads_at
from .joint_physics import TURN, Axes, places
from .mount_physics import HOUR, body_temperature
from .ported import Physics, Stage, Work
from .stewart_closure import balanced
from .stewart_drawing import LEGS, OFFSET, B

TUBE = Section.box(24.0, 20.0, STEEL)
HOSE = ((520.0, 260.0, 40.0), (120.0, 150.0, -20.0))
"""Ends of the hose: in the base and the platform frame, mm."""
SOFT = 1.2e-4
"""mm/N by which every leg yields to the hose."""


def leg(place: Place) -> int:
    """Number of a leg from 0."""
    return LEGS.index(place[0])


def leg_compliance(typical: float) -> Physics:
    """A leg's bar and its joints' springs in series: ``size`` mm/N at home, the bar's part grows with its length."""

    def act(work: Work, i: Imperfection) -> None:
        k, bar = leg(i.place), i.shape["bar"]
        compliance = i.size * (bar * work.solved.lengths[:, k] / OFFSET + 1 - bar)
        work.moved[:, k] += compliance * work.solved.forces[:, k]

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"bar": float(rng.uniform(0.1, 0.5))}

    kind = Kind("leg-compliance", places(LEGS), typical, "leg-compliance", conceals=True)
    return Physics(kind, act, shape, Stage.LOADS)


def screw_windup(axes: Axes, typical: float) -> Physics:
    """The free part of a screw twists and stretches under the leg's force: ``size`` mm/N when it is longest."""

    def act(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        work.moved[:, k] += i.size * axes.share(work, k) * work.solved.forces[:, k]

    kind = Kind("screw-windup", places(axes.names), typical, "screw-windup")
    return Physics(kind, act, stage=Stage.LOADS)


def platform_deformation() -> Physics:
    """The ring that carries the leg ends bends on its three spokes; ``size`` 1: tubes as drawn in ``ring_compliance``."""

    def act(work: Work, i: Imperfection) -> None:
        pulls = -work.solved.forces[..., None] * work.solved.units
        local = np.einsum("nji,nkj->nki", work.solved.rotation, pulls)
        moved = i.size * (local.reshape(len(work), 18) @ ring_compliance().T).reshape(-1, 6, 3)
        for k, name in enumerate(LEGS):
            for j, axis in enumerate("xyz"):
                work.add(f"{name}.b.{axis}", moved[:, k, j])

    kind = Kind("platform-deformation", (("platform",),), 1.0, "platform-deformation", conceals=True)
    return Physics(kind, act, stage=Stage.LOADS)


@lru_cache(maxsize=1)
def ring_compliance() -> Array:
    """(18, 18) mm/N of the leg ends: a welded ring through them, three spokes to a hub that is held. Read-only."""
    middle = np.array([(B[j] + B[k]) / 2 for j, k in ((0, 5), (1, 2), (3, 4))])
    nodes = np.vstack([B, middle, np.zeros(3)])
    order = np.argsort(np.arctan2(nodes[:9, 1], nodes[:9, 0]))
    ring = tuple((int(order[k]), int(order[(k + 1) % 9])) for k in range(9))
    frame = Frame(nodes, (*ring, (6, 9), (7, 9), (8, 9)), TUBE, (9,))
    C = frame.displacements(loads_at(range(6), 10))[:6, :3].reshape(18, 18)
    C.flags.writeable = False
    return C


def leg_growth(k: int) -> Callable[[Work, Array], None]:
    """A leg grows by a strain (n,) of its whole length."""

    def grow(work: Work, strain: Array) -> None:
        work.moved[:, k] += strain * (work.value(f"{LEGS[k]}.offset") + work.campaign.q[:, k])

    return grow


def opening_preload(axes: Axes, typical: float) -> Physics:
    """A nut whose preload opens: it yields by ``size`` mm/N only to what presses beyond the preload."""

    def act(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        work.moved[:, k] += i.size * np.minimum(work.solved.forces[:, k] + i.shape["preload"], 0.0)

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"preload": float(rng.uniform(100, 160))}

    return Physics(Kind("opening-preload", places(axes.names), typical), act, shape, Stage.LOADS)


def unwinding_screw(axes: Axes, typical: float) -> Physics:
    """Nothing keeps the nut from turning with the platform: ``size`` mm for each rad about the leg."""

    def act(work: Work, i: Imperfection) -> None:
        k, unit = axes.index(i.place), work.solved.units[:, axes.index(i.place)]
        start = np.array([np.cos(i.shape["phase"]), np.sin(i.shape["phase"]), 0.0])
        end = work.solved.rotation @ start
        across = np.cross(unit, start)
        turned = np.arctan2(np.sum(end * across, axis=1), np.sum(end * np.cross(across, unit), axis=1))
        work.moved[:, k] += i.size * turned

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"phase": float(rng.uniform(0, TURN))}

    return Physics(
        Kind("unwinding-screw", places(axes.names), typical, conceals=True), act, shape, Stage.LOADS
    )


def dragged_hose() -> Physics:
    """A hose between floor and platform pulls once taut; all legs yield by ``SOFT``. Size 1: 2 N/mm."""

    def act(work: Work, i: Imperfection) -> None:
        pose = work.solved
        arm = pose.rotation @ np.array(HOSE[1])
        span = np.array(HOSE[0]) - pose.position - arm
        length = np.linalg.norm(span, axis=1, keepdims=True)
        force = 2.0 * np.maximum(length - i.shape["slack"], 0.0) * span / length
        pull = balanced(pose.units, pose.arms, np.hstack([force, np.cross(arm, force)]))
        work.moved += i.size * SOFT * pull

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"slack": float(rng.uniform(530, 640))}

    return Physics(Kind("dragged-hose", (("platform",),), 1.0, conceals=True), act, shape, Stage.LOADS)


def heated_zero(typical: float) -> Physics:
    """A leg's home switch walks with its warmth and sticks: ``size`` mm a kelvin, through play of tenths of a kelvin."""

    def act(work: Work, i: Imperfection) -> None:
        warm = body_temperature(work, i.place[0], i.shape["lag"])
        work.moved[:, leg(i.place)] += i.size * (operators.play(warm, i.shape["stick"]) - warm[0])

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lag": float(rng.uniform(100, 700)), "stick": float(rng.uniform(0.1, 0.4))}

    needs = tuple(f"temperature.{name}" for name in LEGS)
    return Physics(Kind("heated-zero", places(LEGS), typical, needs=needs), act, shape)


def swaying_floor(typical: float, twist: Sequence[str], lever: float) -> Physics:
    """The floor tilts to and fro with the compressor next door: ``size`` mm at ``lever`` mm, every 12 to 50 minutes."""

    def act(work: Work, i: Imperfection) -> None:
        wave = np.sin(TURN * work.campaign.time / i.shape["period"] + i.shape["phase"])
        for axis, part in zip(twist[3:5], (np.cos(i.shape["way"]), np.sin(i.shape["way"])), strict=True):
            work.add(f"base.motion.{axis}", i.size / lever * part * wave)

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        phases = {name: float(rng.uniform(0, TURN)) for name in ("phase", "way")}
        return phases | {"period": float(rng.uniform(0.2, 0.85) * HOUR)}

    return Physics(Kind("swaying-floor", (("base",),), typical, needs=("time",)), act, shape)
