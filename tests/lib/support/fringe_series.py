"""Light of a mirror whose way is known, and rows that its moves join, for tests of fringe counting."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from truepose.identification.leaves.fringes.count import Series, normalised
from truepose.identification.leaves.fringes.levels import Levels, Noise
from truepose.identification.recording.recording import Recording
from truepose.models.sensors.irradiance import fringe

Array = NDArray[np.float64]
G, RATE, EVERY = 0.2, 7.0, 200.0
"""Coupling of the mirrors; phase rate (rad per time) and samples a unit of time of a steady mirror."""
LEVELS = Levels(np.zeros(1), np.array([2.0]), np.array([6.0]))


def series(phase: Array, noise: float = 0.0, seed: int = 0, per_time: float = EVERY) -> Series:
    """Light of a path of ``phase`` (n,), of levels 2 and 6, so many samples a unit of time."""
    t = np.arange(len(phase)) / per_time
    shake = 4.0 * noise * np.random.default_rng(seed).standard_normal(len(phase))
    return normalised(t, 2.0 + 4.0 * fringe(np.cos(phase), G) + shake, LEVELS, Noise(4.0 * noise, 0.0), G)


def steady(fringes: float = 6.0, start: float = 0.3, rate: float = RATE) -> Array:
    n = round(fringes * 2.0 * np.pi / rate * EVERY)
    return np.asarray(start + rate * np.arange(n) / EVERY)


def joined_rows(
    poses: Sequence[int], origins: Sequence[int], q: ArrayLike, change: Array, time: ArrayLike | None = None
) -> Recording:
    """n rows of these poses, each measured from the row ``origins`` (n,), with changes (n,), mm, and readings q (n,)."""
    n = len(poses)
    whole = np.zeros(n, dtype=np.int64)
    return Recording(
        joints=("q1",),
        q=np.array(q, dtype=float)[:, None],
        observations={"dL": change},
        labels={},
        drivers={},
        time=None if time is None else np.array(time),
        files=("rows.csv",),
        source_file=whole,
        source_row=np.arange(1, n + 1),
        session=whole + 1,
        session_recorded=whole == 0,
        validation=whole == 1,
        pose=np.array(poses),
        from_row=np.array(origins),
    )
