"""Recordings read from text: two joints, two readings, and what is said of one refused."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from truepose.errors import InputError
from truepose.identification.recording.file import JointColumn
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
    return read_recording(paths, joints, sensor, units or UnitSystem(), **options)


def refusal(tmp_path: Path, *texts: str, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        read(tmp_path, *texts, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)
