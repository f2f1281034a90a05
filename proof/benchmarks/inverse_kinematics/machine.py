"""The machine this runs on and the commands that are timed on it: pinned to one core where `taskset` is found."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path


def pinned(arguments: Sequence[str | Path], core: int | None) -> str:
    """Standard output of a command on one core; a failure is a RuntimeError with its message."""
    taskset = shutil.which("taskset")
    words = [str(word) for word in arguments]
    if taskset and core is not None:
        words = [taskset, "-c", str(core), *words]
    return run(words)


def run(words: Sequence[str]) -> str:
    """Standard output of a command; a failure is a RuntimeError with its message."""
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(words)}: exit code {done.returncode}: {done.stderr.strip()[-2000:]}")
    return done.stdout


@cache
def tool(name: str) -> str | None:
    """Path of a program, None where there is none."""
    return shutil.which(name)


def processor() -> str:
    """Name of the processor and how many cores the system shows."""
    info = Path("/proc/cpuinfo")
    names = [
        line.split(":", 1)[1].strip()
        for line in (info.read_text().splitlines() if info.exists() else [])
        if line.startswith("model name")
    ]
    return f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores"


def compiler_version(name: str) -> str:
    """First line of what the compiler says of itself."""
    return run([name, "--version"]).splitlines()[0]
