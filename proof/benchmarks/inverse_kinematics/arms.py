"""Calibrated arms: UR10 and PUMA 560 with errors on every constant, so that no decoupled closed form holds; and three without.

The drawings are published Denavit-Hartenberg values: the UR10's of its maker, the PUMA's of Armstrong's and Corke's
survey in Craig's frames. The last axes of CRX-10iA and Gen3 lite do not meet (offset wrists); the third arm is drawn at
random. A specimen adds to every constant a uniform error of at most 1 mm or 0.5 deg.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.models.file.machine_file import write_machine

Array = NDArray[np.float64]
LENGTH, ANGLE = 1.0, 0.5
"""Largest error of a constant: mm, deg."""
SEED = 20261122
FIELDS = ("beta", "alpha", "d", "theta", "r")
_LENGTHS = ("d", "r", "x", "y", "z")
_TOOL = (
    ("x", "xyz", 0),
    ("y", "xyz", 1),
    ("z", "xyz", 2),
    ("rx", "rpy", 0),
    ("ry", "rpy", 1),
    ("rz", "rpy", 2),
)


@dataclass(frozen=True)
class Drawing:
    """A serial arm as drawn: joints (n, 5) of beta, alpha, d, theta, r, ranges (n, 2), tool (6,) xyz rpy or None.

    mm and deg; ``title`` is what tables call it.
    """

    name: str
    title: str
    joints: Array
    ranges: Array
    tool: Array | None = None


UR10 = Drawing(
    "ur10",
    "UR10",
    np.array(
        [
            [0, 0, 0, 0, 127.3],
            [0, 90, 0, 0, 0],
            [0, 0, -612.0, 0, 0],
            [0, 0, -572.3, 0, 163.941],
            [0, 90, 0, 0, 115.7],
            [0, -90, 0, 0, 92.2],
        ],
        dtype=float,
    ),
    np.array(6 * [[-180.0, 180.0]]),
)
PUMA = Drawing(
    "puma",
    "PUMA 560",
    np.array(
        [
            [0, 0, 0, 0, 0],
            [0, -90, 0, 0, 243.5],
            [0, 0, 431.8, 0, -93.4],
            [0, 90, -20.3, 0, 433.1],
            [0, -90, 0, 0, 0],
            [0, 90, 0, 0, 0],
        ],
        dtype=float,
    ),
    np.array([[-160, 160], [-110, 110], [-135, 135], [-266, 266], [-100, 100], [-266, 266]], dtype=float),
    np.array([0.0, 0.0, 100.0, 0.0, 0.0, 0.0]),
)
DRAWINGS = {drawing.name: drawing for drawing in (UR10, PUMA)}


def _plain(name: str, title: str, alpha: Sequence[float], d: Sequence[float], r: Sequence[float]) -> Drawing:
    """An arm by alpha (deg), d and r (mm) whose joints may turn once around."""
    zeros = np.zeros(6)
    table = np.column_stack([zeros, alpha, d, zeros, r]).astype(float)
    return Drawing(name, title, table, np.array(6 * [[-180.0, 180.0]]))


CRX = _plain(
    "crx10", "CRX-10iA", (0, -90, 180, -90, 90, -90), (0, 0, 540, 0, 0, 0), (0, 0, 0, -540, 150, -160)
)
LITE = _plain(
    "lite", "Gen3 lite", (0, 90, 180, 90, 90, 90), (0, 0, 280, 0, 0, 0), (243.3, 30, 20, 245, 57, 235)
)
RANDOM = _plain(
    "random6r",
    "random 6R",
    (25, -118, 64, 141, -47, 83),
    (112, 287, 341, 58, 203, 96),
    (310, 73, 264, 187, 131, 322),
)
GENERAL = {drawing.name: drawing for drawing in (CRX, LITE, RANDOM)}
"""Arms that are similar to none with a closed form."""


@dataclass(frozen=True)
class Arm:
    """A calibrated arm in radians: joints (n, 5) of beta, alpha, d, theta, r; tool (4, 4); ranges (n, 2)."""

    drawing: Drawing
    joints: Array
    tool: Array
    ranges: Array

    @property
    def name(self) -> str:
        return self.drawing.name

    @property
    def title(self) -> str:
        return self.drawing.title


def specimen(drawing: Drawing, seed: int = SEED) -> dict[str, Any]:
    """The machine file of one calibrated arm, with the drawing's values under ``nominal:`` (mm, rad)."""
    rng = np.random.default_rng([seed, len(drawing.name)])
    nominal: dict[str, float] = {}
    joints = []
    for k, (row, span) in enumerate(zip(drawing.joints, drawing.ranges, strict=True), start=1):
        values = {f: _built(rng, nominal, f"q{k}.{f}", f, float(v)) for f, v in zip(FIELDS, row, strict=True)}
        joints.append({"name": f"q{k}", "kind": "revolute", **values, "range": span.tolist()})
    document = {
        "schema": "truepose/machine/1",
        "name": drawing.name,
        "units": {"length": "mm", "angle": "deg"},
        "mechanism": {"type": "serial", "joints": joints},
    }
    if drawing.tool is not None:
        tool: dict[str, Any] = {"in": "flange", "xyz": [0.0] * 3, "rpy": [0.0] * 3}
        for (axis, part, k), value in zip(_TOOL, drawing.tool, strict=True):
            tool[part][k] = _built(rng, nominal, f"tool.{axis}", axis, float(value))
        document["frames"] = {"tool": {**tool, "tolerance": {"xyz": LENGTH, "rpy": ANGLE}}}
    return {**document, "tolerances": {"length": LENGTH, "angle": ANGLE}, "nominal": nominal}


def _built(rng: np.random.Generator, nominal: dict[str, float], name: str, field: str, drawn: float) -> float:
    """The value as built, in the file's units; the drawn one is noted, in mm or rad."""
    length = field in _LENGTHS
    nominal[name] = drawn if length else math.radians(drawn)
    return round(drawn + float(rng.uniform(-1, 1)) * (LENGTH if length else ANGLE), 5)


def write(drawing: Drawing, folder: Path) -> Path:
    """Write ``<name>.yaml`` of the specimen into ``folder``; its path."""
    path = folder / f"{drawing.name}.yaml"
    write_machine(path, specimen(drawing))
    return path


def arm_of(drawing: Drawing, document: Mapping[str, Any]) -> Arm:
    """What a document of ``specimen`` says, read without truepose."""
    rows = np.array([[joint[f] for f in FIELDS] for joint in document["mechanism"]["joints"]])
    rows[:, [0, 1, 3]] = np.radians(rows[:, [0, 1, 3]])
    frame = document.get("frames", {}).get("tool", {"xyz": [0.0] * 3, "rpy": [0.0] * 3})
    roll, pitch, yaw = np.radians(frame["rpy"])
    tool = np.eye(4)
    tool[:3, :3] = _turn(2, yaw) @ _turn(1, pitch) @ _turn(0, roll)
    tool[:3, 3] = frame["xyz"]
    return Arm(drawing, rows, tool, np.radians(drawing.ranges))


def _turn(axis: int, angle: float) -> Array:
    out, (a, b) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    out[a, a] = out[b, b] = math.cos(angle)
    out[b, a], out[a, b] = math.sin(angle), -math.sin(angle)
    return out
