"""How long a diagnosis takes, step by step: fit, Gram matrices, search, proof.

    python -m benchmarks.screening [MACHINE RECORDING]

Without files: the bundled telescope. Prints candidates, coefficients, sweeps, and CPU seconds of each step (all threads
together; set OMP_NUM_THREADS=1 for one core).
"""

from __future__ import annotations

import itertools
import sys
import time
from importlib.resources import files
from pathlib import Path

from truepose.identification.diagnosis.diagnose import diagnose
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

STEPS = ("fitting", "weighing", "naming")


def main(machine_file: Path, recording_file: Path) -> None:
    """Diagnose and print."""
    machine = load_machine(machine_file)
    recording = load_recording(machine, [recording_file])
    marks: list[tuple[str, float]] = []
    found = diagnose(machine, recording, progress=lambda said: marks.append((said, time.process_time())))
    marks.append(("", time.process_time()))
    took = [f"{said} {b - a:.1f} s" for (said, a), (_, b) in itertools.pairwise(marks)]
    names = ", ".join(f"{f.effect}@{'+'.join(f.place)} {f.probability:.2f}" for f in found.findings)
    sys.stdout.write(
        f"{machine.name}, {int(found.before.used.sum())} rows: {'; '.join(took)}; {found.verdict}: {names}\n"
    )


if __name__ == "__main__":
    bundled = Path(str(files("truepose.models"))) / "machines" / "telescope"
    given = [Path(a) for a in sys.argv[1:]]
    main(*(given or [bundled / "machine.yaml", bundled / "recording.csv"]))
