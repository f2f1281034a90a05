"""What a user starts from: the data sheet's table, the tracker's point list, the controller's log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from .arm import NAMES, RANGES, SHEET, Array, path, seen, sides, specimen

ROWS, UNSEEN = 90, 40


@dataclass(frozen=True)
class Given:
    """Files, and the truth at poses that nobody measured (unseen: (n, 3) mm, without noise)."""

    sheet: Path
    points: Path
    log: Path
    later: Path
    unseen: Array


def write(folder: Path, seed: int) -> Given:
    """All files of one arm, drawn from the seed."""
    rng = np.random.default_rng(seed)
    arm = specimen(rng)
    q = path(rng, ROWS + UNSEEN)
    readings = seen(arm, q[:ROWS], rng)
    later = path(rng, UNSEEN)
    truth = seen(arm, later, rng, noise=False)
    sheet_file, points, log_file, joints = (
        folder / name for name in ("kr14.csv", "points.txt", "joints.csv", "later.csv")
    )
    given = Given(sheet_file, points, log_file, joints, truth)
    folder.mkdir(parents=True, exist_ok=True)
    sheet = pd.DataFrame(SHEET, columns=["a", "alpha", "d", "theta"])
    sheet.insert(0, "name", NAMES)
    sheet["min"], sheet["max"] = RANGES.T
    sheet.to_csv(given.sheet, index=False)
    given.points.write_text(spatial_analyzer(readings), encoding="utf-8")
    log = pd.DataFrame(np.degrees(q[:ROWS]), columns=list(NAMES))
    log.insert(0, "point", [_name(k) for k in range(ROWS)])
    log[[f"approach.{name}" for name in NAMES]] = sides(q[:ROWS]).astype(int)
    log.to_csv(given.log, index=False, float_format="%.6f")
    unseen = pd.DataFrame(np.degrees(later), columns=list(NAMES))
    unseen[[f"approach.{name}" for name in NAMES]] = sides(later).astype(int)
    unseen.to_csv(given.later, index=False, float_format="%.6f")
    return given


def spatial_analyzer(points: Array) -> str:
    """A point list as SpatialAnalyzer exports it."""
    lines = [
        "// SpatialAnalyzer ASCII point export",
        "// Units: Millimeters",
        "// Collection::Group::Target X Y Z",
    ]
    lines += [f"A::KR14 CELL::{_name(k)}\t{x:.4f}\t{y:.4f}\t{z:.4f}" for k, (x, y, z) in enumerate(points)]
    return "\n".join(lines) + "\n"


def _name(k: int) -> str:
    return f"P{k + 1:03d}"
