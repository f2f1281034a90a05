"""Recordings read from text, and what is said of one refused; recordings made of arrays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.errors import InputError
from truepose.identification.recording.joint_readings import JointColumn
from truepose.identification.recording.load import tables
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.models.units import UnitSystem

JOINTS = (JointColumn("s", "mm", (0.0, 100.0)), JointColumn("r", "rad", (-math.pi, math.pi)))
SENSOR = {"x": "mm", "rx": "rad"}
BASIC = "s,r,x,rx\n10,90,1,180\n20,-90,2,0\n"


def read(
    tmp_path: Path,
    *texts: str,
    joints: Sequence[JointColumn] = JOINTS,
    sensor: dict[str, str] = SENSOR,
    units: UnitSystem | None = None,
    **options: Any,
) -> Recording:
    paths = [tmp_path / f"{chr(97 + k)}.csv" for k in range(len(texts))]
    for path, text in zip(paths, texts, strict=True):
        path.write_text(text, encoding="utf-8")
    return read_recording(tables(paths), joints, sensor, units or UnitSystem(), **options)


def refusal(tmp_path: Path, *texts: str, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        read(tmp_path, *texts, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def rows_of(q: NDArray[np.float64], **more: Any) -> Recording:
    """A recording of joint readings (n, nq) and no others, a second apart, all of one file and session; ``more``: fields."""
    n = len(q)
    plain: dict[str, Any] = {
        "joints": tuple(f"q{k + 1}" for k in range(q.shape[1])),
        "observations": {},
        "labels": {},
        "drivers": {},
        "files": ("a.csv",),
        "source_file": np.zeros(n, dtype=np.int64),
        "source_row": np.arange(1, n + 1),
        "session": np.ones(n, dtype=np.int64),
        "session_recorded": np.ones(n, dtype=bool),
        "validation": np.zeros(n, dtype=bool),
        "time": np.arange(n, dtype=float),
    }
    return Recording(q=q, **{**plain, **more})
