"""Hybrids 3UPS-UP + 3R: a passive limb that turns about x, then y, and slides along z, three limbs beside it, a wrist.

Limb lengths follow from the platform's pose in closed form, in numpy alone: mm, rad.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..pairs import Array, Document, Pair
from ..rotations import frame, shift, turn
from .campaign import Campaign, logged
from .conditions import DIGITS, Conditions
from .reading import Instrument, instrument

TILT, WRIST = 20.0, 45.0
"""deg by which the passive limb and the wrist turn, at most."""
KNOWN, HELD = (4.0, 0.8), (0.5, 0.2)
"""mm and deg to which a base and a tool are known."""


@dataclass(frozen=True)
class Hybrid:
    """a, b (3, 3) ends of the limbs on base and platform, offset from the platform to the wrist's centre; mm."""

    a: Array
    b: Array
    offset: float

    def platform(self, passive: Array) -> Array:
        """Return poses (n, 4, 4) of the platform: passive (n, 3) turns about x and y (rad), and the slide (mm)."""
        return np.asarray(turn("x", passive[:, 0]) @ turn("y", passive[:, 1]) @ shift(z=passive[:, 2]))

    def limbs(self, passive: Array) -> Array:
        """Return the lengths (n, 3) of the limbs."""
        at = self.platform(passive)
        tip = np.einsum("nij,kj->nki", at[:, :3, :3], self.b) + at[:, None, :3, 3]
        return np.asarray(np.linalg.norm(tip - self.a, axis=2))

    def flange(self, passive: Array, wrist: Array) -> Array:
        """Return poses (n, 4, 4) of the flange; wrist (n, 3) turns about z, y, x."""
        turned = turn("z", wrist[:, 0]) @ turn("y", wrist[:, 1]) @ turn("x", wrist[:, 2])
        return np.asarray(self.platform(passive) @ shift(z=self.offset) @ turned)


@dataclass(frozen=True)
class Drawing:
    """What the file says: radii and offset (mm), middle of the slide, base and tool (mm, deg), the instrument."""

    radii: tuple[float, float]
    offset: float
    middle: float
    base: tuple[Array, Array]
    tool: tuple[Array, Array]
    instrument: Instrument

    @property
    def exact(self) -> Hybrid:
        """The machine as drawn."""
        azimuth = np.radians([0.0, 120.0, 240.0])
        ring = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=1)
        return Hybrid(self.radii[0] * ring, self.radii[1] * ring, self.offset)


def hybrid(sensor: str, rng: np.random.Generator, *, effects: int, under: Conditions) -> Pair:
    """A pair of a hybrid under conditions, with play and screws that err where ``effects`` are asked for."""
    drawn = _drawing(sensor, rng, under)
    t, angle = under.tolerance, np.radians(under.angle(drawn.middle))
    exact = drawn.exact
    off = t * rng.standard_normal((2, 3, 3))
    built = Hybrid(exact.a + off[0], exact.b + off[1], exact.offset)
    turns = np.array([True, True, False, True, True, True])
    high = np.array([*np.radians([TILT, TILT]), 0.25 * drawn.middle, *np.radians([WRIST] * 3)])
    at = np.array([0.0, 0.0, drawn.middle, 0.0, 0.0, 0.0])
    c = under.campaign(at - high, at + high, turns, rng)
    passive, wrist = c.q[:, :3], c.q[:, 3:]
    zeros = angle * rng.standard_normal(3)
    sides = np.where(rng.random(c.q.shape) < 0.5, -1.0, 1.0)
    read = np.hstack([built.limbs(passive) - t * rng.standard_normal(3), wrist - zeros])
    read += under.physics * _physics(read, sides, effects, rng)
    mounts = _mounts(drawn, under, rng)
    tool = mounts[0] @ built.flange(passive, wrist) @ mounts[1]
    names = [f"q{k}" for k in range(1, 7)]
    logs = Campaign(read, c.pose, sides, c.payload, c.temperature)
    turning = np.array([False] * 3 + [True] * 3)
    table = pd.concat([logged(logs, names, turning, rng, DIGITS), drawn.instrument.read(tool, rng)], axis=1)
    kinds = dict(zip(names, ["prismatic"] * 3 + ["revolute"] * 3, strict=True))
    document = _document(drawn, under, read[:, :3])
    return Pair(f"hybrid {sensor}", document, under.clocked(table), kinds, plain=effects == 0, tool=tool)


