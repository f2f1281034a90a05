"""Platforms on six legs whose readings follow from the pose in closed form: 6-ups, and 6-pus with vertical or tilted rails."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from ..pairs import Array, Document, Pair
from ..rotations import frame, turn
from .campaign import Campaign, logged, visits
from .conditions import DIGITS, Conditions, sweep
from .reading import Instrument, instrument

GRAVITY = [0.0, 0.0, -9.80665]


@dataclass(frozen=True)
class Legs:
    """a, b (6, 3) mm, u (6, 3) rails, offset (6,), length (6,): those of the other form are unused."""

    a: Array
    b: Array
    u: Array
    offset: Array
    length: Array


@dataclass(frozen=True)
class Drawing:
    """What the file says; mm and deg."""

    form: str
    legs: Legs
    height: float
    base: tuple[Array, Array]
    tool: tuple[Array, Array]
    base_tolerance: tuple[float, float]
    tolerance: float
    instrument: Instrument
    names: list[str]
    angle: float = 0.05
    tool_tolerance: tuple[float, float] = (0.5, 0.2)


def gough(
    form: str,
    sensor: str,
    rng: np.random.Generator,
    *,
    effects: int = 1,
    still: bool = False,
    under: Conditions | None = None,
) -> Pair:
    """A pair of ``6-ups`` or ``6-pus``. ``still``: the platform moves so that one leg keeps its reading."""
    drawn = _drawing(form, sensor, rng)
    if under is not None:
        drawn = _under(drawn, under)
    poses = _poses(drawn, rng, int(rng.integers(35, 70))) if under is None else _asked(drawn, under, rng)
    built = _specimen(drawn, rng)
    exact = _readings(form, built, poses)
    if still:
        poses, exact = _holding(form, built, poses, exact)
    c = visits(exact, int(rng.integers(5, 12)), rng) if under is None else under.visited(exact, rng)
    seen = poses[c.pose.astype(int) - 1]
    base = _mounted(drawn.base, drawn.base_tolerance, rng)
    tool = base @ seen @ _mounted(drawn.tool, drawn.tool_tolerance, rng)
    commanded = _errors(c, drawn, rng, effects)
    if under is not None:
        commanded = c.q + under.physics * (commanded - c.q)
    logs = Campaign(commanded, c.pose, c.approach, c.payload, c.temperature)
    digits = {} if under is None else {"digits": DIGITS}
    table = logged(logs, drawn.names, np.zeros(6), rng, **digits)
    table = pd.concat([table, drawn.instrument.read(tool, rng)], axis=1)
    if under is not None:
        table = under.clocked(table)
    kinds = dict.fromkeys(drawn.names, "prismatic")
    return Pair(f"own {form} {sensor}", _document(drawn, c.q), table, kinds, plain=effects == 0, tool=tool)


def _drawing(form: str, sensor: str, rng: np.random.Generator) -> Drawing:
    size = float(rng.uniform(0.6, 1.8))
    low, high = _ring(rng, size * 400, (6, 20)), _ring(rng, size * rng.uniform(180, 260), (36, 54))
    height = float(np.round(size * rng.uniform(400, 620), 1))
    legs = np.linalg.norm(high + np.array([0.0, 0.0, height]) - low, axis=1)
    offset = np.full(6, float(np.round(legs.mean(), 1)) if rng.random() < 0.6 else 0.0)
    rails = np.tile([0.0, 0.0, 1.0], (6, 1))
    drawn = Legs(
        low, high, rails, offset if form == "6-ups" else np.zeros(6), np.full(6, np.round(legs.mean(), 1))
    )
    if form == "6-pus":  # where the platform stands with all slides at zero
        beside = np.linalg.norm((high - low)[:, :2], axis=1).mean()
        height = float(np.sqrt(drawn.length[0] ** 2 - beside**2))
    pattern = str(rng.choice(["s{}", "L{}"])) if form == "6-ups" else "rho{}"
    far = np.round([*(900 * rng.choice([-1, 1], 2) * rng.uniform(0.6, 2, 2)), rng.uniform(-300, 300)], 0)
    facing = np.round([*rng.uniform(-5, 5, 2), rng.uniform(-170, 170)], 1)
    return Drawing(
        form,
        drawn,
        height,
        (far, facing),
        (np.round([*rng.uniform(-30, 30, 2), rng.uniform(40, 120)], 1), np.zeros(3)),
        (4.0, 0.8) if rng.random() < 0.7 else (np.inf, np.inf),
        float(rng.choice([0.05, 0.1])),
        instrument(sensor, rng, size * 400),
        [pattern.format(k + 1) for k in range(6)],
    )


def _ring(rng: np.random.Generator, radius: float, gaps: tuple[float, float]) -> Array:
    """(6, 3) in pairs about the thirds of a circle."""
    gap = rng.uniform(*gaps)
    azimuth = np.radians(120.0 * np.array([0, 1, 1, 2, 2, 3]) + gap * np.array([1, -1, 1, -1, 1, -1]))
    return np.round(radius * np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(6)], axis=-1), 2)


def _poses(drawn: Drawing, rng: np.random.Generator, n: int) -> Array:
    """(n, 4, 4) of the platform in the base."""
    out = np.tile(np.eye(4), (n, 1, 1))
    for axis in "xyz":
        out = out @ turn(axis, np.radians(rng.uniform(-10, 10, n)))
    reach = 0.12 * drawn.height
    out[:, :3, 3] = np.array([0.0, 0.0, drawn.height]) + rng.uniform(-reach, reach, (n, 3))
    return out


def _under(drawn: Drawing, under: Conditions) -> Drawing:
    """Return the drawing with the noise, tolerances and frames of the conditions."""
    base = (4.0, 0.8) if under.known else (np.inf, np.inf)
    instrument = drawn.instrument.with_sigma(under.sigma)
    return replace(
        drawn,
        tolerance=under.tolerance,
        angle=under.stood((0.0, drawn.angle))[1],
        base_tolerance=under.stood(base),
        tool_tolerance=under.stood(drawn.tool_tolerance),
        instrument=instrument,
    )


def _asked(drawn: Drawing, under: Conditions, rng: np.random.Generator) -> Array:
    """Return poses (n, 4, 4) of the platform, spread or swept as the conditions say."""
    moved = rng.uniform(-1, 1, (under.poses, 6))
    if under.moving:
        moved = sweep(np.zeros(6), np.ones(6), under.poses, rng).q
    out = np.tile(np.eye(4), (under.poses, 1, 1))
    for k, axis in enumerate("xyz"):
        out = out @ turn(axis, np.radians(10.0 * under.turning * moved[:, k]))
    out[:, :3, 3] = 0.12 * drawn.height * moved[:, 3:] + [0.0, 0.0, drawn.height]
    return out


def _readings(form: str, legs: Legs, poses: Array) -> Array:
    """(n, 6) mm."""
    tip = np.einsum("nij,kj->nki", poses[:, :3, :3], legs.b) + poses[:, None, :3, 3]
    reach = tip - legs.a
    if form == "6-ups":
        return np.asarray(np.linalg.norm(reach, axis=2) - legs.offset)
    along = np.einsum("nki,ki->nk", reach, legs.u)
    beside = np.sum(reach**2, axis=2) - along**2
    return np.asarray(along - np.sqrt(legs.length**2 - beside) - legs.offset)


def _holding(form: str, legs: Legs, poses: Array, exact: Array) -> tuple[Array, Array]:
    """Poses lifted so that the third leg reads in every row what it reads in the first."""
    lifted = poses.copy()
    for _ in range(30):
        off = _readings(form, legs, lifted)[:, 2] - exact[0, 2]
        step = lifted.copy()
        step[:, 2, 3] += 1e-3
        slope = (_readings(form, legs, step)[:, 2] - exact[0, 2] - off) / 1e-3
        lifted[:, 2, 3] -= off / slope
    return lifted, _readings(form, legs, lifted)


def _specimen(drawn: Drawing, rng: np.random.Generator) -> Legs:
    legs, tol = drawn.legs, drawn.tolerance
    a, b = (v + tol * rng.standard_normal((6, 3)) for v in (legs.a, legs.b))
    offset, length = (v + tol * rng.standard_normal(6) for v in (legs.offset, legs.length))
    u = legs.u.copy()
    u[:, :2] += np.radians(drawn.angle) * rng.standard_normal((6, 2))
    return Legs(a, b, u / np.linalg.norm(u, axis=1)[:, None], offset, length)


def _mounted(at: tuple[Array, Array], tolerance: tuple[float, float], rng: np.random.Generator) -> Array:
    length, angle = (100.0, 30.0) if np.isinf(tolerance[0]) else tolerance
    return frame(at[0] + length * rng.standard_normal(3), np.radians(at[1] + angle * rng.standard_normal(3)))


def _errors(c: Campaign, drawn: Drawing, rng: np.random.Generator, effects: int) -> Array:
    """(n, 6) what was commanded for legs that stand where the poses need them: play, screws, heat."""
    out, chosen = c.q.copy(), set(rng.permutation(3)[:effects].tolist())
    if 0 in chosen:
        out += 0.5 * rng.uniform(0, 0.06, 6) * c.approach
    if 1 in chosen:
        k = int(rng.integers(6))
        out[:, k] -= rng.uniform(0.01, 0.04) * np.sin(2 * np.pi * c.q[:, k] / 5.0 + rng.uniform(0, 6))
    if 2 in chosen:
        out -= (
            1.2e-5 * (c.temperature - 20.0)[:, None] * (drawn.legs.length if drawn.form == "6-ups" else 0.0)
        )
    return np.asarray(out)


def _document(drawn: Drawing, q: Array) -> Document:
    low, high = np.floor(q.min() - 5.0), np.ceil(q.max() + 5.0)
    told = low > 0 or high > 150.0  # readings that are whole lengths: zero is out of reach
    legs: list[dict[str, Any]] = []
    for k, name in enumerate(drawn.names):
        ends = {"a": drawn.legs.a[k].tolist(), "b": drawn.legs.b[k].tolist()}
        own = (
            {"offset": float(drawn.legs.offset[k])}
            if drawn.form == "6-ups"
            else {"u": drawn.legs.u[k].tolist(), "length": float(drawn.legs.length[k])}
        )
        legs.append({"name": f"leg{k + 1}", "joint": name, **ends, **own, "screw_pitch": 5.0})
        if told:
            legs[-1]["range"] = [float(low), float(high)]
    mechanism = {"type": drawn.form, "legs": legs, "home": [0.0, 0.0, drawn.height, 0.0, 0.0, 0.0]}
    length, angle = drawn.base_tolerance
    base = {"in": "world", "xyz": drawn.base[0].tolist(), "rpy": drawn.base[1].tolist()}
    tool = {"in": "flange", "xyz": drawn.tool[0].tolist(), "rpy": drawn.tool[1].tolist()}
    return {
        "schema": "truepose/machine/1",
        "name": "platform",
        "units": {"length": "mm", "angle": "deg"},
        "gravity": list(GRAVITY),
        "mechanism": mechanism,
        "frames": {
            "base": {**base, "tolerance": {"xyz": length, "rpy": angle}},
            "tool": {**tool, "tolerance": dict(zip(("xyz", "rpy"), drawn.tool_tolerance, strict=True))},
        },
        "sensor": drawn.instrument.section(),
        "tolerances": {"length": drawn.tolerance, "angle": drawn.angle},
        "masses": {"platform": {"kg": 20.0, "com": [0.0, 0.0, 15.0], "in": "platform"}},
    }
