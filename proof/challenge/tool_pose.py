"""What a model is worth to the tool: how far its points are from where they truly are, in poses it has not seen.

Errors of the instrument do not move the tool: they are left out of the truth and of both models. Where the instrument
stands does not count either: predicted points are moved onto the true ones as one rigid body.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from challenge.examinee import PLAIN, TOOL
from challenge.perfect import of_sensor
from challenge.solutions import Solution
from truepose.identification.fit.align import rigid_motion
from truepose.models.effects.common import OF_ROWS

Array = NDArray[np.float64]
AXES = ("x", "y", "z")
NOTHING = 0.01
"""Of a sigma: what a smaller error leaves to improve."""


def point_columns(columns: Sequence[str]) -> list[str]:
    """Sensor columns that are points: x y z (whatever else the sensor reads), or P1.x P1.y P1.z ..."""
    starts = [name.removesuffix("x") for name in columns if name == "x" or name.endswith(".x")]
    triples = [[f"{start}{axis}" for axis in AXES] for start in starts]
    return [name for triple in triples if set(triple) <= set(columns) for name in triple]


def pose_error(predicted: pd.DataFrame, columns: Sequence[str], truth: Array) -> float | None:
    """Root mean square distance, mm, of predicted points from true ones, after a rigid refit; ``truth`` (rows, columns) are
    readings of all ``columns``, mm and rad.

    None where there is no such table, or a prediction is missing.
    """
    points = point_columns(columns)
    if any(name not in predicted for name in points) or len(predicted) != len(truth) or not points:
        return None
    said = predicted[points].to_numpy(dtype=float).reshape(-1, 3)
    if not np.isfinite(said).all():
        return None
    true = truth[:, [list(columns).index(name) for name in points]].reshape(-1, 3)
    rotation, shift = rigid_motion(said, true)
    off = said @ rotation.T + shift - true
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def true_points(solution: Solution) -> Array | None:
    """(rows, columns) what a perfect instrument would read on the held-out rows, mm; None where these are no points.

    Keys that do not hold it tell it all the same where nothing is wrong with the instrument.
    """
    if solution.tool is not None:
        return np.array(solution.tool)
    held, truths = solution.held_out, solution.truths
    blamed = any(truth.effect in OF_ROWS or of_sensor(truth.place) for truth in truths)
    return None if blamed or not point_columns(held.columns) else np.array(held.truth)


def read_pose_ratio(own: Path, solution: Solution) -> float | None:
    """The improved model's error over plain calibration's, of a folder of results; None where either is unknown."""
    truth = true_points(solution)
    if truth is None or not ((own / TOOL).is_file() and (own / PLAIN).is_file()):
        return None
    columns = solution.held_out.columns
    improved, plain = (pose_error(pd.read_csv(own / name), columns, truth) for name in (TOOL, PLAIN))
    if improved is None or plain is None:
        return None
    own_sigma = [
        s for s, unit in zip(solution.held_out.sigma, solution.held_out.units, strict=True) if unit == "mm"
    ]
    return 1.0 if plain < NOTHING * float(np.mean(own_sigma)) else improved / plain


__all__ = ["point_columns", "pose_error", "read_pose_ratio", "true_points"]
