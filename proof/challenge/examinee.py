"""Sits the examination: ``python -m challenge.examinee`` in a folder that holds one case.

Reads machine.yaml, recording.csv and heldout.csv, writes diagnosis.json, improved.yaml and heldout_prediction.csv; for
comparison the readings of a perfect instrument, by the improved model (tool_prediction.csv) and by plain calibration
(plain_prediction.csv). Nothing of the simulator or of the keys is imported here.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from truepose.identification.recording.recording import Recording
    from truepose.models.machine.machine import Machine

MACHINE, RECORDING, HELD_OUT = "machine.yaml", "recording.csv", "heldout.csv"
DIAGNOSIS, IMPROVED, PREDICTION = "diagnosis.json", "improved.yaml", "heldout_prediction.csv"
TOOL, PLAIN, CALIBRATED = "tool_prediction.csv", "plain_prediction.csv", "calibrated.yaml"
WRITTEN = (DIAGNOSIS, IMPROVED, PREDICTION, TOOL, PLAIN)
"""What is kept of a sitting."""


def sit(plugins: Sequence[str] = ()) -> None:
    """Diagnose and predict in the working directory; ``plugins`` are files that register a user's effects."""
    from truepose.files import atomic_write_text, write_table
    from truepose.identification.diagnosis.diagnose import diagnose
    from truepose.identification.fit.write_machine import write_calibrated
    from truepose.identification.prediction.predict import predict
    from truepose.identification.recording.load import load_recording
    from truepose.identification.report.json_text import json_text
    from truepose.identification.report.results import diagnosis_json
    from truepose.models.load import load_machine
    from truepose.models.registry import load_plugin

    for path in plugins:
        load_plugin(Path(path))
    machine = load_machine(MACHINE)
    recording = load_recording(machine, [RECORDING])
    found = diagnose(machine, recording)
    atomic_write_text(DIAGNOSIS, json_text(diagnosis_json(found)))
    write_calibrated(IMPROVED, found.after, found.recording)
    improved = load_machine(IMPROVED)
    rows = load_recording(improved, [HELD_OUT], need_observations=False)
    write_table(Path(PREDICTION), predict(improved, rows))
    _compare(machine, recording)


def _compare(machine: Machine, recording: Recording) -> None:
    """What the improved model is worth beside plain calibration; where that fails, there is nothing to compare with."""
    from challenge.perfect import seen_perfectly
    from truepose.errors import TrueposeError
    from truepose.files import write_table
    from truepose.identification.fit.calibrate import calibrate
    from truepose.identification.fit.write_machine import write_calibrated

    with suppress(TrueposeError):
        write_table(Path(TOOL), seen_perfectly(Path(IMPROVED), Path(HELD_OUT)))
        plain = calibrate(machine, recording)
        write_calibrated(CALIBRATED, plain.fit, plain.recording)
        write_table(Path(PLAIN), seen_perfectly(Path(CALIBRATED), Path(HELD_OUT)))


def main(plugins: Sequence[str]) -> int:
    """Exit code 0, or 1 with one line that says what went wrong."""
    try:
        sit(plugins)
    except Exception as exc:  # a crash is an answer too: it counts as wrong
        message = " ".join(str(exc).split())
        sys.stderr.write(f"{type(exc).__name__}: {message}\n")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
