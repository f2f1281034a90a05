"""Frames of a drawing and their error motions, by the names of values; mm and rad."""

from __future__ import annotations

from .base import Array
from .motions import placed
from .mount_physics import TWIST
from .ported import Work


def fixed(work: Work, name: str) -> Array:
    """(n, 4, 4) frame ``name`` behind its predecessor: Trans(xyz) Rz(yaw) Ry(pitch) Rx(roll)."""
    return placed(work.stacked(tuple(f"{name}.{axis}" for axis in TWIST)))


def error_motion(work: Work, name: str) -> Array:
    """(n, 4, 4) small motion that physics adds behind a frame or joint."""
    return placed(work.stacked(tuple(f"{name}.motion.{axis}" for axis in TWIST)))


__all__ = ["error_motion", "fixed"]
