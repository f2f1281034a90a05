"""Sits the examination: ``python -m truepose.challenge.examinee`` in a folder that holds one case.

Reads machine.yaml, recording.csv and heldout.csv, writes diagnosis.json, improved.yaml and
heldout_prediction.csv; nothing of the simulator or of the keys is imported here.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

MACHINE, RECORDING, HELD_OUT = "machine.yaml", "recording.csv", "heldout.csv"
DIAGNOSIS, IMPROVED, PREDICTION = "diagnosis.json", "improved.yaml", "heldout_prediction.csv"


def sit(plugins: Sequence[str] = ()) -> None:
    """Diagnose and predict in the working directory; ``plugins`` are files that register a user's effects."""
    from truepose.files import atomic_write_text, write_table
    from truepose.identification.diagnosis.engine import diagnose
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
    found = diagnose(machine, load_recording(machine, [RECORDING]))
    atomic_write_text(DIAGNOSIS, json_text(diagnosis_json(found)))
    write_calibrated(IMPROVED, found.after, found.recording)
    improved = load_machine(IMPROVED)
    rows = load_recording(improved, [HELD_OUT], need_observations=False)
    write_table(Path(PREDICTION), predict(improved, rows))


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
