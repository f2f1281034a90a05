"""An arm before a tracker, a telescope before a camera, a stage before a cavity: recordings of sensors that err."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from support.telescope_legs import FLEXURED
from truepose.identification.prediction.predict import simulate, with_inputs
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.recording.table import read_table
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

HEAD = "schema: truepose/machine/1\nname: NAME\ntolerances: {length: 0.05, angle: 0.02}\n"
ARM = """
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 450, range: [-160, 160]}
    - {name: q2, kind: revolute, alpha: -90, d: 200, theta: -90, range: [-70, 70]}
    - {name: q3, kind: revolute, d: 800, range: [-70, 70]}
    - {name: q4, kind: revolute, alpha: -90, d: 30, r: 700, range: [-150, 150]}
    - {name: q5, kind: revolute, alpha: 90, range: [-100, 100]}
    - {name: q6, kind: revolute, alpha: -90, r: 190, range: [-170, 170]}
frames:
  base: {in: world, xyz: [1800, -200, 100], rpy: [0, 0, 150], tolerance: {xyz: 5, rpy: 1}}
  tool: {in: flange, xyz: [40, -20, 120], rpy: [0, 0, 0], tolerance: {xyz: 1, rpy: 0}}
sensor: {type: position, sigma: {xyz: 0.01}}
"""
TELESCOPE = FLEXURED
TELESCOPE += """
frames: {base: {in: world, xyz: [0, 0, 0], rpy: [0, 0, 0], tolerance: {xyz: 5, rpy: 1}}}
sensor:
  type: targets
  points: {P1: [175, 0, -85], P2: [-87, 151, -85], P3: [-87, -151, -85], P4: [9, 104, -10]}
  sigma: {xyz: 0.002}
"""
STAGE = """
units: {length: um, angle: deg}
mechanism:
  type: serial
  joints:
    - {name: x, kind: prismatic, alpha: 90, range: [-150, 150]}
    - {name: y, kind: prismatic, alpha: 90, range: [-150, 150]}
    - {name: t, kind: revolute, range: [-3, 3]}
sensor:
  type: distance
  beam: {in: world, xyz: [0, 900, 0], rx: 90, rz: 0}
  mirror: {in: flange, z: 0, rx: 90, ry: 0}
  sigma: {distance: 0.002}
  tolerance: {beam.xyz: 20, beam.angle: 0.1, mirror.z: 5, mirror.angle: 0.1}
  wavelength: 1.56
"""
STAGE_HEAD = "schema: truepose/machine/1\nname: NAME\ntolerances: {length: 1, angle: 0.05}\n"
TEXTS = {"arm": HEAD + ARM, "telescope": HEAD + TELESCOPE, "stage": STAGE_HEAD + STAGE}
ROWS = 90


class Bench:
    """A machine and recordings of it, true constants as the drawing has them."""

    def __init__(self, folder: Path, name: str, text: str = "") -> None:
        self.folder, self.name = folder, name
        (folder / f"{name}.yaml").write_text((text or TEXTS[name]).replace("NAME", name))
        self.machine: Machine = load_machine(folder / f"{name}.yaml")

    @property
    def drivers(self) -> pd.DataFrame:
        """Poses at random, with weather and velocities that have nothing to do with them."""
        rng = np.random.default_rng(5)
        data: dict[str, object] = {"pose": np.arange(ROWS)}
        if self.name == "stage":
            data["from"] = np.maximum(np.arange(ROWS) - 1, 0)
        units = {"mm": "mm", "rad": "rad"}
        for actuator in self.machine.mechanism.actuators:
            assert actuator.range is not None
            unit = units[actuator.reading_unit]
            low, high = actuator.range
            data[f"{actuator.reading} [{unit}]"] = rng.uniform(low, high, ROWS)
            data[f"velocity.{actuator.reading} [{unit}/s]"] = rng.normal(0, 0.2 * (high - low), ROWS)
        data["temperature.air"] = rng.uniform(15, 27, ROWS)
        data["pressure [hPa]"] = rng.uniform(970, 1030, ROWS)
        return pd.DataFrame(data)

    def rows(self, *drop: str) -> Recording:
        """The poses without readings."""
        path = self.folder / "poses.csv"
        frame = self.drivers
        frame.drop(columns=[c for c in frame.columns if str(c).startswith(drop)] if drop else []).to_csv(
            path, index=False
        )
        return load_recording(self.machine, [path], need_observations=False)

    def placed(self, text: str) -> PlacedEffect:
        return parse_effect(text, self.machine)

    def recording(
        self, *texts: str, seed: int | None = 3, change: Callable[[pd.DataFrame], None] | None = None
    ) -> Recording:
        """What is read where these effects act."""
        rows = self.rows()
        frame = simulate(self.machine, rows, [self.placed(text) for text in texts], seed=seed)
        if change is not None:
            change(frame)
        target = self.folder / "recording.csv"
        with_inputs(read_table(self.folder / "poses.csv"), frame).to_csv(target, index=False)
        return load_recording(self.machine, [target])
