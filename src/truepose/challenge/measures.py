"""Two errors that a model is judged by: held-out readings in sigma, constants in tolerances."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from truepose.challenge.solutions import Geometry, HeldOut
from truepose.models import lie

Array = NDArray[np.float64]


def held_out_error(predicted: pd.DataFrame, held: HeldOut) -> float | None:
    """Root mean square of predicted less true readings in sigma; None where a prediction is missing.

    ``predicted`` has the file's columns (mm, deg). Rotation vectors are compared as rotations.
    """
    if any(name not in predicted for name in held.columns) or len(predicted) != len(held.truth):
        return None
    angle = np.array([unit == "rad" for unit in held.units])
    said = predicted[list(held.columns)].to_numpy(dtype=float)
    said = np.where(angle, np.radians(said), said)
    off = _difference(said, np.array(held.truth), held.columns)
    error = float(np.sqrt(np.mean((off / np.array(held.sigma)) ** 2)))
    return error if np.isfinite(error) else None


def _difference(said: Array, truth: Array, columns: tuple[str, ...]) -> Array:
    off = said - truth
    if {"rx", "ry", "rz"} <= set(columns):
        at = [columns.index(name) for name in ("rx", "ry", "rz")]
        turn = lie.exp_so3(truth[:, at]).transpose(0, 2, 1) @ lie.exp_so3(np.nan_to_num(said[:, at]))
        off[:, at] = np.where(np.isfinite(said[:, at]), lie.log_so3(turn), np.nan)
    return off


def parameter_bias(values: Mapping[str, float], geometry: Geometry) -> float | None:
    """Root mean square error of the identifiable combinations, in tolerances; None without any."""
    if not geometry.combinations or any(name not in values for name in geometry.names):
        return None
    estimate = np.array([values[name] for name in geometry.names])
    off = (estimate - np.array(geometry.truth)) / np.array(geometry.tolerance)
    return float(np.sqrt(np.mean((np.array(geometry.combinations) @ off) ** 2)))


__all__ = ["held_out_error", "parameter_bias"]