def _drawing(sensor: str, rng: np.random.Generator, under: Conditions) -> Drawing:
    size = float(rng.uniform(0.6, 1.5))
    radii = (float(np.round(size * 350, 1)), float(np.round(size * rng.uniform(110, 160), 1)))
    far = np.round([*(900 * rng.choice([-1, 1], 2) * rng.uniform(0.6, 2, 2)), rng.uniform(-300, 300)])
    facing = np.round([*rng.uniform(-5, 5, 2), rng.uniform(-170, 170)], 1)
    hand = np.round([*rng.uniform(-30, 30, 2), rng.uniform(100, 300)], 1)
    read = instrument(sensor, rng, size * 900).with_sigma(under.sigma)
    offset, middle = float(np.round(size * 345, 1)), float(np.round(size * 850, 1))
    return Drawing(radii, offset, middle, (far, facing), (hand, np.zeros(3)), read)


def _physics(read: Array, sides: Array, effects: int, rng: np.random.Generator) -> Array:
    """Return what readings (n, 6) have too much: play, one screw, one joint of the wrist."""
    out, chosen = np.zeros(read.shape), set(rng.permutation(3)[:effects].tolist())
    if 0 in chosen:
        out[:, :3] += 0.5 * rng.uniform(0, 0.06, 3) * sides[:, :3]
    if 1 in chosen:
        k = int(rng.integers(3))
        out[:, k] += rng.uniform(0.01, 0.04) * np.sin(2 * np.pi * read[:, k] / 10.0 + rng.uniform(0, 6))
    if 2 in chosen:
        k = int(rng.integers(3, 6))
        out[:, k] += rng.uniform(5e-5, 3e-4) * np.sin(100.0 * read[:, k] + rng.uniform(0, 6))
    return out


def _mounts(drawn: Drawing, under: Conditions, rng: np.random.Generator) -> tuple[Array, Array]:
    base, tool = (
        frame(at + s * rng.standard_normal(3), np.radians(rpy + a * rng.standard_normal(3)))
        for (at, rpy), (s, a) in (
            (drawn.base, under.stood(KNOWN) if under.known else (100.0, 30.0)),
            (drawn.tool, under.stood(HELD)),
        )
    )
    return base, tool


def _document(drawn: Drawing, under: Conditions, limbs: Array) -> Document:
    wide = under.stood(KNOWN) if under.known else (np.inf, np.inf)
    frames: dict[str, Any] = {}
    for name, inside, at, (length, angle) in (
        ("base", "world", drawn.base, wide),
        ("tool", "flange", drawn.tool, under.stood(HELD)),
    ):
        held = {"xyz": length, "rpy": angle}
        frames[name] = {"in": inside, "xyz": at[0].tolist(), "rpy": at[1].tolist(), "tolerance": held}
    mechanism = {
        "type": "3ups-up-3r",
        "base_radius": drawn.radii[0],
        "platform_radius": drawn.radii[1],
        "platform_offset": drawn.offset,
        "limb_range": [float(np.floor(limbs.min() - 50)), float(np.ceil(limbs.max() + 50))],
        "wrist_range": [-60.0, 60.0],
        "screw_pitch": 10.0,
    }
    return {
        "schema": "truepose/machine/1",
        "name": "hybrid",
        "units": {"length": "mm", "angle": "deg"},
        "mechanism": mechanism,
        "frames": frames,
        "sensor": drawn.instrument.section(),
        "tolerances": {"length": under.tolerance, "angle": under.angle(drawn.middle)},
    }
