"""Pairs that slips are made in: an arm on poses or targets, and a machine of slides, with files and as hypotheses see them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import yaml

import truepose
from support.checked_arm import JOINTS, Document, document, recorded, written
from truepose.identification.leaves.check.pair import Pair, Scene, Slip
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.run import unbounded
from truepose.models.machine.machine import Machine

ROWS = 8
ENOUGH = 12  # to be shifted by three
POINTS = {"P1": [0.0, 30.0, 0.0], "P2": [0.0, -30.0, 0.0], "P3": [80.0, 0.0, 0.0]}
ON_TARGETS = {"type": "targets", "points": POINTS, "sigma": {"xyz": 0.03}}
SLIDE: Document = yaml.safe_load("""
schema: truepose/machine/1
name: gantry
mechanism:
  type: serial
  joints:
    - {name: q1, kind: prismatic, r: 10.0}
    - {name: q2, kind: prismatic, alpha: -90.0, d: 20.0}
    - {name: q3, kind: revolute, alpha: 90.0, theta: 30.0}
frames: {base: {in: world, xyz: [1.0, 2.0, 3.0], tolerance: {xyz: 5, rpy: 1}}}
sensor: {type: position, sigma: {xyz: 0.03}}
tolerances: {length: 0.2, angle: 0.05}
""")


def sides(rows: pd.DataFrame) -> pd.DataFrame:
    """With the side and the speed that each joint arrived with."""
    n = np.arange(len(rows))
    return rows.assign(
        **{f"approach.q{k}": np.sign(np.sin(n + k)) for k in range(1, 7)}, **{"velocity.q2": n + 1.0}
    )


def columns_of(kind: str) -> tuple[Document, pd.DataFrame]:
    rows = recorded()[:ENOUGH]
    if kind == "pose":
        return document(), rows
    rng = np.random.default_rng(1)
    if kind == "slide":
        names = ["q1", "q2", "q3", "x", "y", "z"]
        return SLIDE, pd.DataFrame(rng.uniform(-80, 80, (ROWS, 6)), columns=names)
    seen = {f"{name}.{axis}": rng.uniform(-500, 500, len(rows)) for name in POINTS for axis in "xyz"}
    return document(sensor=ON_TARGETS), rows[list(JOINTS)].assign(**seen)


class Case:
    """A pair of files, loaded; ``mended`` loads what a slip makes of them."""

    def __init__(self, folder: Path, machine: Document, rows: pd.DataFrame) -> None:
        self.folder = folder
        paths = written(folder, machine, rows)
        self.pair = Pair.read(paths[0], [paths[1]])
        self.machine = truepose.load_machine(paths[0])
        self.rig = Rig(self.machine, truepose.load_recording(unbounded(self.machine), paths[1]))

    def mended(self, slip: Slip) -> tuple[Machine, Scene]:
        pair = slip.mend(self.pair)
        (self.folder / "mended.csv").write_text(pair.sheets[0].text(), encoding="utf-8")
        machine = self.machine
        if pair.document != self.pair.document:
            written(self.folder, dict(pair.document), pd.DataFrame())
            machine = truepose.load_machine(self.folder / "arm.yaml")
        value = {p.name: p.nominal for p in machine.parameters}
        p = np.array([value.get(name, 0.0) for name in self.rig.names])
        return machine, Scene(truepose.load_recording(machine, self.folder / "mended.csv"), p)
