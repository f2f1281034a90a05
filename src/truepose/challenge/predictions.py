"""What an engine's model does on the held-out rows, read from its files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from truepose.challenge.examinee import IMPROVED, PREDICTION
from truepose.challenge.measures import held_out_error, standard_scores
from truepose.challenge.solutions import Solution

INSIDE = 1.96


@dataclass(frozen=True)
class Predicted:
    """What the engine's model does on the held-out rows: error in sigma (None: no prediction), readings with a 1-sigma,
    sum of their squared standard scores, how many are inside 1.96; coefficients of its effects (None: not known)."""

    error: float | None = None
    n: int = 0
    squares: float = 0.0
    inside: int = 0
    columns: int | None = None


def read_prediction(own: Path, solution: Solution) -> Predicted:
    """What a folder of results predicts for the held-out rows."""
    columns = None
    if (own / IMPROVED).is_file():
        columns = coefficients(yaml.safe_load((own / IMPROVED).read_text(encoding="utf-8")))
    if not (own / PREDICTION).is_file():
        return Predicted(columns=columns)
    table = pd.read_csv(own / PREDICTION)
    z = np.array(standard_scores(table, solution.held_out))
    error = held_out_error(table, solution.held_out)
    return Predicted(error, len(z), float(np.sum(z**2)), int(np.sum(np.abs(z) <= INSIDE)), columns)


def coefficients(machine_file: Mapping[str, Any]) -> int:
    """How many numbers the effects of a machine file have."""
    return sum(len(entry.get("parameters") or {}) for entry in machine_file.get("effects") or ())


__all__ = ["Predicted", "coefficients", "read_prediction"]
