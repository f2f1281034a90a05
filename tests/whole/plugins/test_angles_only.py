"""A user's own theodolite, which reads two angles and no length: every report words its misfit as an angle."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from truepose.cli import app

THEODOLITE = '''
from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.models.machine.sensor import Channel, Sensor, sensors
from truepose.models.file.fields import Section


class Stand(Section):
    type: str
    at: tuple[float, float, float]


@sensors.add("theodolite")
@dataclass(frozen=True)
class Theodolite(Sensor):
    """Azimuth and elevation of the tool's origin, seen from a stand (mm in the sensor's frame)."""

    at: tuple[object, ...]
    type = "theodolite"
    columns = {"azimuth": "rad", "elevation": "rad"}
    channels = tuple(Channel(name, "rad", 2e-5, "angle", "sight") for name in columns)
    parameters = property(lambda self: self.at)

    @classmethod
    def build(cls, section, context):
        at = context.parse(Stand, section).at
        names = zip(("stand.x", "stand.y", "stand.z"), at)
        return cls(tuple(context.parameter(n, "mm", v, ("at", k), "sensor", 1.0) for k, (n, v) in enumerate(names)))

    def predict(self, world, s):
        x, y, z = ca.vertsplit(world[:3, 3] - ca.vertcat(*(s[p.name] for p in self.at)))
        return ca.vertcat(ca.atan2(y, x), ca.atan2(z, ca.sqrt(x**2 + y**2)))
'''
ARM = """
schema: truepose/machine/1
name: arm
units: {angle: rad}
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 300, range: [-1.5, 1.5]}
    - {name: q2, kind: revolute, alpha: 1.5707963, d: 80, range: [-1.5, 1.5]}
frames: {tool: {in: flange, xyz: [500, 0, 40], tolerance: {xyz: 1}}}
sensor: {type: theodolite, at: [-2500, 300, 200]}
tolerances: {length: 0.2, angle: 0.001}
"""
STAND, ROWS, SIGMA, GEAR = np.array([-2500.6, 300.4, 199.2]), 60, 2e-5, 8e-4
ANGLE, LENGTH = re.compile(r"\d (rad|mrad|µrad|nrad)"), re.compile(r"\d (mm|µm|um|nm)\b")


def tool(q: np.ndarray) -> np.ndarray:
    """(n, 3) the tool's origin, mm, from the two angles (n, 2): the second axis stands across the first."""
    c, s, c2, s2 = np.cos(q[:, 0]), np.sin(q[:, 0]), np.cos(q[:, 1]), np.sin(q[:, 1])
    out, up = 80.0 + 500.0 * c2, 300.0 + 500.0 * s2
    return np.column_stack([c * out + 40.0 * s, s * out - 40.0 * c, up])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plug-in, the arm, and two days of readings; on the second a gear of the arm runs out of round."""
    path = tmp_path_factory.mktemp("theodolite")
    (path / "plugin.py").write_text(THEODOLITE, encoding="utf-8")
    (path / "arm.yaml").write_text(ARM, encoding="utf-8")
    rng = np.random.default_rng(3)
    for name, gear in (("sound", 0.0), ("worn", GEAR)):
        q = rng.uniform(-1.4, 1.4, (ROWS, 2))
        x, y, z = (tool(q + gear * np.sin(q[:, 1:]) * [0.0, 1.0]) - STAND).T
        seen = np.column_stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))])
        seen += SIGMA * rng.standard_normal(seen.shape)
        columns = {"q1": q[:, 0], "q2": q[:, 1], "azimuth": seen[:, 0], "elevation": seen[:, 1]}
        pd.DataFrame(columns).to_csv(path / f"{name}.csv", index=False)
    return path


def told(folder: Path, command: str, *names: str) -> tuple[str, Path]:
    """What a command says, and where it wrote."""
    out = folder / command
    recordings = [str(folder / f"{name}.csv") for name in names]
    options = ["-o", str(out), "--plugin", str(folder / "plugin.py")]
    result = CliRunner().invoke(app, [command, str(folder / "arm.yaml"), *recordings, *options])
    assert result.exit_code == 0, result.output
    return result.stdout, out


def rows_about_rms(out: Path) -> list[str]:
    """Rows of the report's tables that tell the rms of the angles, without tags."""
    page = (out / "report.html").read_text(encoding="utf-8")
    rows = [re.sub(r"<[^>]+>", " ", row) for row in re.findall(r"<tr>.*?</tr>", page, flags=re.DOTALL)]
    return [row for row in rows if re.search(r"\bangle\b", row) and re.search(r"\d", row)]


def only_angles(texts: list[str]) -> bool:
    return bool(texts) and all(ANGLE.search(text) and not LENGTH.search(text) for text in texts)


def test_a_calibration_by_angles_is_told_in_angles(folder: Path) -> None:
    said, out = told(folder, "calibrate", "sound")
    rms: dict[str, Any] = json.loads((out / "fit.json").read_text())["rms"]
    assert list(rms) == ["angle"] and rms["angle"]["unit"] == "rad"
    assert rms["angle"]["value"] == pytest.approx(np.sqrt(2) * SIGMA, rel=0.3)
    assert only_angles([line for line in said.splitlines() if "rms" in line])
    assert only_angles(rows_about_rms(out))


def test_a_diagnosis_by_angles_is_told_in_angles(folder: Path) -> None:
    _, out = told(folder, "diagnose", "worn")
    fits = json.loads((out / "diagnosis.json").read_text())["fit"]
    for fit in fits.values():
        assert list(fit["rms"]) == ["angle"] and fit["rms"]["angle"]["unit"] == "urad"
    assert fits["free"]["rms"]["angle"]["value"] > 1.5e6 * SIGMA
    assert only_angles(rows_about_rms(out))
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "µrad" in page and not re.search(r"residual[^<]{0,20}\[(mm|µm|nm)\]", page)


def test_a_drift_by_angles_is_told_in_angles(folder: Path) -> None:
    said, out = told(folder, "drift", "sound", "worn")
    assert only_angles([line for line in said.splitlines() if "rms" in line])
    assert only_angles(rows_about_rms(out))
