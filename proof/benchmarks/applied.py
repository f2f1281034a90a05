"""What is applied beside the best of all models that a diagnosis fitted, on rows that it did not have.

    python -m benchmarks.applied DATA [CASE ...]

Real recordings of others (``DATA``), each half of their rows, in time and at random. Every model that the diagnosis fitted
predicts the other half. Prints a table row for each: errors of the better plain calibration, of what is applied, and of the
best model of all, which only the other half knows; seconds, processor seconds and peak memory of the diagnosis in a process of
its own.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np

from challenge.battery.parts import HALVES, Real
from challenge.battery.recorded import compared, read
from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.diagnosis.refit import DRAWING, ORDINARY, Choice, Model
from truepose.identification.diagnosis.result import WHOLE, Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

RECORDINGS = (
    ("session_60", 60),
    ("session_108", 108),
    ("panda_1", 182),
    ("configurations", 1495),
    ("random", 2773),
)
CASES = tuple(f"{name}.{part}" for name, _ in RECORDINGS for part in ("whole", *HALVES))
HEAD = "| case | rows | plain | applied | best of all | its name | applied over best | s | CPU s | GB |"


@dataclass(frozen=True)
class Tried:
    """A diagnosis, and every model that it fitted, by name."""

    found: Diagnosis
    models: dict[str, Estimate]


def diagnosed(machine: Machine, recording: Recording) -> Tried:
    """Diagnose, and keep what else was fitted."""
    models = dict[str, Estimate]()
    every = Choice.others

    def others(
        choice: Choice, model: Model, names: Model | None, sure: Collection[int]
    ) -> Iterator[tuple[str, Model]]:
        models[WHOLE] = model.fit
        if names is not None:
            models["names"] = names.fit
        return kept(every(choice, model, names, sure))

    def kept(found: Iterator[tuple[str, Model]]) -> Iterator[tuple[str, Model]]:
        for label, model in found:
            models[label] = model.fit
            yield label, model

    with patch.object(Choice, "others", others):
        found = diagnose(machine, recording)
    return Tried(found, {ORDINARY: found.free, DRAWING: found.before, **models})


def row(data: Path, case: str) -> str:
    """Return a line of the table."""
    name, part = case.split(".")
    count = dict(RECORDINGS)[name]
    machine, whole = read(data, name)
    rows, rest = (np.isin(np.arange(count), some) for some in Real(name, count, most=count).split(part))
    fitted = whole.subset(rows)
    start, used = time.perf_counter(), time.process_time()
    tried = diagnosed(machine, fitted)
    took = f"{time.perf_counter() - start:.0f} | {time.process_time() - used:.0f}"
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    told = "| | | | |"
    if rest.any():
        told = _errors(tried, fitted, whole.subset(rest))
    return f"| {case} | {rows.sum()} {told} {took} | {memory:.1f} |"


def _errors(tried: Tried, fitted: Recording, rest: Recording) -> str:
    applied = tried.found.after
    errors = {}
    for label, fit in {"applied": applied, **tried.models}.items():
        readings, tool = compared(fit, fit, fitted, rest)
        errors[label] = (readings if tool is None else tool)[0]
    best = min(errors, key=lambda label: errors[label])
    plain = min(errors[ORDINARY], errors[DRAWING])
    ratio = errors["applied"] / errors[best]
    return f"| {plain:.3g} | {errors['applied']:.3g} | {errors[best]:.3g} | {best} | {ratio:.2f} |"


def main(data: Path, cases: list[str]) -> None:
    """Print the table; each case in a process of its own, so that memory is its own."""
    if len(cases) == 1:
        sys.stdout.write(row(data, cases[0]) + "\n")
        return
    sys.stdout.write(f"{HEAD}\n{'|---' * HEAD.count(' | ')}|---|\n")
    paths = os.pathsep.join([str(Path(__file__).resolve().parents[1]), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths}
    for case in cases or CASES:
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "benchmarks.applied", str(data.resolve()), case]
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, check=False, cwd=folder
            )
        sys.stdout.write(done.stdout or f"| {case} | {done.stderr.splitlines()[-1]} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
