"""A drift as it shows itself, as a table, and as files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from truepose.files import atomic_directory, atomic_write_text
from truepose.identification.leaves.drift import words
from truepose.identification.leaves.drift.analysis import Drift
from truepose.identification.leaves.drift.page import drift_document
from truepose.identification.leaves.drift.sizes import Movement
from truepose.identification.load import Caution
from truepose.identification.report.files import REPORT
from truepose.identification.report.json_text import json_text
from truepose.shown.html import page
from truepose.shown.result import files, frame

MOVEMENTS = [
    "parameter", "status", "probability", "change", "std", "unit", "rate", "rate_std", "steady", "hidden",
    "extrinsic",
]  # fmt: skip


@frame.register
def _(found: Drift) -> pd.DataFrame:
    return pd.DataFrame([_movement(one) for one in found.movements], columns=MOVEMENTS)


def _movement(one: Movement) -> tuple[object, ...]:
    change, std = (one.change[-1], one.std[-1]) if one.change else (np.nan, np.nan)
    rate, rate_std = (np.nan if value is None else value for value in (one.rate, one.rate_std))
    moved = (one.name, one.status, one.probability, change, std, one.unit)
    return (*moved, rate, rate_std, one.steady, one.hidden, one.extrinsic)


@files.register
def _(result: Drift, output: Path) -> list[str]:
    return write_drift(result, output)


def write_drift(result: Drift, output: Path, caution: Caution | None = None) -> list[str]:
    """``drift.json`` and ``report.html``; their names. A ``caution`` stands above all."""
    content = {**words.drift_json(result), **(caution.document if caution else {})}
    told = replace(drift_document(result), cautions=caution.sentences if caution else ())
    with atomic_directory(output) as partial:
        atomic_write_text(partial / "drift.json", json_text(content))
        atomic_write_text(partial / REPORT, page(told))
        return sorted(file.name for file in partial.iterdir())
