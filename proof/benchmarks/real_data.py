"""Recordings that others measured (docs/results/real-recordings.md): tables of what ``truepose diagnose`` makes of them.

    python -m benchmarks.real_data prepare DATA WORK [RECORDING ...]
    python -m benchmarks.real_data unseen DATA WORK [RECORDING ...]
    python -m benchmarks.real_data campaigns DATA WORK ONE OTHER
    python -m benchmarks.real_data panda DATA WORK

DATA holds ``ur10-laser-tracker/``, ``stewart-mocap/``, ``panda-ball-socket/`` and ``telescope-mount/``, WORK is any folder.
``prepare`` writes each recording with the column ``role`` and prints the command that diagnoses it; ``unseen`` diagnoses
it, too, and tells what the model is worth on the rows held out; ``campaigns`` compares two campaigns of the UR10;
``panda`` calibrates an arm by a ball in sockets. Halves of these recordings, and cuts to a few rows, are parts of
``python -m challenge.battery``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from real_recordings.campaigns import campaigns
from real_recordings.panda import panda
from real_recordings.prepared import NAMES, prepared
from real_recordings.unseen import unseen


def lines(study: str, data: Path, work: Path, names: Sequence[str]) -> Iterator[str]:
    """What a study prints, line by line. Raises KeyError for one that does not exist."""
    if study == "prepare":
        for name in names or NAMES:
            machine, recording = prepared(data, work, name)
            yield f"truepose diagnose {machine} {recording} -o {work / name}"
    elif study == "panda":
        yield from panda(data, work)
    else:
        yield from {"unseen": unseen, "campaigns": campaigns}[study](data, work, names)


if __name__ == "__main__":
    for line in lines(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]), sys.argv[4:]):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
