"""Real recordings cut to a few rows: what the model that is applied is worth on rows that were nowhere in its file.

Rows are drawn at random; the others, 500 at most, are predicted. Readings and the tool's position (after a rigid refit on
the fitted rows) are compared with plain calibration's, and findings are told at the level at which they are known.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

import numpy as np

from real_recordings.common import say
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.fit.calibrate import calibrate
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.tool_pose import ToolPoints, tool_points
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.report.level_words import driver_clauses
from truepose.models.load import load_machine

CUTS = (60, 120, 240)
PREDICTED = 500
RECORDINGS = (
    ("ur10-laser-tracker", "configurations"),
    ("ur10-laser-tracker", "random"),
    ("ur10-laser-tracker", "grid"),
    ("stewart-mocap", "session_108"),
)


def cuts(data: Path) -> None:
    """Every recording at every cut that leaves rows to predict."""
    for folder, name in RECORDINGS:
        machine = load_machine(data / folder / "machine.yaml")
        whole = load_recording(machine, [data / folder / f"{name}.csv"])
        order = np.random.default_rng(1).permutation(len(whole))
        for count in (count for count in CUTS if count < 0.9 * len(whole)):
            fitted = whole.subset(_mask(order[:count], len(whole)))
            rest = whole.subset(_mask(order[count : count + PREDICTED], len(whole)))
            plain, found = calibrate(machine, fitted), diagnose(machine, fitted)
            errors = [errors(fit, fitted, rest) for fit in (plain.fit, found.after)]
            told = ", ".join(
                f"{what} {a:.3f} -> {b:.3f} mm ({b / a:.2f})"
                for what, a, b in zip(("readings", "tool"), *errors, strict=True)
            )
            model = found.applied.model if found.applied else "-"
            say(f"{name}, {count} rows: {told}; {found.verdict}, applied: {model}")
            say(f"  {'; '.join(driver_clauses(found.findings)) or 'nothing below its law'}")


def _mask(rows: np.ndarray, size: int) -> np.ndarray:
    out = np.zeros(size, dtype=bool)
    out[rows] = True
    return out


def errors(fit: Estimate, fitted: Recording, rest: Recording) -> tuple[float, float]:
    """Rms, mm, of points as the sensor should read them and of the tool's own, on rows that were not in the file."""
    silent = {effect.label for effect in fit.effects if effect.kind == "sensor"}
    own, other = (_points(fit, part, ()) for part in (fitted, rest))
    read = float(np.sqrt(np.mean(np.sum((other.predicted - other.read) ** 2, axis=2))))
    own, other = (_points(fit, part, silent) for part in (fitted, rest))
    both = ToolPoints(
        np.concatenate([own.predicted, other.predicted]), np.concatenate([own.read, other.read])
    )
    first = np.arange(len(both.read)) < len(own.read)
    return read, float(np.sqrt(np.mean(both.squares(first, ~first))))


def _points(fit: Estimate, recording: Recording, silent: Collection[str]) -> ToolPoints:
    predictor = Predictor(fit.machine, recording, fit.effects)
    x, _ = predictor.assemble(fit.p)
    return tool_points(predictor, fit.p, x, silent)
