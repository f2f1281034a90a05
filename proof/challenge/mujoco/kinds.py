"""What can be wrong with an arm, and what that is in MuJoCo.

Sizes of what yields count in usual ones: a joint turns by ``WINDUP`` under the weight of the outstretched arm, a link's
end and a mount likewise. Gaps, slips and waves are rad.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from challenge.mujoco.drawing import Drawing
from challenge.mujoco.mjcf import Bend, Yielding, reach
from challenge.simulator.base import Imperfection, Kind, Place

Array = NDArray[np.float64]
COMPLIANCE, FRICTION, BACKLASH = "joint-compliance", "friction-hysteresis", "backlash"
COUPLING, BENDING, SAG = "axis-coupling", "link-bending", "gravity-sag"
GEAR, DISC = "transmission-error", "encoder-eccentricity"
WEIGHED, BEARING, FLANGE = "play-under-weight", "loose-bearing", "loose-flange"
"""Without a name in the catalogue: what is loose lies where its weight puts it."""
WINDUP, BENT, SUNK = 3e-4, 2e-4, 1e-4
"""rad under the weight of the outstretched arm, of a joint, a link's end, a mount."""
RUB = 0.4
"""Friction of a joint over the weight on it, where ``size`` is what that winds up."""
RUBS = {BACKLASH: (2.0, 5.0), WEIGHED: (0.05, 0.5)}
"""The same where a gear has play: friction that holds it where it was left, or that the weight overcomes."""
SHORTEST = 0.1
"""m: shorter links do not bend."""
TURN = 2 * np.pi


@dataclass(frozen=True)
class Physics:
    """What is built into the model, and what the gears add (n, nq) rad to the motors' angles q (n, nq)."""

    yielding: Yielding
    waves: tuple[tuple[int, float, float, float], ...] = ()

    def motors(self, q: Array) -> Array:
        """(n, nq) where the motors put what is behind the gears."""
        out = q.copy()
        for joint, cycles, size, phase in self.waves:
            out[:, joint] += size * (np.sin(cycles * q[:, joint] + phase) - np.sin(phase))
        return out


def kinds(drawing: Drawing) -> tuple[Kind, ...]:
    """Kinds with their places; sizes are drawn in detection limits, so that a place where nothing shows falls out."""
    joints, n = drawing.joints, len(drawing.joints)
    rows = drawing.rows({})
    long = tuple((f"link{k + 1}",) for k in range(1, n - 1) if np.linalg.norm(reach(rows, k)) > SHORTEST)
    every = tuple((j,) for j in joints)
    wrist = tuple((joints[a], joints[b]) for a, b in ((n - 1, n - 2), (n - 1, n - 3), (n - 2, n - 3)))
    side = ("approach.q1",)
    return (
        Kind(COMPLIANCE, every[1:-1], 1.0, COMPLIANCE),
        Kind(BENDING, long, 1.0, BENDING, conceals=True),
        Kind(SAG, (("base",), ("tool",)), 1.0, SAG),
        Kind(FRICTION, every, 1e-4, FRICTION, side),
        Kind(BACKLASH, every, 3e-4, BACKLASH, side),
        Kind(COUPLING, wrist, 1e-3, COUPLING),
        Kind(GEAR, every, 1.5e-4, GEAR),
        Kind(DISC, every, 2e-4, DISC),
        Kind(WEIGHED, every[1:-1], 4e-4),
        Kind(BEARING, every[1:-1], 3e-4),
        Kind(FLANGE, (("tool",),), 6e-4),
    )


