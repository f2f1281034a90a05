"""Instructions of one warm solve, counted by valgrind's callgrind on the -O2 builds (it does not run AVX-512)."""

from __future__ import annotations

import re
from pathlib import Path

from . import generated, newton
from .machine import run, tool
from .problems import near, save
from .study import Bench, Options

COUNTED = 200
"""Poses of a count; it repeats exactly."""


def rows(b: Bench, options: Options) -> list[tuple[str, float]]:
    """Solver and instructions a solve, from the entry of the solving function to its return."""
    if tool("valgrind") is None:
        return []
    files = save(near(b.arm, COUNTED), options.folder, f"{b.arm.name}_counted")
    flags, out = generated.PLAIN, options.folder / "counted.out"
    program = b.programs[flags].path
    words = [str(w) for w in (program, "one", files.targets, files.guesses, out, 1)]
    found = [(f"truepose C, {' '.join(flags)}", count(words, f"{b.arm.name}_ik", options.folder))]
    if flags in b.newton:
        for mode in ("clik", "lean", "leaner"):
            words = [
                str(w) for w in (b.newton[flags].path, mode, b.chain, files.metres, files.guesses, out, 1)
            ]
            title = f"pinocchio C++, {newton.MODES[mode]}, {' '.join(flags)}"
            found.append((title, count(words, "solve_one", options.folder)))
    return found


def count(words: list[str], function: str, folder: Path) -> float:
    """Instructions a pose between entering and leaving ``function``."""
    log = folder / "callgrind.out"
    run(
        [
            "valgrind",
            "--tool=callgrind",
            f"--toggle-collect={function}",
            f"--callgrind-out-file={log}",
            *words,
        ]
    )
    total = re.search(r"^(?:totals|summary): (\d+)", log.read_text(), re.MULTILINE)
    if total is None:
        raise RuntimeError(f"{log}: found no total, expected one of callgrind's")
    return int(total.group(1)) / COUNTED
