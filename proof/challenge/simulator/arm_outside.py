"""What the arm can have that no catalogue names: for these a diagnosis should say ``unknown``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from . import heat, operators
from .arm_physics import COMPLIANCE, add_twist
from .base import Array, Imperfection, Kind, Place
from .joint_physics import Axes, displacing, places
from .ported import Physics, Stage, Work

HOSE = ((190.0, 120.0, 150.0), (60.0, 95.0, 70.0))
"""Clamps of the hose: in the frame of link1 and of link4 back at its elbow, mm."""
EDGE = 1e-3
"""Share of the mean moment over which a rocking plate goes over."""


def stiffening_gear(axes: Axes) -> Physics:
    """A strain-wave gear with a soft start: size 1 has twist as the cube root of the torque, mostly."""

    def act(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        soft = operators.StiffeningSpring(0.2 / COMPLIANCE[i.place[0]], i.shape["ratio"], i.shape["knee"])
        work.moved[:, k] += i.size * soft.windup(work.solved.torque(k))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"ratio": float(rng.uniform(20, 60)), "knee": float(rng.uniform(2e-4, 4e-4))}

    kind = Kind("stiffening-gear", places(("q2", "q3")), 1.0, conceals=True)
    return Physics(kind, act, shape, Stage.LOADS)


def dragged_hose(axes: Axes) -> Physics:
    """A hose from the column to the elbow pulls when taut, and the joints between give way; size 1: 1.5 N/mm."""

    def act(work: Work, i: Imperfection) -> None:
        pose = work.solved
        low = pose.links[:, 1, :3, :3] @ np.array(HOSE[0]) + pose.links[:, 1, :3, 3]
        high = pose.links[:, 3, :3, :3] @ np.array(HOSE[1]) + pose.links[:, 3, :3, 3]
        span = low - high
        length = np.linalg.norm(span, axis=1)
        pull = 1.5 * np.maximum(length - i.shape["slack"], 0.0)
        force = pull[:, None] * span / length[:, None]
        for k in (1, 2):
            axis = pose.axes[:, k]
            torque = np.einsum("ni,ni->n", np.cross(high - axis[:, :3, 3], force), axis[:, :3, 2]) * 1e-3
            work.moved[:, k] += i.size * COMPLIANCE[axes.names[k]] * torque

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"slack": float(rng.uniform(450, 620))}

    return Physics(Kind("dragged-hose", (("link3",),), 1.0), act, shape, Stage.LOADS)


def heated_zero(axes: Axes, typical: float, thermometers: Mapping[str, str]) -> Physics:
    """A joint's zero follows a brake disc that warms in its housing and sticks on its shaft; ``size`` rad a kelvin.

    thermometers: the logged place nearest to each joint's motor; it reads what warms the housing.
    """

    def shift(work: Work, i: Imperfection, _: int) -> Array:
        c = work.campaign
        nearby = c.temperatures[thermometers[i.place[0]]]
        warm = heat.skin_and_core(c.time, nearby, 0.3 * i.shape["lag"], i.shape["lag"])[1]
        return np.asarray(i.size * (operators.play(warm, i.shape["stick"]) - warm[0]))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lag": float(rng.uniform(100, 700)), "stick": float(rng.uniform(0.1, 0.4))}

    needs = tuple(dict.fromkeys(f"temperature.{place}" for place in thermometers.values()))
    return displacing(axes, Kind("heated-zero", places(thermometers), typical, needs=needs), shift, shape)


def rocking_base(typical: float) -> Physics:
    """The stand rocks over an edge: tilted by +-size / 2 (rad) by the side on which the centre of mass is."""

    def act(work: Work, i: Imperfection) -> None:
        frame = work.solved.links[:, 0]
        moment = np.einsum("nji,nj->ni", frame[:, :3, :3], work.solved.moment(0, frame[:, :3, 3]))
        edge = np.array([np.cos(i.shape["edge"]), np.sin(i.shape["edge"]), 0.0])
        over = moment @ edge / 300.0 - i.shape["offset"]
        turn = i.size / 2 * np.tanh(over / EDGE)[:, None] * edge
        add_twist(work, "base", np.hstack([np.zeros_like(turn), turn]))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"edge": float(rng.uniform(0, np.pi)), "offset": float(rng.uniform(-0.5, 0.5))}

    return Physics(Kind("rocking-base", (("base",),), typical), act, shape, Stage.LOADS)


def mirror_error(typical: float) -> Physics:
    """The tracker's mirror turns wrong by ``size`` rad times (azimuth - middle)^2."""

    def act(work: Work, i: Imperfection) -> None:
        for j in range(0, work.seen.shape[1], 3):
            x, y = work.seen[:, j].copy(), work.seen[:, j + 1].copy()
            azimuth = np.arctan2(y, x) - np.arctan2(0.64, 2.15)
            turn = i.size * (azimuth - i.shape["middle"]) ** 2
            work.seen[:, j] = np.cos(turn) * x - np.sin(turn) * y
            work.seen[:, j + 1] = np.sin(turn) * x + np.cos(turn) * y

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"middle": float(rng.uniform(-0.3, 0.3))}

    return Physics(Kind("mirror-error", (("sensor",),), typical), act, shape, Stage.INSTRUMENT)


def slipping_clamp(typical: float) -> Physics:
    """The forearm's clamp ring slips when the torque about the forearm exceeds its grip; ``size`` rad per N*m slipped."""

    def act(work: Work, i: Imperfection) -> None:
        torque = work.solved.torque(3)
        slipped = operators.play(torque, i.shape["grip"], start=0.0)
        twist = np.zeros((len(work), 6))
        twist[:, 5] = i.size * slipped
        add_twist(work, "q5", _about_forearm(work, twist))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"grip": float(rng.uniform(1.0, 3.0))}

    return Physics(Kind("slipping-clamp", (("link4",),), typical), act, shape, Stage.LOADS)


def creeping_belt(axes: Axes, typical: float) -> Physics:
    """A friction belt loses a little of every travel: the zero walks by ``size`` rad a turn, less on the way back."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        travel = np.diff(axes.path(work)[:, k], prepend=axes.path(work)[:1, k])
        lost = np.where(travel > 0, travel, i.shape["back"] * travel) / (2 * np.pi)
        return np.asarray(-i.size * np.cumsum(lost)[1::2])

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"back": float(rng.uniform(0.5, 0.9))}

    return displacing(axes, Kind("creeping-belt", places(("q5", "q6")), typical), shift, shape)


def _about_forearm(work: Work, twist: Array) -> Array:
    """(n, 6) turns told in link 4's frame, in that of the axis of joint 5."""
    turn = np.swapaxes(work.solved.axes[:, 4, :3, :3], 1, 2) @ work.solved.links[:, 4, :3, :3]
    return np.hstack([np.einsum("nij,nj->ni", turn, twist[:, part]) for part in (slice(3), slice(3, 6))])
