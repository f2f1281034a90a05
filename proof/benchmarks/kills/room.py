"""A command in a process of its own that is sent a signal: forked from one that has loaded all libraries."""

from __future__ import annotations

import os
import shutil
import signal
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from truepose import faults
from truepose.cli import app

from .cases import Case, Seen, seen

PATIENCE = 120.0
"""Seconds for a command."""
HEARD = (signal.SIGINT, signal.SIGTERM)


@dataclass(frozen=True)
class Ended:
    """How a process ended: exit code (below 0 the signal), seconds from its start, and from the signal, and what it said."""

    code: int
    lasted: float
    after: float
    said: str


def make_room(folder: Path, inputs: Path, before: Path | None) -> None:
    """A folder with the inputs, and the old result where there is one."""
    folder.mkdir()
    (folder / "in").symlink_to(inputs)
    (folder / "temporary").mkdir()
    if before is None:
        (folder / "out").mkdir()
    else:
        shutil.copytree(before / "out", folder / "out", symlinks=True)


def run(
    case: Case, n: int, folder: Path, *, after: float | None = None, number: int = signal.SIGKILL
) -> Ended:
    """Run the command there; send it the signal after so many seconds."""
    (folder / "said").touch()
    sys.stdout.flush()  # what a fork holds is written twice
    start = time.perf_counter()
    signal.pthread_sigmask(signal.SIG_BLOCK, HEARD)  # until the command itself hears them
    process = os.fork()
    if process == 0:
        _child(case, n, folder)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, HEARD)
    sent = start
    if after is not None:
        code = _wait(process, start + after)
        if code is None:
            os.kill(process, number)
        sent = time.perf_counter()
        code = _wait(process, sent + PATIENCE) if code is None else code
    else:
        code = _wait(process, start + PATIENCE)
    if code is None:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)
        raise TimeoutError(f"{case.name}: goes on after {PATIENCE:g} s")
    now = time.perf_counter()
    return Ended(code, now - start, now - sent, (folder / "said").read_text(encoding="utf-8"))


def _wait(process: int, until: float) -> int | None:
    """The exit code, if the process ends by then."""
    while True:
        found, status = os.waitpid(process, os.WNOHANG)
        if found:
            return os.waitstatus_to_exitcode(status)
        left = until - time.perf_counter()
        if left <= 0:
            return None
        time.sleep(min(left, 0.002))


def _child(case: Case, n: int, folder: Path) -> None:
    code = 70
    try:
        os.setsid()
        os.chdir(folder)
        os.environ.update(TMPDIR=str(folder / "temporary"), TRUEPOSE_CACHE=str(folder.parent / "cache"))
        tempfile.tempdir = None  # known from before the fork
        for stream, name in ((1, "told"), (2, "said")):
            place = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(place, stream)
        sys.stdout, sys.stderr = (os.fdopen(os.dup(k), "w", encoding="utf-8", buffering=1) for k in (1, 2))
        sys.argv = ["truepose", *case.arguments(n)]
        faults.main(lambda: _command(case))
    except SystemExit as exc:
        code = exc.code if isinstance(exc.code, int) else 0
    finally:
        os._exit(code)


def _command(case: Case) -> object:
    signal.pthread_sigmask(signal.SIG_UNBLOCK, HEARD)
    return app() if case.run is None else case.run(sys.argv[1:])


def result(folder: Path) -> Seen:
    """What a reader finds."""
    return seen(folder / "out")


def everything(folder: Path) -> set[str]:
    """All names in a room, hidden ones too; not what streams were written to."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")} - {"told", "said"}


__all__ = ["Ended", "everything", "make_room", "result", "run"]
