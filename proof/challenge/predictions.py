"""What an engine's model does on the held-out rows, read from its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from challenge.examinee import IMPROVED, PREDICTION
from challenge.measures import held_out_error, standard_scores
from challenge.solutions import Solution
from challenge.tool_pose import read_pose_ratio
from truepose.errors import TrueposeError
from truepose.models.effects.base import Coefficient
from truepose.models.load import load_machine

INSIDE = 1.96
ROUNDED = 1e-9
"""Of a coefficient's scale: what a file may be beyond a bound."""


@dataclass(frozen=True)
class Predicted:
    """What the engine's model does on the held-out rows: error in sigma (None: no prediction), readings with a 1-sigma,
    sum of their squared standard scores, how many are inside 1.96; coefficients of its effects, and whether one of them is
    beyond its bounds (None: not known); error of the tool's points over that of plain calibration."""

    error: float | None = None
    n: int = 0
    squares: float = 0.0
    inside: int = 0
    columns: int | None = None
    unphysical: bool | None = None
    pose_ratio: float | None = None


def read_prediction(own: Path, solution: Solution) -> Predicted:
    """What a folder of results predicts for the held-out rows."""
    model = Predicted(pose_ratio=read_pose_ratio(own, solution))
    if (own / IMPROVED).is_file():
        columns = coefficients(yaml.safe_load((own / IMPROVED).read_text(encoding="utf-8")))
        model = replace(model, columns=columns, unphysical=beyond_bounds(own / IMPROVED))
    if not (own / PREDICTION).is_file():
        return model
    table = pd.read_csv(own / PREDICTION)
    z = np.array(standard_scores(table, solution.held_out))
    error = held_out_error(table, solution.held_out)
    inside = int(np.sum(np.abs(z) <= INSIDE))
    return replace(model, error=error, n=len(z), squares=float(np.sum(z**2)), inside=inside)


def coefficients(machine_file: Mapping[str, Any]) -> int:
    """How many numbers the effects of a machine file have."""
    return sum(len(entry.get("parameters") or {}) for entry in machine_file.get("effects") or ())


def beyond_bounds(machine_file: Path) -> bool | None:
    """Whether a coefficient of an effect lies beyond its physical bounds; None where the file is no machine."""
    try:
        placed = load_machine(machine_file).effects
    except TrueposeError:
        return None
    return any(_beyond(c, v) for one in placed for c, v in zip(one.coefficients, one.amplitudes, strict=True))


def _beyond(coefficient: Coefficient, value: float) -> bool:
    return max(coefficient.lower - value, value - coefficient.upper) > ROUNDED * coefficient.scale


__all__ = ["Predicted", "beyond_bounds", "coefficients", "read_prediction"]
