"""``python -m benchmarks.many_rows 10000 100000 1000000``: a diagnosis of each, with time, memory and stages, as a table."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from many_rows.arm import write

PROOF = Path(__file__).resolve().parents[2]
STAGES = {
    "read and check": ("reading",),
    "search": ("fitting", "weighing"),
    "name and prove": ("naming",),
    "report": ("writing",),
}


def measured(rows: int, folder: Path) -> dict[str, Any]:
    """What one diagnosis took, in a process of its own."""
    machine, recording = write(rows, folder)
    command = [sys.executable, "-m", "benchmarks.many_rows.measure", str(machine), str(recording)]
    paths = os.pathsep.join([str(PROOF), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True, text=True)
    recording.unlink()
    return dict(json.loads(done.stdout))


def table(found: Sequence[Mapping[str, Any]]) -> str:
    """A row a recording."""
    lines = [
        f"| rows | time, s | processors, s | memory, GB | {' | '.join(STAGES)} | report.html, kB | verdict | diagnosis.json |",
        "|" + "---|" * (7 + len(STAGES)),
    ]
    for one in found:
        shares = [
            sum(s for text, s in one["stages"].items() if text.startswith(begin)) / one["seconds"]
            for begin in STAGES.values()
        ]
        told = " | ".join(f"{100 * share:.0f} %" for share in shares)
        lines.append(
            f"| {one['rows']:,} | {one['seconds']:.0f} | {one['processor']:.0f} | {one['gigabytes']:.2f} | {told} "
            f"| {one['report'] / 1000:.0f} | {one['verdict']} | {one['digest'][:8]} |"
        )
    return "\n".join(lines)


def names(found: Sequence[Mapping[str, Any]]) -> str:
    """What was said of each recording, with sizes."""
    lines = ["| rows | effect | place | probability | size |", "|---|---|---|---|---|"]
    for one in found:
        for effect, place, probability, sizes in one["names"]:
            told = ", ".join(f"{name} {value:.4g} ± {std:.2g}" for name, (value, std) in sizes.items())
            lines.append(f"| {one['rows']:,} | {effect} | {'+'.join(place)} | {probability:.3f} | {told} |")
    return "\n".join(lines)


def main() -> None:
    """Measure one after the other, then print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=int, nargs="+")
    wanted = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = [measured(rows, Path(folder)) for rows in wanted.rows]
    sys.stdout.write(f"{table(found)}\n\n{names(found)}\n")


if __name__ == "__main__":
    main()
