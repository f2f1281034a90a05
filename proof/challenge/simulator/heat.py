"""Bodies that warm up behind the air, thermometers on them, and what expands.

A body is one lump (``lump``) or skin and core (``skin_and_core``); each is integrated exactly for a drive that is
a straight line between instants. Before the first instant everything is as warm as the drive. degC, s, 1/K.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]
REFERENCE = 20.0
"""degC at which drawings hold."""


def lump(time: Array, drive: Array, lag: float, start: float | None = None) -> Array:
    """(n,) temperature of a body that follows ``drive`` (n,) with time constant ``lag`` (s); 0: at once.

    time (n,) never falls. start: temperature at the first instant, that of the drive unless told.
    """
    if lag <= 0:
        return np.array(drive, dtype=float)
    out = np.empty(len(time))
    out[:1] = drive[:1] if start is None else start
    for k in range(1, len(time)):
        dt = time[k] - time[k - 1]
        decay = np.exp(-dt / lag)
        slope = (drive[k] - drive[k - 1]) / dt if dt > 0 else 0.0
        out[k] = (
            drive[k] - slope * lag + (out[k - 1] - drive[k - 1] + slope * lag) * decay
            if dt > 0
            else out[k - 1]
        )
    return out


def skin_and_core(
    time: Array, drive: Array, skin_lag: float, core_lag: float, share: float = 0.3
) -> tuple[Array, Array]:
    """(n,) temperatures of a skin that meets the air and of a core behind it.

    skin_lag, core_lag: s of skin to air and of core to skin; share: heat capacity of the skin over the core's.
    """
    system = np.array(
        [[-1 / skin_lag - 1 / (share * core_lag), 1 / (share * core_lag)], [1 / core_lag, -1 / core_lag]]
    )
    # state and drive and its slope together: one matrix exponential integrates a linear ramp exactly
    whole = np.zeros((4, 4))
    whole[:2, :2] = system
    whole[0, 2] = 1 / skin_lag
    whole[2, 3] = 1.0
    out = np.empty((len(time), 2))
    out[:1] = drive[0] if len(time) else 0.0
    for k in range(1, len(time)):
        dt = time[k] - time[k - 1]
        slope = (drive[k] - drive[k - 1]) / dt if dt > 0 else 0.0
        out[k] = (expm(whole * dt) @ np.array([*out[k - 1], drive[k - 1], slope]))[:2]
    return out[:, 0], out[:, 1]


def motor_heat(time: Array, effort: Array, lag: float) -> Array:
    """(n,) rise of a motor, in units of what steady effort 1 would give; effort (n,) >= 0 holds since the row before."""
    out = np.zeros(len(time))
    for k in range(1, len(time)):
        decay = np.exp(-(time[k] - time[k - 1]) / lag)
        out[k] = effort[k] + (out[k - 1] - effort[k]) * decay
    return out


def strain(temperature: ArrayLike, alpha: float) -> Array:
    """Linear expansion since ``REFERENCE``, alpha (T - 20 degC), at temperatures of any shape."""
    return alpha * (np.asarray(temperature, dtype=float) - REFERENCE)
