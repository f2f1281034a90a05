"""Measurement poses to plan on the machines of the tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.planning.information import PoseInformation

Array = NDArray[np.float64]
NAMES = ("serial", "pus", "ups", "distance")


def written(folder: Path, text: str) -> Path:
    (folder / "machine.yaml").write_text(text, encoding="utf-8")
    return folder / "machine.yaml"


def poses(information: PoseInformation, n: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(information.low, information.high, (n, len(information.low)))
