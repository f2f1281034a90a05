"""What the polishing robot adds: limbs and gears that yield to weight, joints that run out, hoses, slack, warm gantries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from .base import Array, Imperfection, Kind, Place
from .hybrid_geometry import LIMBS, PASSIVE, Assembled
from .joint_physics import TURN, Axes, phase, places
from .mechanism_frames import fixed
from .motions import applied
from .mount_physics import Grow, body_temperature
from .ported import Physics, Stage, Work, shapeless

GRAVITY = np.array([4.903325, 0.0, 8.4928078])
"""m/s^2 in the base frame: the robot hangs 30 deg off the vertical."""
HEAD_KG, HEAD_COM, PAYLOAD_COM = 22.0, (0.0, 12.0, -40.0), (0.0, 0.0, 150.0)
"""kg; mm in the tool frame."""
METRE = 1000.0


def renamed(physics: Physics, name: str) -> Physics:
    """The same under another name of the kind: another size is usual at these joints."""
    return replace(physics, kind=replace(physics.kind, name=name))


def weights(work: Work) -> tuple[tuple[Array, Array], ...]:
    """Forces (n, 3) N of head and payload, and where they act (n, 3) mm, base frame."""
    solved: Assembled = work.solved
    loads = ((np.full(len(work), HEAD_KG), HEAD_COM), (work.campaign.payload, PAYLOAD_COM))
    return tuple((kg[:, None] * GRAVITY, applied(solved.tool, np.array(com))) for kg, com in loads)


def limb_forces(work: Work) -> Array:
    """(n, 3) N, tension positive: the power of weight as each limb alone stretches, by virtual work."""
    solved: Assembled = work.solved
    total = np.zeros((len(work), 3))
    for force, point in weights(work):
        moving = solved.axes[..., :3] + np.cross(solved.axes[..., 3:], point[:, None])
        total += np.einsum("nki,ni->nk", moving, force)
    return total


def wrist_torques(work: Work) -> Array:
    """(n, 3) N m that weight exerts about q4, q5, q6."""
    solved: Assembled = work.solved
    total = np.zeros((len(work), 3))
    for force, point in weights(work):
        axis, at = solved.wrist[:, :, 0], solved.wrist[:, :, 1]
        total += np.einsum("nki,nki->nk", axis, np.cross(point[:, None] - at, force[:, None])) / METRE
    return total


def base_moment(work: Work) -> Array:
    """(n, 3) N m of weight about the base's origin."""
    return np.asarray(sum(np.cross(point, force) for force, point in weights(work)) / METRE)


def growing_limb(names: Sequence[str], k: int) -> Grow:
    """Limb k grows as a whole: reading and offset."""

    def grow(work: Work, strain: Array) -> None:
        work.moved[:, k] += strain * (work.campaign.q[:, k] + work.value(f"{names[k]}.offset"))

    return grow


