"""What the arm can have that the interface has a name for, beside what any joint or mount can.

Loads are those of true masses in the bent pose. A size of 1 of what yields is the yielding of the part as drawn here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from . import operators
from .arm_drawing import JOINTS, MASSES
from .base import Array, Imperfection, Kind, Place
from .cantilever import Section, cantilever
from .joint_physics import TURN, Axes, displacing, places
from .ported import Physics, Stage, Work
from .rigid import unit_vector

COMPLIANCE = {"q2": 1.0e-6, "q3": 1.8e-6, "q4": 6e-6, "q5": 9e-6, "q6": 1.5e-5}
"""Of gears and bearings, rad/(N*m)."""
TUBES = {"link2": Section.box(110, 99), "link4": Section.tube(96, 88)}
MOUNT = {"base": 1.5e-7, "tool": 1.2e-5}
"""rad/(N*m) of floor and of tool changer."""
DISTANCES, SHARES = (0.02, 0.09, 0.3), (0.5, 0.3, 0.2)
"""Pre-sliding of the gears' friction: rad to slip, and share of the Coulomb limit."""


def joint_compliance(axes: Axes) -> Physics:
    """A joint gives way linearly; ``size`` in units of its usual compliance (``COMPLIANCE``)."""

    def act(work: Work, i: Imperfection) -> None:
        k = axes.index(i.place)
        work.moved[:, k] += i.size * COMPLIANCE[i.place[0]] * work.solved.torque(k)

    kind = Kind("joint-compliance", places(("q2", "q3", "q4", "q5")), 1.0, "joint-compliance")
    return Physics(kind, act, stage=Stage.LOADS)


def link_bending() -> Physics:
    """A tube bends under its own weight and all it carries; ``size`` 1: the tube of ``TUBES``."""

    def act(work: Work, i: Imperfection) -> None:
        link = int(i.place[0][-1])
        outer = JOINTS[link]
        frame, carrier = work.solved.links[:, link], work.solved.axes[:, link]
        tip = np.array([np.mean(work.value(f"{outer}.d")), 0.0, 0.0])
        root = np.array([0.0, 0.0, -np.mean(work.value(f"{JOINTS[link - 1]}.r"))])
        by_wrench, by_weight = cantilever(root, tip, TUBES[i.place[0]])
        into = np.swapaxes(frame[:, :3, :3], 1, 2)
        local = [np.einsum("nij,nj->ni", into, v) for v in work.solved.borne(link)]
        own = work.solved.weights[:, list(MASSES).index(i.place[0])]
        bent = np.hstack(local) @ by_wrench.T + np.einsum("nij,nj->ni", into, own) @ by_weight.T
        turn = np.swapaxes(carrier[:, :3, :3], 1, 2) @ frame[:, :3, :3]
        twist = [np.einsum("nij,nj->ni", turn, bent[:, part]) for part in (slice(3), slice(3, 6))]
        add_twist(work, outer, i.size * np.hstack(twist))

    return Physics(
        Kind("link-bending", places(TUBES), 1.0, "link-bending", conceals=True), act, stage=Stage.LOADS
    )


def gravity_sag() -> Physics:
    """A mount that turns with the moment it bears, a little more about one axis; ``size`` 1: ``MOUNT``."""

    def act(work: Work, i: Imperfection) -> None:
        mount = i.place[0]
        link, number = (0, 0) if mount == "base" else (6, 7)
        frame = work.solved.links[:, link]
        moment = work.solved.moment(number, frame[:, :3, 3])
        local = np.einsum("nji,nj->ni", frame[:, :3, :3], moment)
        ratio = np.array([i.shape["ratio"], 1 / i.shape["ratio"], 1.0])
        turn = i.size * MOUNT[mount] * ratio * local
        add_twist(work, mount, np.hstack([np.zeros_like(turn), turn]))

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"ratio": float(rng.uniform(0.93, 1.07))}

    return Physics(Kind("gravity-sag", places(MOUNT), 1.0, "gravity-sag"), act, shape, Stage.LOADS)


