"""A force measured at the tool loads the arm: which joints yield to it is named, with their compliance.

Readings come from an arm in plain numpy (``support.pushed_arm``) that stands where its joints hold force and weight.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import truepose
from support.pushed_arm import COLUMNS, RANGES, G, held, placed, text
from support.simulated import machine_from
from truepose.arrays import Array
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.signatures.candidates import catalogue

SIGMA = 0.02
SOFT = np.array([0.0, 2.5e-6, 0.0, 0.0, 1.2e-5, 0.0])  # rad/(N m)


def recording(seed: int, gravity: Array | None, *, n: int = 60) -> pd.DataFrame:
    """Rows of an arm whose geometry is off by its tolerances, pushed at by up to 150 N along each axis."""
    rng = np.random.default_rng(seed)
    low, high = np.radians(RANGES).T
    q = rng.uniform(low, high, (n, 6))
    wrench = rng.uniform(-1, 1, (n, 6)) * [150, 150, 150, 15, 15, 15]
    off = {f"q{k}.{p}": 0.1 * rng.standard_normal() for k in range(1, 7) for p in "dr"}
    off |= {
        f"q{k}.{p}": np.radians(0.02) * rng.standard_normal() for k in range(1, 7) for p in ("alpha", "theta")
    }
    stands = [held(row, SOFT, w, gravity) for row, w in zip(q, wrench, strict=True)]
    read = np.array([placed(row, off).tool.real for row in stands]) + SIGMA * rng.standard_normal((n, 3))
    joints = {f"q{k + 1}": np.degrees(q[:, k]) for k in range(6)}
    forces = dict(zip(COLUMNS, wrench.T, strict=True))
    return pd.DataFrame(joints | dict(zip("xyz", read.T, strict=True)) | forces)


def diagnosed(folder: Path, seed: int, gravity: Array | None) -> Diagnosis:
    stated = "" if gravity is None else str(gravity.tolist())
    machine = machine_from(folder, text(gravity=stated, tolerance=0.1), "arm")
    return truepose.diagnose(machine, truepose.load_recording(machine, recording(seed, gravity)))


@pytest.mark.parametrize(
    ("seed", "gravity"),
    [
        pytest.param(1, None, id="no weights"),
        pytest.param(2, np.array([0.0, 0.0, -G]), id="upright"),
        pytest.param(3, np.array([G, 0.0, 0.0]), id="on a wall"),
    ],
)
def test_joints_that_yield_to_a_measured_force_are_named(
    tmp_path: Path, seed: int, gravity: Array | None
) -> None:
    found = diagnosed(tmp_path, seed, gravity)
    yielding = {f"q{k + 1}": c for k, c in enumerate(SOFT) if c}
    named = {f.place[0]: f for f in found.findings}
    assert named.keys() == yielding.keys()
    for joint, c in yielding.items():
        finding = named[joint]
        assert (finding.effect, finding.levels.kind) == ("joint-compliance", "load")
        assert finding.probability > 0.8
        value = finding.parameters["c"]
        assert value.value == pytest.approx(c, abs=3 * value.std) and value.std < 0.1 * c
        assert "the measured force `process`" in finding.explanation


def test_columns_of_a_force_drive_nothing_by_themselves(tmp_path: Path) -> None:
    """They are one load; only what ``drivers`` names is tried as a curve too."""
    plain, declared = (text(tolerance=0.1), text(tolerance=0.1) + "drivers: [ft.x]\n")
    reading = []
    for written in (plain, declared):
        machine = machine_from(tmp_path, written, "arm")
        rows = truepose.load_recording(machine, recording(1, None))
        candidates = catalogue(machine, rows).candidates
        reading.append({name for placed in candidates for name in placed.drivers if name in COLUMNS})
    assert reading == [set(), {"ft.x"}]
