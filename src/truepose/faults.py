"""What is said when nothing else has said it: one line and an exit code for whatever comes out of a command.

Signals, a full disk, too little memory, and faults of our own, which leave a report in a file.
"""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from truepose.errors import TrueposeError
from truepose.stopping import stopping
from truepose.version import VERSION

FAULT, BAD_INPUT = 1, 2
REPORTED = ("casadi", "numpy", "scipy")
"""Packages whose versions a report names."""


def main(run: Callable[[], object]) -> None:
    """Run a program to its end, signals included, and leave with its exit code."""
    code = FAULT
    try:
        stopping.listen()
        for stream in (sys.stdout, sys.stderr):
            if hasattr(stream, "reconfigure"):  # a name or a unit that the terminal has no letters for
                stream.reconfigure(errors="backslashreplace")
        code = ended(run)
        stopping.over()  # here too: until it has ended a signal is heard
    except KeyboardInterrupt:
        code = stopped()
        stopping.over()
    _flushed()
    sys.exit(code)


def ended(run: Callable[[], object]) -> int:
    """Run it; its exit code, after one line on standard error where it did not come to its end."""
    try:
        code = run()
    except SystemExit as exc:
        if isinstance(exc.__context__, BrokenPipeError):
            return 0  # nobody reads on, which is no fault
        code = exc.code
    except BaseException as exc:
        return _told(exc)
    return code if isinstance(code, int) else 0


def stopped() -> int:
    """Say that it was stopped, and what stands; the exit code."""
    say(stopping.told())
    return stopping.code


def say(message: str) -> None:
    """One line on standard error, if anybody can read it."""
    with contextlib.suppress(OSError, ValueError, AttributeError):  # full, closed, or none from the beginning
        sys.stderr.write("error: " + " ".join(message.splitlines()) + "\n")
        sys.stderr.flush()


def _told(exc: BaseException) -> int:
    if stopping.number or isinstance(exc, KeyboardInterrupt):
        return stopped()  # also where compiled code or an import made something else of the interruption
    if isinstance(exc, BrokenPipeError):
        return 0
    words = in_words(exc)
    if words is None:
        _reported(exc)
        return FAULT
    say(words)
    return BAD_INPUT


def in_words(exc: BaseException) -> str | None:
    """What a user can mend, in words; None for a fault of our own."""
    if isinstance(exc, TrueposeError):
        return str(exc)
    if isinstance(exc, MemoryError) or "bad_alloc" in str(exc):
        size = f" ({exc})" if str(exc) and "bad_alloc" not in str(exc) else ""
        return f"needs more memory than this process may have{size}; expected fewer rows, poses or parameters at once"
    if isinstance(exc, RecursionError):
        return "found levels nested deeper than can be followed, expected a file or a mechanism with fewer"
    if isinstance(exc, OSError) and exc.errno is not None:
        return of_system(exc)
    return None


def of_system(exc: OSError, place: object = None) -> str:
    """What the system would not do, and where."""
    where = place if place is not None else exc.filename
    if where is None:
        return f"the system says: {reason(exc)}"
    return f"{os.fsdecode(where) if isinstance(where, bytes) else where}: {reason(exc)}"


def reason(exc: OSError) -> str:
    """Why the system would not do it. Of a working directory that is gone it says no more than that something is missing."""
    named = exc.filename if isinstance(exc.filename, str | bytes) else ""
    if exc.errno == errno.ENOENT and not Path(os.fsdecode(named)).is_absolute():
        try:
            os.getcwd()  # noqa: PTH109 -- the call that fails
        except OSError:
            return "found no working directory, for it was deleted; expected one that is there: cd to another"
    return exc.strerror or str(exc) or type(exc).__name__


def _reported(exc: BaseException) -> None:
    what = " ".join(f"{type(exc).__name__}: {exc}".split())
    what = what if len(what) <= 200 else f"{what[:200]} ..."
    where = _report(exc)
    say(
        f"a fault of truepose, not of your files ({what}); "
        + (f"please send the report {where}" if where else "no report of it could be written")
        + f"; it comes again with: {_command(sys.argv)}"
    )


def _report(exc: BaseException) -> Path | None:
    """Write what is needed to find the fault into a file of the folder for temporary ones."""
    import platform
    import tempfile
    import time
    import traceback

    lines = [
        f"truepose {VERSION}, Python {platform.python_version()}, {platform.platform()}",
        ", ".join(f"{name} {_version(name)}" for name in REPORTED),
        f"command: {_command(sys.argv)}",
        "",
        *traceback.format_exception(exc),
    ]
    start = time.strftime("truepose-fault-%Y%m%d-%H%M%S-")
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix=start, suffix=".txt", delete=False, encoding="utf-8", errors="backslashreplace"
        ) as stream:
            stream.write("\n".join(lines))
    except OSError:
        return None
    return Path(stream.name)


def _version(package: str) -> str:
    from importlib import metadata

    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"


def _command(words: Sequence[str]) -> str:
    import shlex

    return shlex.join(["truepose", *words[1:]])


def _flushed() -> None:
    """Let what nobody takes any more be forgotten: Python would tell of it once more when it ends."""
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except (OSError, ValueError):
            forget(stream)


def forget(stream: object) -> None:
    """Let a stream lead nowhere."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())  # type: ignore[attr-defined]
        os.close(nowhere)


__all__ = [
    "BAD_INPUT",
    "FAULT",
    "ended",
    "forget",
    "in_words",
    "main",
    "of_system",
    "reason",
    "say",
    "stopped",
]
