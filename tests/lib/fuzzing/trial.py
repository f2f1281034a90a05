"""One command with one hostile file, in a process of its own, and what of the promise it broke.

The promise: done (exit code 0), or one line that begins with ``error:`` (2, or 3 where a fit did not converge) and nothing
written; within ``MEGABYTES``; never a traceback or a warning of Python. Time is no part of it, but for what hangs.
"""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

MEGABYTES = 2048.0
LONGEST = 2000
"""Characters of that line."""
PATIENCE = 600.0
"""Seconds by the clock after which a command hangs, and is killed: far beyond what any takes on a busy machine."""
REFUSED = (2, 3)
VERDICT = "wrong"
"""How what ``check`` finds wrong begins, which is its result."""


@dataclass(frozen=True)
class Outcome:
    """What came of a command; ``fault`` is empty where the promise was kept."""

    code: int
    seconds: float
    megabytes: float
    said: str
    fault: str

    @property
    def accepted(self) -> bool:
        """Whether the command did its work."""
        return self.code == 0


def attempt(arguments: Sequence[str], folder: Path) -> Outcome:
    """Run a command of truepose in a copy of this process whose working directory is ``folder``.

    What it writes belongs below ``folder/out``, which is emptied first.
    """
    shutil.rmtree(folder / "out", ignore_errors=True)
    (folder / "out").mkdir()
    child = os.fork()
    if child == 0:
        _become(arguments, folder)
    status, used = _waited(child)
    said = (folder / "said").read_text(encoding="utf-8", errors="replace")
    code = os.waitstatus_to_exitcode(status)
    seconds, megabytes = used.ru_utime + used.ru_stime, used.ru_maxrss / 1024
    written = sorted(path.name for path in (folder / "out").iterdir())
    told = arguments[0] == "check" and (folder / "printed").read_text(errors="replace").startswith(VERDICT)
    kept = "to be looked at" in said  # a fit that is no calibration is written, and marked
    fault = _fault(code, said, [] if kept else written, megabytes, lines=0 if told else 1)
    return Outcome(code, seconds, megabytes, said, fault)


def _become(arguments: Sequence[str], folder: Path) -> None:
    """Turn this process into the command; never returns."""
    code = 1
    try:
        os.setsid()
        os.chdir(folder)
        for stream, name in ((1, "printed"), (2, "said")):
            os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), stream)
        resource.setrlimit(resource.RLIMIT_DATA, (int(3 * MEGABYTES) << 20, resource.RLIM_INFINITY))
        from truepose.__main__ import main

        sys.argv = ["truepose", *arguments]
        sys.stdout, sys.stderr = os.fdopen(1, "w"), os.fdopen(2, "w")
        code = _code(main)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _code(main: object) -> int:
    assert callable(main)
    try:
        main()
    except SystemExit as exc:
        return exc.code if isinstance(exc.code, int) else 0 if exc.code is None else 1
    except BaseException:
        import traceback

        traceback.print_exc()
        return 1
    return 0


def _waited(child: int) -> tuple[int, resource.struct_rusage]:
    """How a child ended and what it used; it is killed where it does not end."""
    until = time.monotonic() + PATIENCE
    while time.monotonic() < until:
        pid, status, used = os.wait4(child, os.WNOHANG)
        if pid:
            return status, used
        time.sleep(0.002)
    os.killpg(child, signal.SIGKILL)
    _, status, used = os.wait4(child, 0)
    return status, used


def _fault(code: int, said: str, written: Sequence[str], megabytes: float, lines: int) -> str:
    """The first part of the promise that was broken; ``lines``: of errors that a refusal has."""
    told = [line for line in said.splitlines() if line.startswith("error:")]
    rules = (
        (code < 0, f"killed by signal {-code}"),
        ("Traceback" in said, "a traceback"),
        (code not in (0, *REFUSED), f"exit code {code}"),
        ("Warning:" in said, "a warning"),
        (megabytes > MEGABYTES, f"{megabytes:.0f} MB"),
        (code in REFUSED and len(told) != lines, "not one line"),
        (max(map(len, said.splitlines()), default=0) > LONGEST, "a long line"),
        (code in REFUSED and bool(written), f"refused, yet wrote {', '.join(written)}"),
    )
    return next((text for broken, text in rules if broken), "")


__all__ = ["MEGABYTES", "Outcome", "attempt"]
