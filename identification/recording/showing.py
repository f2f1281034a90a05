"""A recording as it is shown, and as a table: rows, sessions, columns in the units of the machine file, notes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from truepose.arrays import Array
from truepose.identification.recording.recording import Recording
from truepose.models.units import convert
from truepose.shown.document import Document, Items, Table
from truepose.shown.result import document, frame
from truepose.wording import shortened

MOST = 12


@document.register
def _document(recording: Recording) -> Document:
    """How many rows of which files, what was recorded, and over which ranges."""
    columns = _numbers(recording)
    held_out = int(recording.validation.sum())
    validation = f", {held_out} of them for validation" if held_out else ""
    sessions = recording.n_sessions
    poses = len(np.unique(recording.replicates()))
    repeated = f", {poses} different poses" if poses < len(recording) else ""
    files = shortened([Path(name).name for name in recording.files], 3)
    read = [*recording.observations, *recording.labels]
    logged = recording.logged
    facts = [
        f"joints: {shortened(list(recording.joints), MOST)}",
        f"readings: {shortened(read, MOST) or 'none'}",
        f"logged beside: {shortened(list(logged), MOST) or 'nothing'}",
    ]
    rows = [_range_row(name, values, unit) for name, (values, unit) in columns.items()]
    return Document(
        "Recording",
        f"Recording of {len(recording)} rows{validation}, {sessions} session{'s' if sessions != 1 else ''}"
        f"{repeated}; from {files}",
        summary=[Items(facts), Table(["column", "least", "greatest", "unit"], rows)],
        notes=recording.notes,
        more="to_frame() has every row",
    )


@frame.register
def _frame(recording: Recording) -> pd.DataFrame:
    """The rows with the columns of a recording file (see ``Recording.to_frame``)."""
    data: dict[str, Any] = {}
    if recording.pose is not None:
        data["pose"] = recording.pose
    if recording.from_row is not None and recording.whole.pose is not None:
        data["from"] = recording.whole.pose[recording.from_row]
    if recording.session_recorded.any() or recording.n_sessions > 1:
        data["session"] = recording.session
    if recording.time is not None:
        data["time"] = recording.time
    if recording.validation.any():
        data["role"] = np.where(recording.validation, "validation", "calibration")
    numbers = {name: values for name, (values, _) in _numbers(recording).items()}
    labels = {name: list(texts) for name, texts in recording.labels.items()}
    joints = {name: numbers.pop(name) for name in recording.joints}
    return pd.DataFrame({**data, **joints, **labels, **numbers}, index=_index(recording))


def _index(recording: Recording) -> pd.Index[Any]:
    rows = recording.source_row
    if len(recording.files) == 1:
        return pd.Index(rows, name="row")
    names = [recording.files[k] for k in recording.source_file]
    return pd.MultiIndex.from_arrays([names, rows], names=["file", "row"])


def _numbers(recording: Recording) -> dict[str, tuple[Array, str]]:
    """Joints, readings and drivers with their units, as a file has them."""
    internal: Mapping[str, Array] = {
        **dict(zip(recording.joints, recording.q.T, strict=True)),
        **recording.observations,
        **recording.drivers,
    }
    out = {}
    for name, values in internal.items():
        inside, unit = recording.written.get(name, ("", ""))
        out[name] = (convert(values, inside, unit) if unit else values, unit)
    return out


def _range_row(name: str, values: Array, unit: str) -> tuple[str, ...]:
    finite = values[np.isfinite(values)]
    ends = (f"{finite.min():.6g}", f"{finite.max():.6g}") if finite.size else ("", "")
    return name, *ends, "" if unit == "1" else unit
