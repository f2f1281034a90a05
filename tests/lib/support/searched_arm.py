"""A small arm with something simulated in it, as the search sees it."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from support.simulated import machine_from, readings_of
from truepose.identification.diagnosis.null_fits import Fits
from truepose.identification.diagnosis.posterior_summary import Sums
from truepose.identification.diagnosis.search import Found, search
from truepose.identification.diagnosis.selection_problem import selection_problem
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.posterior import Posterior
from truepose.identification.posterior.state import State, best_point, nearest_top
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue, catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.machine.machine import Machine

ARM = """
schema: truepose/machine/1
name: arm
tolerances: {length: 0.1, angle: 0.05}
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, r: 400, range: [-170, 170]}
    - {name: q2, kind: revolute, alpha: 90, d: 50, range: [-100, 100]}
frames: {tool: {in: flange, xyz: [300, 0, 40], tolerance: {xyz: 0.5, rpy: 0}}}
sensor: {type: position, sigma: {xyz: 0.01}}
"""
ROWS = 40
PLAY, SCALE = "backlash@q2:b=0.05[deg]", "actuator-scale@q1:s=2e-3"
WRONG_SIGN = "backlash@q2:b=-0.05[deg]"


@dataclass(frozen=True)
class Case:
    """A small arm with something simulated in it, its candidates, and the fit without them."""

    cat: Catalogue
    signatures: Signatures
    null: Estimate

    @classmethod
    def of(cls, folder: Path, *truth: str, only_from: int = 0) -> Case:
        """``only_from``: earlier rows are read from the machine without what is missing."""
        machine, rng = machine_from(folder, ARM, "arm"), np.random.default_rng(12)
        table = pd.DataFrame(rng.uniform(-1, 1, (ROWS, 2)) * [160, 95], columns=["q1 [deg]", "q2 [deg]"])
        table["approach.q1"], table["approach.q2"] = rng.choice([-1.0, 1.0], (2, ROWS))
        rows = readings_of(machine, table, *truth)
        rows.iloc[:only_from] = readings_of(machine, table).iloc[:only_from]
        rows.to_csv(folder / "rows.csv", index=False)
        return cls.on(machine, load_recording(machine, [folder / "rows.csv"]))

    @classmethod
    def on(cls, machine: Machine, recording: Recording) -> Case:
        cat = catalogue(machine, recording)
        return cls(cat, Signatures(machine, recording, cat.candidates), estimate(machine, recording))

    @property
    def exclude(self) -> NDArray[np.bool_]:
        return np.zeros(len(self.null.used), dtype=np.bool_)

    @property
    def rms(self) -> float:
        return float(np.sqrt(self.null.chi2_per_dof))

    def found(self, exclude: NDArray[np.bool_] | None = None) -> Found:
        left_out = self.exclude if exclude is None else exclude
        fits = Fits(self.null, self.null, left_out)
        return search(self.signatures, self.cat, fits, lambda: False).found()

    def holding(self, *labels: str) -> Found:
        """Without a search: the fit with these candidates, and the state of them as all that was visited."""
        machine, recording = self.signatures.machine, self.signatures.recording
        number = {c.label: i for i, c in enumerate(self.cat.candidates)}
        held = [number[label] for label in labels]
        fit = estimate(machine, recording, [self.cat.candidates[i] for i in held])
        lin = self.signatures.linearise(fit)
        problem = selection_problem(lin, self.cat, self.rms)
        slab = problem.spike_slab
        usual = int(np.argmin(np.abs(np.log(slab.sizes.values))))
        members = tuple(sorted((problem.candidates.index(i), usual) for i in held))
        mode = State(members, nearest_top(slab, best_point(slab), members), 0.0)
        there = np.isin(np.arange(len(problem.causes)), slab.terms.cause[[t for t, _ in members]]).astype(
            float
        )
        posterior = Posterior({}, there, np.diag(there), ((mode, 1.0),), ((mode.point, 1.0),), 0.0, 640)
        alone, bare = np.zeros(len(self.cat.candidates)), self.signatures.linearise(self.null).bare()
        own = dict.fromkeys(held, 1.0), fit, lin, self.signatures, self.cat
        return Found(problem, posterior, mode, *own, alone, bare)


def sums_of(found: Found) -> Sums:
    """What its posterior says."""
    return Sums(found.signatures.machine, found.catalogue, found.problem, found.posterior)


@cache
def held(*truth: str) -> tuple[Case, Found]:
    """The case of these effects and the state of them, without a search; once for all tests: nobody changes either."""
    with tempfile.TemporaryDirectory() as folder:
        case = Case.of(Path(folder), *truth)
        return case, case.holding(*(text.partition(":")[0] for text in truth))


@cache
def searched(*truth: str) -> tuple[Case, Found]:
    """The case of these effects and what is found in it, once for all tests: nobody changes either."""
    with tempfile.TemporaryDirectory() as folder:
        case = Case.of(Path(folder), *truth)
        return case, case.found()