def shape(kind: str, place: Place, rng: np.random.Generator) -> Mapping[str, float]:
    """What is drawn beside the size."""
    if kind == BENDING:
        return {"pieces": float(rng.integers(1, 3)), "twists": float(rng.integers(2))}
    if kind == SAG:
        return dict(zip("xyz", map(float, rng.uniform(0.9, 1.1, 3)), strict=True))
    if kind in RUBS:
        low, high = RUBS[kind]
        return {"rub": float(np.exp(rng.uniform(np.log(low), np.log(high))))}
    if kind == GEAR:
        return {
            "once": float(rng.uniform(0, 0.3)),
            **{f"phase{n}": float(rng.uniform(0, TURN)) for n in (1, 2)},
        }
    return {"phase1": float(rng.uniform(0, TURN))} if kind == DISC else {}


def built(drawing: Drawing, imperfections: Iterable[Imperfection]) -> Physics:
    """All of them in one model. Raises ValueError for a kind or place that is unknown."""
    known = {kind.name: kind for kind in kinds(drawing)}
    parts: dict[str, list[Imperfection]] = {name: [] for name in known}
    for i in imperfections:
        if i.kind not in known or i.place not in known[i.kind].places:
            raise ValueError(f"found {i.kind!r} at {i.place}, expected a kind and place of {sorted(known)}")
        if i.size != 0.0:
            parts[i.kind].append(i)
    out = _joints(drawing, parts)
    rows, (strength, held) = drawing.rows({}), drawing.strengths()
    bends, mounts = {}, {}
    for i in parts[BENDING]:
        link = int(i.place[0].removeprefix("link"))
        length = float(np.linalg.norm(reach(rows, link - 1)))
        stiffness = strength[link] * length / (BENT * i.size)
        bends[link] = Bend(float(stiffness), int(i.shape["pieces"]), bool(i.shape["twists"]))
    for i in parts[SAG]:
        stiffness = (strength[0] if i.place[0] == "base" else held) / (SUNK * i.size)
        mounts[i.place[0]] = (stiffness * i.shape["x"], stiffness * i.shape["y"], stiffness * i.shape["z"])
    couplings = {(_joint(i.place[0]), _joint(i.place[1])): i.size for i in parts[COUPLING]}
    loose = {i.place[0]: i.size for i in (*parts[BEARING], *parts[FLANGE])}
    out = replace(out, couplings=couplings, bends=bends, mounts=mounts, loose=loose)
    return Physics(out, tuple(_waves(drawing, (*parts[GEAR], *parts[DISC]))))


def _joints(drawing: Drawing, parts: Mapping[str, Sequence[Imperfection]]) -> Yielding:
    """Springs, gaps and friction; a drive with friction alone bears the weight itself, so that only friction winds it up."""
    strength = drawing.strengths()[0]
    springs = {(k := _joint(i.place[0])): strength[k] / (WINDUP * i.size) for i in parts[COMPLIANCE]}
    soft = frozenset(springs)
    play = (*parts[BACKLASH], *parts[WEIGHED])
    gaps = {_joint(i.place[0]): i.size for i in play}
    friction = {(k := _joint(i.place[0])): i.shape["rub"] * strength[k] for i in play}
    for i in parts[FRICTION]:
        k = _joint(i.place[0])
        springs.setdefault(k, RUB * strength[k] / 1e-4)
        friction[k] = friction.get(k, 0.0) + springs[k] * i.size
    fed = frozenset(springs) - soft
    return Yielding(
        {k: float(v) for k, v in springs.items()}, gaps, {k: float(v) for k, v in friction.items()}, fed
    )


def _waves(drawing: Drawing, gears: Iterable[Imperfection]) -> Iterable[tuple[int, float, float, float]]:
    for i in gears:
        k = _joint(i.place[0])
        if i.kind == DISC:
            yield k, 1.0, i.size, i.shape["phase1"]
        else:
            yield k, float(drawing.gears[k]), i.size * i.shape["once"], i.shape["phase1"]
            yield k, 2.0 * drawing.gears[k], i.size, i.shape["phase2"]


def _joint(name: str) -> int:
    return int(name.removeprefix("q")) - 1


__all__ = ["Physics", "built", "kinds", "shape"]
