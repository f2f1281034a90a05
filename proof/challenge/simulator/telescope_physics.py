"""What the telescope adds: a ring that bends, legs that yield, bent flexures, rails off their line."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from .base import Array, Imperfection, Kind
from .joint_physics import Axes, places, rail_profile
from .mechanism_frames import error_motion, fixed
from .ported import Act, Drawn, Physics, Stage, Work, shapeless
from .telescope_geometry import FLEXURE, LEGS, Assembled, as_built, leg_forces
from .telescope_ring.ring import Ring, leg_end_compliance, leg_end_nodes
from .telescope_ring.statics import Flexure, elastic_poses, rigid_poses

POINTS = tuple(f"{end}.{axis}" for end in "ab" for axis in "xyz")
BESIDE = 2.0
"""rad: the arc about the leg's side of a rail within which a rail leaves its line; beside it nothing would be seen."""
RING = Ring()


@lru_cache(maxsize=1)
def _compliance() -> Array:
    out = leg_end_compliance(RING)
    out.flags.writeable = False
    return out


def home_height(drawing: Mapping[str, Drawn]) -> float:
    """Height of the platform as drawn, all slides at zero, mm."""
    n = np.array([[drawing[f"{leg}.{p}"].nominal for p in POINTS] for leg in LEGS])
    lengths = np.array([drawing[f"{leg}.length"].nominal for leg in LEGS])
    beside = n[:, :2] - n[:, 3:5]
    return float(np.sqrt(np.mean(lengths**2 - np.sum(beside**2, axis=1))))


def platform() -> tuple[Physics, ...]:
    """The elastic ring, ``size`` times as soft as drawn: bent by the flexures' moments, and by the legs' forces."""

    def by_flexures(work: Work, i: Imperfection) -> None:
        bent = elastic_poses(
            as_built(work), _moved(work), Flexure(FLEXURE), leg_end_nodes(RING), i.size * _compliance()
        )
        _shift_ends(work, bent.leg_end_displacement)

    def by_weight(work: Work, i: Imperfection) -> None:
        solved: Assembled = work.solved
        pull = -solved.along * _forces(work)[..., None]
        own = np.einsum("nji,nkj->nki", solved.platform[:, :3, :3], pull)
        loads = np.concatenate([own, np.zeros_like(own)], axis=-1).reshape(len(work), 36)
        bent = (loads @ (i.size * _compliance())).reshape(len(work), 6, 6)
        _shift_ends(work, bent[..., :3])

    place = (("platform",),)
    slug = "platform-deformation"
    return (
        Physics(Kind(slug, place, 0.2, slug, conceals=True), by_flexures),
        Physics(
            Kind("platform-bends-by-weight", place, 1.0, slug, ("payload",), conceals=True),
            by_weight,
            shapeless,
            Stage.LOADS,
        ),
    )


def _moved(work: Work) -> Array:
    """(n, 6) travel less the offsets that a ``Machine`` adds itself, mm."""
    return np.asarray(work.campaign.q + work.moved)


def _shift_ends(work: Work, shift: Array) -> None:
    """Move the legs' upper ends by (n, 6, 3) in the platform's frame."""
    for k, leg in enumerate(LEGS):
        for j, axis in enumerate("xyz"):
            work.add(f"{leg}.b.{axis}", shift[:, k, j])


def _forces(work: Work) -> Array:
    return leg_forces(work, error_motion(work, "tool") @ fixed(work, "tool"))


def leg_compliance() -> Physics:
    """A leg that grows ``size`` mm per N of tension, the truss in balance as it stands."""

    def act(work: Work, i: Imperfection) -> None:
        k = LEGS.index(i.place[0])
        work.add(f"{i.place[0]}.length", i.size * _forces(work)[:, k])

    kind = Kind("leg-compliance", places(LEGS), 2e-4, "leg-compliance", ("payload",), conceals=True)
    return Physics(kind, act, shapeless, Stage.LOADS)


def _straight(work: Work) -> tuple[Array, Array]:
    """(6, 3) directions of the legs where the flexures are straight, at zero travel: base frame, platform frame."""
    machine = as_built(work)
    home = rigid_poses(machine, np.zeros((1, 6)))
    tip = home.position[0] + machine.upper_centres @ home.rotation[0].T
    along = tip - machine.lower_centres(np.zeros(6))
    along = along / np.linalg.norm(along, axis=1)[:, None]
    return along, along @ home.rotation[0]


def beyond_middle(angle: Array) -> Array:
    """How far the tangents of a flexure bent to an arc meet beyond half its length: l tan(w/2) / w - l/2, mm."""
    half = np.maximum(angle, 1e-9) / 2
    return np.asarray(FLEXURE / 2 * (np.tan(half) / half - 1))


def flexure_shift() -> Physics:
    """Flexures bent to arcs of circles turn about the point where the tangents at their ends meet; ``size`` 1."""

    def act(work: Work, i: Imperfection) -> None:
        solved: Assembled = work.solved
        base, own = _straight(work)
        upward = np.einsum("nij,kj->nki", solved.platform[:, :3, :3], own)
        for name in i.place:
            k = LEGS.index(name)
            low, high = (
                i.size * beyond_middle(_angle(solved.along[:, k], straight))
                for straight in (np.broadcast_to(base[k], (len(work), 3)), upward[:, k])
            )
            work.add(f"{name}.length", low + high)
            for j, axis in enumerate("xyz"):
                work.add(f"{name}.a.{axis}", low * base[k, j])
                work.add(f"{name}.b.{axis}", -high * own[k, j])

    # one leg alone: its flexures are what all have, the others' are compensated
    kind = Kind("flexure-shift", (LEGS, *places(LEGS)), 1.0, "flexure-shift")
    return Physics(kind, act, shapeless, Stage.LOADS)


def _angle(one: Array, two: Array) -> Array:
    """(n,) rad between unit vectors (n, 3)."""
    angle: Array = np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.sum(one * two, axis=1))
    return angle


def tilt(work: Work, k: int) -> Array:
    """(n,) rad by which leg k's upper flexure is bent."""
    solved: Assembled = work.solved
    own = _straight(work)[1]
    straight: Array = solved.platform[:, :3, :3] @ own[k]
    return _angle(solved.along[:, k], straight)


def rail_wanders(axes: Axes) -> Act:
    """The lower joint follows the rail off its line."""

    def act(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        leg = LEGS[k]
        side = [work.value(f"{leg}.b.{c}")[0] - work.value(f"{leg}.a.{c}")[0] for c in "xy"]
        angle = np.arctan2(side[1], side[0]) + BESIDE * (i.shape["direction"] / (2 * np.pi) - 0.5)
        off = i.size * rail_profile(i.shape, axes.share(work, k))
        work.add(f"{leg}.a.x", off * np.cos(angle))
        work.add(f"{leg}.a.y", off * np.sin(angle))

    return act


def tilted_rail() -> Physics:
    """A rail put up ``size`` rad off its direction."""

    def act(work: Work, i: Imperfection) -> None:
        work.add(i.place[0], i.size)

    names = [f"{leg}.u.{axis}" for leg in LEGS for axis in "xy"]
    return Physics(Kind("rail-tilted", places(names), 0.015, "wrong-constant", conceals=True), act)


__all__ = [
    "POINTS",
    "beyond_middle",
    "flexure_shift",
    "home_height",
    "leg_compliance",
    "platform",
    "rail_wanders",
    "tilt",
    "tilted_rail",
]
