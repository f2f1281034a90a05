"""How long it takes to screen the whole catalogue over all places: signatures, Gram matrix, evidence.

    python benchmarks/screening.py [MACHINE RECORDING]

Without files: the bundled telescope, its 40 calibration poses. The null fit is not counted. Prints candidates,
coefficients, points of the grid, and seconds of each step (wall clock, threads as the environment allows).
"""

from __future__ import annotations

import itertools
import sys
import time
from importlib.resources import files
from pathlib import Path

from truepose.identification.diagnosis.candidates import catalogue
from truepose.identification.diagnosis.effect_evidence import grid_for
from truepose.identification.diagnosis.effect_selection import rank
from truepose.identification.diagnosis.signatures import Signatures
from truepose.identification.fit.align import aligned_start
from truepose.identification.fit.estimate import estimate
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine


def main(machine_file: Path, recording_file: Path) -> None:
    """Fit, then screen and print."""
    machine = load_machine(machine_file)
    recording = load_recording(machine, [recording_file])
    predictor = Predictor(machine, recording)
    fit = estimate(machine, recording, start=aligned_start(predictor), predictor=predictor)
    marks = [time.perf_counter()]
    cat = catalogue(machine, recording)
    signatures = Signatures(machine, recording, cat.candidates)
    marks.append(time.perf_counter())
    lin = signatures.linearise(fit)
    marks.append(time.perf_counter())
    grid = grid_for(lin, float(fit.chi2_per_dof**0.5))
    rank(lin, cat, grid, {}, range(len(cat.candidates)))
    marks.append(time.perf_counter())
    steps = [f"{b - a:.2f}" for a, b in itertools.pairwise(marks)]
    sys.stdout.write(
        f"{machine.name}, {int(fit.used.sum())} rows: {len(cat.candidates)} candidates, {signatures.width} coefficients, "
        f"{len(grid.noise) * len(grid.inflation)} points; expressions {steps[0]} s, Gram matrix {steps[1]} s, "
        f"evidence {steps[2]} s, in all {marks[-1] - marks[0]:.2f} s\n"
    )


if __name__ == "__main__":
    bundled = Path(str(files("truepose.models"))) / "machines" / "telescope"
    given = [Path(a) for a in sys.argv[1:]]
    main(*(given or [bundled / "machine.yaml", bundled / "recording.csv"]))
