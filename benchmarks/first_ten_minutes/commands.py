"""truepose's commands in processes of their own, timed; the command is that of this interpreter."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

MAIN = "from truepose.cli import main; main()"
TIMEOUT = 600.0


@dataclass(frozen=True)
class Done:
    """One command: what it was, its exit code, seconds, what it printed on both streams."""

    words: tuple[str, ...]
    exit: int
    seconds: float
    printed: str
    complained: str

    @property
    def text(self) -> str:
        """Both streams."""
        return f"{self.printed}\n{self.complained}"


def run(folder: Path, *words: str | Path) -> Done:
    """``truepose words`` in ``folder``."""
    told = tuple(str(w) for w in words)
    start = time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-P", "-c", MAIN, *told],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    return Done(told, done.returncode, time.perf_counter() - start, done.stdout, done.stderr)