def friction_hysteresis(axes: Axes, typical: float) -> Physics:
    """Friction winds up the gear: ``size`` (rad) when it slips, less on the way there, by the true path."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        distances = [i.shape["reach"] * d for d in DISTANCES]
        return (
            -i.size
            * operators.at_rows(operators.presliding(axes.path(work)[:, [k]], distances, SHARES))[:, 0]
        )

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return {"reach": float(rng.uniform(0.7, 1.6))}

    needs = ("approach.q1",)
    kind = Kind("friction-hysteresis", places(axes.names), typical, "friction-hysteresis", needs)
    return displacing(axes, kind, shift, shape)


def transmission_error(axes: Axes, ratios: Sequence[float], typical: float) -> Physics:
    """Two lobes of the wave generator mesh twice a turn of the motor, with an overtone and a trace once a turn."""

    def shift(work: Work, i: Imperfection, k: int) -> Array:
        cycles = [n * ratios[k] for n in (1, 2, 4)]
        sizes = [i.size * share for share in (i.shape["once"], 1.0, i.shape["four"])]
        phases = [i.shape[f"phase{n}"] for n in (1, 2, 4)]
        return operators.mesh_error(work.campaign.q[:, k], cycles, sizes, phases)

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        phases = {f"phase{n}": float(rng.uniform(0, TURN)) for n in (1, 2, 4)}
        return phases | {"once": float(rng.uniform(0, 0.3)), "four": float(rng.uniform(0, 0.3))}

    kind = Kind("transmission-error", places(axes.names), typical, "transmission-error")
    return displacing(axes, kind, shift, shape)


def axis_wobble(axes: Axes, typical: float) -> Physics:
    """A bearing whose rings are not round: the axis tilts once and twice a turn, not on a circle; ``size`` rad."""

    def act(work: Work, i: Imperfection) -> None:
        k, s = axes.index(i.place), i.shape
        angle = work.campaign.q[:, k]
        x = np.sin(angle + s["phase"]) + s["second"] * np.sin(2 * angle + s["late"])
        y = s["across"] * np.sin(angle + s["turn"]) + s["second"] * np.cos(2 * angle + s["late"])
        tilt = np.stack([0 * x, 0 * x, 0 * x, x, y, 0 * x], axis=-1)
        add_twist(work, i.place[0], i.size * tilt)

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        phases = {name: float(rng.uniform(0, TURN)) for name in ("phase", "late", "turn")}
        return phases | {"second": float(rng.uniform(0.2, 0.7)), "across": float(rng.uniform(0.2, 1.0))}

    return Physics(Kind("axis-wobble", places(axes.names), typical, "axis-wobble"), act, shape)


def target_offset(targets: Sequence[str], typical: float) -> Physics:
    """A reflector that does not sit where its nest is: ``size`` mm in any direction."""

    def act(work: Work, i: Imperfection) -> None:
        for axis in "xyz":
            work.add(f"{i.place[0]}.{axis}", i.size * i.shape[axis])

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return dict(zip("xyz", map(float, unit_vector(rng)), strict=True))

    return Physics(
        Kind("target-offset", places(targets), typical, "target-offset", conceals=True), act, shape
    )


def sensor_scale(typical: float, lengths: int) -> Physics:
    """The first ``lengths`` columns read (1 + size) times true; the machine's own lengths swallow most of it."""

    def act(work: Work, i: Imperfection) -> None:
        work.seen[:, :lengths] *= 1 + i.size

    kind = Kind("sensor-scale", (("sensor",),), typical, "sensor-scale", conceals=True)
    return Physics(kind, act, stage=Stage.INSTRUMENT)


def latency(columns: Sequence[str], typical: float) -> Physics:
    """Joints are read ``size`` s after the instrument saw the tool: it stood velocity * size behind."""

    def act(work: Work, i: Imperfection) -> None:
        if work.campaign.velocity is not None:
            work.moved -= i.size * work.campaign.velocity

    kind = Kind("latency", (("sensor",),), typical, "latency", (f"velocity.{columns[0]}",))
    return Physics(kind, act)


def add_twist(work: Work, name: str, twist: Array) -> None:
    """Add (n, 6) to the motion of a joint's axis or a mount."""
    for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
        work.add(f"{name}.motion.{axis}", twist[:, k])
