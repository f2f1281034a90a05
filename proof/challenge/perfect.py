"""What a perfect instrument would read: a model's file without what it says of its own sensor. Knows nothing of keys."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from truepose.identification.prediction.predict import predict
from truepose.identification.recording.load import load_recording
from truepose.models.file.machine_file import write_machine
from truepose.models.load import load_machine


def without_sensor(document: Mapping[str, Any]) -> dict[str, Any]:
    """A machine file without effects of the sensor, and without the covariance that names their coefficients."""
    left = [entry for entry in document.get("effects") or () if not of_sensor(entry["place"])]
    kept = {name: part for name, part in document.items() if name not in ("effects", "covariance")}
    return {**kept, "effects": left} if left else kept


def of_sensor(place: Sequence[str]) -> bool:
    """Whether this is the place of a sensor."""
    return any(name.startswith("sensor") for name in place)


def seen_perfectly(machine: Path, rows: Path) -> pd.DataFrame:
    """What a machine file predicts for the rows of a table if the instrument were perfect; without 1-sigma."""
    document = yaml.safe_load(machine.read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        stripped = Path(folder) / machine.name
        write_machine(stripped, without_sensor(document))
        model = load_machine(stripped)
        table = predict(model, load_recording(model, [rows], need_observations=False))
    return table[[name for name in table.columns if not name.endswith(".std")]]


__all__ = ["of_sensor", "seen_perfectly", "without_sensor"]
