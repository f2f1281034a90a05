"""Twins share one signal: none of them is sure, but that one of them acts is, and is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

from support.reports import diagnosis_lines
from truepose.api import diagnose
from truepose.identification.report.results import diagnosis_json
from truepose.models.load import load_machine

ARM = """
schema: truepose/machine/1
name: wrist
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, range: [-180, 180]}
    - {name: q2, kind: revolute, alpha: -90, range: [-180, 180]}
    - {name: q3, kind: revolute, alpha: 90, range: [-180, 180]}
frames: {tool: {in: flange, xyz: [400, 30, 60], tolerance: {xyz: 1}}}
sensor: {type: position, sigma: {xyz: 0.01}}
tolerances: {length: 0.2, angle: 0.05}
masses: {tip: {kg: 8, com: [20, -10, 5], in: tool}}
"""
SIGMA, SAG = 0.01, 1e-5


def recorded(n: int, seed: int = 2) -> pd.DataFrame:
    """An arm whose mount turns by SAG (rad/(N m)) times the weight's moment, plain numpy."""
    rng, rows = np.random.default_rng(seed), []
    for time in range(n):
        q = rng.uniform(-2.5, 2.5, 3)
        turned = Rotation.identity()
        for alpha, angle in zip((0.0, -90.0, 90.0), q, strict=True):
            turned = turned * Rotation.from_euler("XZ", [np.radians(alpha), angle])
        tip, centre = turned.apply([[400.0, 30.0, 60.0], [420.0, 20.0, 65.0]])
        moment = np.cross(centre, [0.0, 0.0, -8 * 9.80665]) / 1000.0
        seen = Rotation.from_rotvec(SAG * moment).apply(tip) + SIGMA * rng.standard_normal(3)
        rows.append([60.0 * time, *np.degrees(q), *seen])
    return pd.DataFrame(rows, columns=["time", "q1", "q2", "q3", "x", "y", "z"])


def test_twins_are_known_together(tmp_path: Path) -> None:
    """An upright first joint's bearings and the floor below it yield alike; that one of them does is certain."""
    (tmp_path / "arm.yaml").write_text(ARM, encoding="utf-8")
    found = diagnose(load_machine(tmp_path / "arm.yaml"), recorded(60))
    assert not any(f.probability > 0.9 for f in found.findings)
    (one,) = [t for t in found.together if t.driver == "load"]
    assert {"base", "link1"} <= set(one.places)
    assert one.probability > 0.95
    told = diagnosis_json(found)["together"]
    assert {"driver": "load", "places": list(one.places), "probability": one.probability} in told
    assert any(line.strip().startswith("together:") for line in diagnosis_lines(found, Path("out")))
