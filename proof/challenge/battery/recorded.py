"""Diagnoses a part of a real recording: ``python -m challenge.battery.recorded DATA CASE``.

Writes diagnosis.json and measures.json into the working directory: errors on rows that were not in its file, of plain
calibration and of the model that is applied. The studies of real recordings (``benchmarks/real_recordings``) must be
importable.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from challenge.battery.parts import CASES, Index
from challenge.examinee import DIAGNOSIS

if TYPE_CHECKING:
    from collections.abc import Collection

    from truepose.identification.fit.estimated import Estimate
    from truepose.identification.fit.tool_pose import ToolPoints
    from truepose.identification.recording.recording import Recording
    from truepose.models.machine.machine import Machine

MEASURES = "measures.json"
UR10, STEWART, PANDA = "ur10-laser-tracker", "stewart-mocap", "panda"
Pair = tuple[float, float]
"""Of plain calibration, and of what is applied."""


def diagnosed(data: Path, case: str) -> None:
    """One case, in the working directory. Raises InputError where the file has other rows than are expected."""
    from truepose.errors import InputError
    from truepose.files import atomic_write_text
    from truepose.identification.diagnosis.diagnose import diagnose
    from truepose.identification.fit.calibrate import calibrate
    from truepose.identification.report.json_text import json_text
    from truepose.identification.report.results import diagnosis_json

    real, part = CASES[case]
    machine, whole = read(data, real.name)
    if len(whole) != real.rows:
        raise InputError(f"{real.name}: found {len(whole)} rows, expected {real.rows}")
    fitted, rest = (whole.subset(_mask(rows, real.rows)) for rows in real.split(part))
    plain, found = calibrate(machine, fitted), diagnose(machine, fitted)
    atomic_write_text(Path(DIAGNOSIS), json_text(diagnosis_json(found)))
    readings, tool = compared(plain.fit, found.after, fitted, rest) if len(rest) else (None, None)
    measures = {"fitted": len(fitted), "predicted": len(rest), "readings": readings, "tool": tool}
    atomic_write_text(Path(MEASURES), json.dumps(measures) + "\n")


def read(data: Path, name: str) -> tuple[Machine, Recording]:
    """A machine and all rows of a recording of it; intermediate files go to the working directory."""
    from dataclasses import replace

    from real_recordings.panda import panda_files, with_gravity

    from truepose.identification.recording.load import load_recording
    from truepose.models.load import load_machine

    if not name.startswith(PANDA):
        folder = data / (STEWART if name.startswith("session") else UR10)
        machine = load_machine(folder / "machine.yaml")
        return machine, load_recording(machine, [folder / f"{name}.csv"])
    files = panda_files(data, Path(), (name,))
    machine = with_gravity(files[0])
    recording = load_recording(machine, [files[1]])
    return machine, replace(recording, validation=np.zeros(len(recording), dtype=bool))


def compared(
    plain: Estimate, applied: Estimate, fitted: Recording, rest: Recording
) -> tuple[Pair, Pair | None]:
    """Errors of two models on rows that were not fitted: of readings and of the tool, mm.

    Balls in sockets tell no position of the tool; their readings count in stated sigmas.
    """
    if any(sensor.label_columns for sensor in plain.nominal.sensors):
        return (_seated(plain, rest), _seated(applied, rest)), None
    (before, tool_before), (after, tool_after) = (errors(fit, fitted, rest) for fit in (plain, applied))
    return (before, after), (tool_before, tool_after)


def errors(fit: Estimate, fitted: Recording, rest: Recording) -> tuple[float, float]:
    """Rms, mm, of points as the sensor should read them and of the tool's own, on rows that were not in the file.

    The tool's are moved rigidly onto the fitted rows first, and what the model says of the sensor is left out.
    """
    from truepose.identification.fit.tool_pose import ToolPoints

    silent = {effect.label for effect in fit.effects if effect.kind == "sensor"}
    other = _points(fit, rest, ())
    read = float(np.sqrt(np.mean(np.sum((other.predicted - other.read) ** 2, axis=2))))
    own, other = (_points(fit, part, silent) for part in (fitted, rest))
    both = ToolPoints(
        np.concatenate([own.predicted, other.predicted]), np.concatenate([own.read, other.read])
    )
    first = np.arange(len(both.read)) < len(own.read)
    return read, float(np.sqrt(np.mean(both.squares(first, ~first))))


def _points(fit: Estimate, recording: Recording, silent: Collection[str]) -> ToolPoints:
    from truepose.identification.fit.tool_pose import tool_points
    from truepose.identification.prediction.predictor import Predictor

    predictor = Predictor(fit.nominal, recording, fit.effects)
    x, _ = predictor.assemble(fit.p)
    return tool_points(predictor, fit.p, x, silent)


def _seated(fit: Estimate, rest: Recording) -> float:
    """Rms, in stated sigmas, of how far rows that share a socket are apart."""
    from truepose.identification.prediction.predictor import Predictor

    predictor = Predictor(fit.nominal, rest, fit.effects)
    x, assembled = predictor.assemble(fit.p)
    off = np.concatenate([block.residual.ravel() for block in predictor.blocks(fit.p, x, assembled)])
    off = off[np.isfinite(off) & (off != 0.0)]  # a row that refers to itself says nothing
    return float(np.sqrt(np.mean(off**2)))


def _mask(rows: Index, count: int) -> np.ndarray:
    out = np.zeros(count, dtype=bool)
    out[rows] = True
    return out


def main(data: str, case: str) -> int:
    """Exit code 0, or 1 with one line that says what went wrong."""
    try:
        diagnosed(Path(data), case)
    except Exception as exc:  # a crash is an answer too: it is counted
        sys.stderr.write(f"{type(exc).__name__}: {' '.join(str(exc).split())}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