def elastic(axes: Axes) -> tuple[Physics, ...]:
    """Limbs, wrist gears and the gantry under the weight of head and tool; ``size`` in mm/N or rad/(N m)."""

    def limb(work: Work, i: Imperfection) -> None:
        k = int(i.place[0].removeprefix("leg")) - 1
        work.moved[:, k] += i.size * limb_forces(work)[:, k]

    def gear(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        work.moved[:, k] += i.size * wrist_torques(work)[:, k - 3]

    def sag(work: Work, i: Imperfection) -> None:
        moment = base_moment(work)
        for k, axis in enumerate("xyz"):
            work.add(f"base.motion.r{axis}", i.size * moment[:, k])

    legs, wrist = places([f"leg{k}" for k in LIMBS]), places(axes.names[3:])
    load = ("payload",)
    return (
        Physics(
            Kind("leg-compliance", legs, 5e-5, "leg-compliance", load, conceals=True),
            limb,
            shapeless,
            Stage.LOADS,
        ),
        Physics(
            Kind("joint-compliance", wrist, 2e-6, "joint-compliance", load), gear, shapeless, Stage.LOADS
        ),
        Physics(Kind("gravity-sag", (("base",),), 3e-7, "gravity-sag", load), sag, shapeless, Stage.LOADS),
    )


def runout() -> Physics:
    """A crossed joint whose pin is not round: its centre wanders by ``size`` mm across it as it turns."""

    def act(work: Work, i: Imperfection) -> None:
        solved: Assembled = work.solved
        name = i.place[0]
        angle = i.shape["lobes"] * solved.passive[:, PASSIVE.index(name)] + i.shape["phase"]
        across = (1, 2) if name.endswith("a") else (0, 2)
        held = fixed(work, name)[:, :3, :3]  # the pin turns with its bracket, which stands askew in the base
        wander = held[..., across[0]] * np.cos(angle)[:, None] + held[..., across[1]] * np.sin(angle)[:, None]
        for k, axis in enumerate("xyz"):
            work.add(f"{name}.{axis}", i.size * wander[:, k])

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lobes": float(rng.choice([2, 3, 4, 8])), "phase": float(rng.uniform(0, TURN))}

    names = [f"u{k}{side}" for k in LIMBS for side in "ab"]
    kind = Kind("joint-runout", places(names), 0.05, "joint-runout", conceals=True)
    return Physics(kind, act, shape, Stage.LOADS)


def unnamed(axes: Axes) -> tuple[Physics, ...]:
    """What the interface has no word for."""
    return (_hose(axes), _loose_spline(), _rocking_head(), _warm_gantry())


def _hose(axes: Axes) -> Physics:
    """A hose along the wrist pulls at q5 as q4 and q6 wind it up together: ``size`` rad at half a turn."""

    def act(work: Work, i: Imperfection) -> None:
        wound = work.campaign.q[:, 3] + work.campaign.q[:, 5]
        work.moved[:, axes.index(i.place)] += i.size * np.sin(1.5 * wound + i.shape["phase"])

    return Physics(Kind("hose-pulls-wrist", (("q5",),), 2e-4), act, phase)


def _loose_spline() -> Physics:
    """The middle limb's spline lets the platform roll about it by ``size`` rad to either side, softly at first."""

    def act(work: Work, i: Imperfection) -> None:
        solved: Assembled = work.solved
        axis, at = solved.platform[:, :3, 2], solved.platform[:, :3, 3]
        rolling = sum(
            np.einsum("ni,ni->n", axis, np.cross(point - at, force)) / METRE for force, point in weights(work)
        )
        work.add("up3.rz", i.size * np.tanh(rolling / i.shape["soft"]))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"soft": float(rng.uniform(5, 20))}

    return Physics(Kind("spline-slack", (("platform",),), 1.5e-4), act, shape, Stage.LOADS)


def _rocking_head() -> Physics:
    """The head's flange rocks on its bolts: heavy tools leaning far to one side slip it ``size`` mm, to the other side back."""

    def act(work: Work, i: Imperfection) -> None:
        lean = np.where(work.campaign.payload >= i.shape["kg"], work.campaign.q[:, 4], 0.0)
        slipped = np.empty(len(work))
        state = 0.0
        for row, angle in enumerate(lean):
            state = 1.0 if angle > i.shape["lean"] else 0.0 if angle < -i.shape["lean"] else state
            slipped[row] = state
        work.add("tool.motion.x", i.size * slipped * np.cos(i.shape["phase"]))
        work.add("tool.motion.rz", i.size / 100.0 * slipped)

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {
            "lean": float(rng.uniform(0.1, 0.4)),
            "kg": float(rng.uniform(1.0, 5.0)),
            "phase": float(rng.uniform(0, TURN)),
        }

    return Physics(Kind("head-rocks-under-load", (("tool",),), 0.05, needs=("payload",)), act, shape)


def _warm_gantry() -> Physics:
    """The gantry bends as limb 1 is warmer than the room, an hour late: ``size`` rad per kelvin."""

    def act(work: Work, i: Imperfection) -> None:
        uneven = body_temperature(work, "leg1", i.shape["lag"]) - body_temperature(
            work, "air", i.shape["lag"]
        )
        work.add("base.motion.ry", i.size * uneven)
        work.add("base.motion.x", 300.0 * i.size * np.abs(uneven))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"lag": float(rng.uniform(1200, 3600))}

    return Physics(
        Kind("gantry-bends-by-warm-limb", (("base",),), 8e-5, needs=("temperature.leg1",)), act, shape
    )


__all__ = ["GRAVITY", "elastic", "growing_limb", "renamed", "runout", "unnamed"]
