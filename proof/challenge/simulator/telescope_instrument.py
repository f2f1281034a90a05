"""What the telescope's cameras add: a lens that bends rays, targets stuck on beside their place, a wrong scale bar."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from .base import Imperfection, Kind, Place
from .joint_physics import places
from .ported import Physics, Stage, Work, shapeless
from .rigid import unit_vector

STANDOFF, FIELD = 1500.0, 200.0
"""mm from the lens to the world's origin; image height (mm in the plane of the targets) at which distortion is told."""


def instrument(targets: tuple[str, ...]) -> tuple[Physics, ...]:
    """Physics of cameras that look at ``targets`` down the world's z axis."""
    return (_lens(), _target(targets), _scale())


def _lens() -> Physics:
    """Radial distortion of third and fifth order about an axis that is not quite the world's: ``size`` mm at ``FIELD``."""

    def act(work: Work, i: Imperfection) -> None:
        seen = work.seen.reshape(len(work), -1, 3)
        centre = np.array([i.shape["x"], i.shape["y"]])
        # what is nearer to the lens is seen further out
        image = (seen[..., :2] - centre) * (STANDOFF / (STANDOFF - seen[..., 2:]))
        radius = np.sum(image**2, axis=-1, keepdims=True) / FIELD**2
        out = i.size * image / FIELD * (radius + i.shape["fifth"] * radius**2)
        work.seen = (seen + np.concatenate([out, np.zeros_like(seen[..., 2:])], axis=-1)).reshape(
            len(work), -1
        )

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        x, y = rng.uniform(-40, 40, 2)
        return {"x": float(x), "y": float(y), "fifth": float(rng.uniform(-0.3, 0.3))}

    return Physics(
        Kind("lens-distortion", (("sensor",),), 0.02, "lens-distortion"), act, shape, Stage.INSTRUMENT
    )


def _target(targets: tuple[str, ...]) -> Physics:
    """A target that sits ``size`` mm beside its place on the hub."""

    def act(work: Work, i: Imperfection) -> None:
        for axis in "xyz":
            work.add(f"{i.place[0]}.{axis}", i.size * i.shape[axis])

    def shape(_place: Place, rng: np.random.Generator) -> Mapping[str, float]:
        return dict(zip("xyz", (float(v) for v in unit_vector(rng)), strict=True))

    return Physics(Kind("target-offset", places(targets), 0.03, "target-offset"), act, shape)


def _scale() -> Physics:
    """A scale bar of the wrong length: everything is seen ``1 + size`` times too large."""

    def act(work: Work, i: Imperfection) -> None:
        work.seen = work.seen * (1 + i.size)

    kind = Kind("sensor-scale", (("sensor",),), 1e-4, "sensor-scale", conceals=True)
    return Physics(kind, act, shapeless, Stage.INSTRUMENT)


__all__ = ["instrument"]
