"""Small machines whose readings hold what no formula of the catalogue made, and what is asked of their diagnosis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from support.moving_machines import written
from support.telescope_legs import FLEXURED
from truepose.arrays import Array
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.fit.problem import prior_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

TOLERANCES = "tolerances: {length: 0.1, angle: 0.05}\n"
TABLE = """
mechanism:
  type: serial
  joints:
    - {name: s, kind: prismatic, range: [-100, 100]}
    - {name: q, kind: revolute, alpha: -90, d: 60, r: 400, range: [-170, 170]}
frames: {tool: {in: flange, xyz: [200, 0, 30], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.01}}
"""
ARM = """
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}
frames: {tool: {in: flange, xyz: [500, 0, 0], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.01}}
masses: {payload: {kg: 2, com: [0, 0, 0], in: tool}}
"""
HEXAPOD = FLEXURED + "sensor: {type: pose, sigma: {xyz: 0.002, rot: 0.0005}}\n"
TEXTS = {"table": TABLE, "arm": ARM, "hexapod": HEXAPOD}


class Bench:
    """A machine, its true parameters (drawn within tolerances) and recordings of what it really does."""

    def __init__(self, folder: Path, name: str, seed: int) -> None:
        self.folder, self.rng = folder, np.random.default_rng(seed)
        self.machine: Machine = written(folder, TOLERANCES + TEXTS[name], name)
        prior = prior_of(self.machine)
        self.true: Array = prior.mean + 0.7 * prior.sigma * self.rng.standard_normal(len(prior.mean))

    def readings(self, rows: int) -> Array:
        """Random readings (rows, nq) within the joints' ranges."""
        limits = [a.range for a in self.machine.mechanism.actuators]
        return np.column_stack([self.rng.uniform(*limit, rows) for limit in limits if limit is not None])

    def frame(
        self,
        q: Array,
        stands: Array | None = None,
        shifts: Mapping[str, Array] | None = None,
        **columns: Any,
    ) -> pd.DataFrame:
        """What is recorded at commands ``q`` when joints stand at ``stands`` and parameters are shifted."""
        rows = len(q)
        units = [a.reading_unit for a in self.machine.mechanism.actuators]
        names = [f"{n} [{u}]" for n, u in zip(self.machine.mechanism.readings, units, strict=True)]
        true = q if stands is None else stands
        recording = load_recording(
            self.machine, [self.csv(pd.DataFrame(true, columns=names))], need_observations=False
        )
        predictor = Predictor(self.machine, recording)
        place = {name: k for k, name in enumerate(predictor.model.names)}
        parameters = np.tile(self.true, (rows, 1))
        for name, shift in (shifts or {}).items():
            parameters[:, place[name]] += shift
        read: list[Array] = []
        for k, p in enumerate(parameters if shifts else parameters[:1]):
            titles, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
            read.append(values[k] if shifts else values)
        (sensor,) = self.machine.sensors
        noisy = sensor.noisy(np.array(read) if shifts else read[0], self.rng)
        columns_of = dict(zip(titles, noisy.T, strict=True))
        unit = sensor.columns
        data = {f"{n} [{unit[n]}]" if unit[n] in ("mm", "rad") else n: v for n, v in columns_of.items()}
        return pd.DataFrame({**dict(zip(names, q.T, strict=True)), **data, **columns})

    def diagnose(self, frame: pd.DataFrame) -> Diagnosis:
        return diagnose(self.machine, self.recording(frame))

    def recording(self, frame: pd.DataFrame) -> Recording:
        return load_recording(self.machine, [self.csv(frame)])

    def csv(self, frame: pd.DataFrame) -> Path:
        path = self.folder / f"{self.machine.name}-{len(list(self.folder.iterdir()))}.csv"
        frame.to_csv(path, index=False)
        return path


def clock(rows: int, step: float = 60.0) -> Array:
    """Seconds since the start (rows,)."""
    return np.arange(rows, dtype=np.float64) * step


def the_only(diagnosis: Diagnosis, effect: str, *place: str, alike: tuple[str, ...] = ()) -> Finding:
    """The one finding; ``alike``: effects that such a recording cannot tell from it, all together less likely than it.

    What is only like it, and has no name, takes less than a third beside it, whatever the form of the effect; half where one
    half of the rows would not name it.
    """
    assert diagnosis.verdict == "missing-physics"
    names = [(f.effect, f.place) for f in diagnosis.findings]
    assert names == [(effect, place)]
    (finding,) = diagnosis.findings
    rivals = {other.effect: other.probability for other in finding.equivalents if not other.nameless}
    only_alike = sum(other.probability for other in finding.equivalents if other.nameless)
    assert set(rivals) <= set(alike)
    replicated = finding.replication is None or finding.replication.replicated
    assert only_alike < (1 / 3 if replicated else 0.5)
    assert finding.probability > (sum(rivals.values()) if rivals else 0.9 - only_alike)
    assert finding.probability + sum(rivals.values()) + only_alike > 0.9
    assert finding.explanation
    assert finding.experiment
    return finding
