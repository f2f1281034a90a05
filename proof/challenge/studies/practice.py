"""Diagnose the practice cases through the command line, predict their held-out rows, and score them.

    python -m challenge.studies.practice PRACTICE_FOLDER RESULTS_FOLDER

PRACTICE_FOLDER holds ``caseNNN/`` and ``score.py``. The commands see machine and recording only.
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path


def run(*words: object) -> int:
    """One truepose command; its exit code."""
    return subprocess.run([sys.executable, "-m", "truepose.cli", *map(str, words)], check=False).returncode


def main(cases: Path, results: Path) -> None:
    """Every case, then the score."""
    for case in sorted(cases.glob("case*")):
        out, start = results / case.name, time.perf_counter()
        code = run("diagnose", case / "machine.yaml", case / "recording.csv", "-o", out)
        if code == 0:
            run("predict", out / "improved.yaml", case / "heldout.csv", "-o", out / "heldout_prediction.csv")
        sys.stdout.write(f"{case.name}: exit {code}, {time.perf_counter() - start:.1f} s\n")
        sys.stdout.flush()
    score = [
        sys.executable,
        cases / "score.py",
        "--cases",
        cases,
        "--answers",
        cases / "answers",
        "--results",
        results,
    ]
    subprocess.run([*map(str, score), "--verbose"], check=False)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
