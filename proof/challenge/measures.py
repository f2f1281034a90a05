"""Two errors that a model is judged by: held-out readings in sigma, constants in tolerances."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from challenge.solutions import Geometry, HeldOut
from truepose.models import lie

Array = NDArray[np.float64]
ROUNDED = 1e-3
"""Of a sigma: what files are rounded by."""


def held_out_error(predicted: pd.DataFrame, held: HeldOut) -> float | None:
    """Root mean square of predicted less true readings in sigma; None where a prediction is missing.

    ``predicted`` has the file's columns (mm, deg). Rotation vectors are compared as rotations.
    """
    off = _off(predicted, held)
    if off is None:
        return None
    error = float(np.sqrt(np.mean((off / np.array(held.sigma)) ** 2)))
    return error if np.isfinite(error) else None


def standard_scores(predicted: pd.DataFrame, held: HeldOut) -> tuple[float, ...]:
    """(predicted - true) / ``<column>.std`` of every held-out reading; none without such columns.

    Files are rounded: a 1-sigma below a thousandth of the sensor's is taken as that.
    """
    off, names = _off(predicted, held), [f"{name}.std" for name in held.columns]
    if off is None or any(name not in predicted for name in names):
        return ()
    std = _inside(predicted[names].to_numpy(dtype=float), held)
    scores = off / np.hypot(std, ROUNDED * np.array(held.sigma))
    return tuple(scores[np.isfinite(scores)].tolist())


def _off(predicted: pd.DataFrame, held: HeldOut) -> Array | None:
    """(rows, columns) predicted less true readings, mm and rad; None where there is no such table."""
    if any(name not in predicted for name in held.columns) or len(predicted) != len(held.truth):
        return None
    said = _inside(predicted[list(held.columns)].to_numpy(dtype=float), held)
    return difference(said, np.array(held.truth), held.columns)


def _inside(values: Array, held: HeldOut) -> Array:
    """Degrees as radians."""
    angle = np.array([unit == "rad" for unit in held.units])
    return np.where(angle, np.radians(values), values)


def difference(said: Array, truth: Array, columns: tuple[str, ...]) -> Array:
    """(n, k) readings less true ones, mm and rad; rotation vectors rx ry rz are compared as rotations, Log(Rtrue' R)."""
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


__all__ = ["difference", "held_out_error", "parameter_bias", "standard_scores"]
