"""Measurement poses to plan on the machines of the tests, and criteria as a plan judges them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.planning.information import PoseInformation
from truepose.identification.leaves.planning.plan import CRITERIA, Landscape, Objective
from truepose.models.machine.machine import Machine

NAMES = ("serial", "pus", "ups", "distance")


def written(folder: Path, text: str) -> Path:
    (folder / "machine.yaml").write_text(text, encoding="utf-8")
    return folder / "machine.yaml"


def poses(information: PoseInformation, n: int, seed: int = 0) -> Array:
    rng = np.random.default_rng(seed)
    return rng.uniform(information.low, information.high, (n, len(information.low)))


def landscape(machine: Machine, criterion: str) -> Landscape:
    """The criterion as ``plan`` judges it, on the directions that 60 random poses see."""
    information = PoseInformation(machine)
    k = len(information.names)
    if CRITERIA[criterion].with_prior:
        return Landscape(information, Objective(CRITERIA[criterion], np.eye(k), np.diag(information.weight)))
    rows = information.rows(information.at(poses(information, 60, 9)).signature).reshape(-1, k)
    w, v = np.linalg.eigh(rows.T @ rows / 60)
    basis = v[:, w > 1.0]
    return Landscape(information, Objective(CRITERIA[criterion], basis, np.zeros((basis.shape[1],) * 2)))
