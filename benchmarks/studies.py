"""What studies share: a diagnosis of texts written to a temporary folder, and tables with Wilson intervals."""

from __future__ import annotations

import tempfile
from pathlib import Path

from truepose.challenge.intervals import wilson
from truepose.identification.diagnosis.engine import diagnose
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.load import load_recording
from truepose.models.load import load_machine


def diagnose_texts(machine: str, recording: str) -> Diagnosis:
    """Diagnosis of a machine file and a CSV given as text: the engine sees nothing else."""
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        (at / "machine.yaml").write_text(machine)
        (at / "recording.csv").write_text(recording)
        loaded = load_machine(at / "machine.yaml")
        return diagnose(loaded, load_recording(loaded, [at / "recording.csv"]))


__all__ = ["diagnose_texts", "wilson"]
