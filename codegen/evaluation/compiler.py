"""The system's C compiler, as the user names it: found, asked for its version, and run for a bounded time.

A compiler is a program of its own: it may hang, write anything, or leave others behind that hold its output open. All that
it can do here is to make no library, which ``NotCompiledError`` then says in one line.
"""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

COMPILERS = ("cc", "gcc", "clang")
TO_ANSWER = 20.0
"""Seconds in which a compiler says its version: it takes a hundredth of one."""
TO_START = 60.0
"""Seconds that compiling may take, and beside them"""
A_LETTER = 2e-4
"""seconds for each letter of C, ten times as many as a slow processor needs."""
_SAID = 60_000
"""Most bytes that are read of what a compiler writes."""
_FLOOD = 20_000_000
"""Bytes after which a compiler that goes on writing is ended: a disk may be full in a minute."""
_LOOK = 0.1
"""Seconds from one look at what it has written to the next."""
_LONGEST = 200


class NotCompiledError(Exception):
    """There is no compiled function; the text says why."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler: its path, what it says of its version, and what stands between it and the flags (``-m64``)."""

    path: str
    version: str
    arguments: tuple[str, ...] = ()

    def build(self, sources: Mapping[str, str], flags: Sequence[str], library: Path) -> None:
        """Write the library of C texts by file name, which are put beside it; those named ``*.c`` are compiled.

        Raises NotCompiledError with the first thing the compiler has to say. One that did not end is not asked again.
        """
        if self in _HANGING:
            raise NotCompiledError(_HANGING[self])
        files = {library.parent / name: text for name, text in sources.items()}
        units = [str(path) for path in files if path.suffix == ".c"]
        command = [self.path, *self.arguments, *flags, *units, "-lm", "-o", str(library)]
        try:
            for path, text in files.items():
                path.write_text(text, encoding="utf-8", newline="\n")
            code, _, said = _run(command, TO_START + A_LETTER * sum(map(len, sources.values())))
        except OSError as exc:
            raise NotCompiledError(f"{self.path} failed: {exc}") from None
        except subprocess.TimeoutExpired as exc:
            _HANGING[self] = f"{self.path} failed: found no end after {exc.timeout:.0f} s"
            raise NotCompiledError(_HANGING[self]) from None
        if code != 0:
            lines = said.splitlines()
            first = next((line for line in lines if "error" in line), next(iter(lines), ""))
            raise NotCompiledError(f"{self.path} failed: {_one_line(first) or f'exit code {code}'}")
        if not library.is_file() or library.is_symlink():  # not a pipe either, which would be waited for
            raise NotCompiledError(f"{self.path} failed: it wrote no library")


_HANGING: dict[Compiler, str] = {}
"""Compilers that did not end, and what was said of them."""


def compiler_of(asked: str | None, path: str) -> Compiler:
    """The compiler that is ``asked`` for, a program with or without arguments, or the first known one on the PATH.

    Raises NotCompiledError where there is none; the same every time, so that one that hangs is waited for once.
    """
    found = _found(asked, path)
    if isinstance(found, str):
        raise NotCompiledError(found)
    return found


@cache
def _found(asked: str | None, path: str) -> Compiler | str:
    """The compiler, or why there is none."""
    if asked is None:
        known = next((found for name in COMPILERS if (found := shutil.which(name, path=path))), None)
        return _asked(known, ()) if known else f"found no C compiler ({', '.join(COMPILERS)})"
    if not asked.strip():
        return "TRUEPOSE_CC is empty"
    whole = shutil.which(asked, path=path)
    if whole:  # a path may have spaces in it
        return _asked(whole, ())
    try:
        program, *arguments = shlex.split(asked)
    except ValueError as exc:
        return f"TRUEPOSE_CC: found {_one_line(asked)}, expected a compiler and its arguments: {exc}"
    found = shutil.which(program, path=path)
    return (
        _asked(found, tuple(arguments))
        if found
        else f"found no C compiler ({_one_line(program)}{_why(program)})"
    )


def _why(program: str) -> str:
    """What stands where a compiler was said to be."""
    with suppress(OSError, ValueError):
        if Path(program).is_dir():
            return ", a folder"
        if Path(program).exists():
            return ", a file that may not be run"
    return ""


def _asked(path: str, arguments: tuple[str, ...]) -> Compiler | str:
    """A compiler that has said its version, or why it has not."""
    try:
        code, told, _ = _run([path, *arguments, "--version"], TO_ANSWER)
    except (OSError, ValueError) as exc:
        return f"{path} --version failed: {exc}"
    except subprocess.TimeoutExpired:
        return f"{path} --version failed: found no end after {TO_ANSWER:.0f} s"
    return Compiler(path, told, arguments) if code == 0 else f"{path} --version failed: exit code {code}"


def _run(command: Sequence[str], seconds: float) -> tuple[int, str, str]:
    """Exit code, output and errors of a program that is given so many seconds, with all that it started.

    It writes to files: a pipe would stay open, and be waited for, as long as anything that it started has it. Raises OSError
    for one that cannot be run, and TimeoutExpired.
    """
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        program = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=err, start_new_session=True
        )
        try:
            code = _waited(program, seconds, (out.fileno(), err.fileno()))
        except BaseException:  # also where the user interrupts
            _end(program)
            raise
        texts = []
        for file in (out, err):
            file.seek(0)
            texts.append(file.read(_SAID).decode("utf-8", "replace"))
        return code, texts[0], texts[1]


def _waited(program: subprocess.Popen[bytes], seconds: float, files: Sequence[int]) -> int:
    """The exit code. Raises TimeoutExpired, and OSError for a program that fills its files."""
    last = time.monotonic() + seconds
    while True:
        with suppress(subprocess.TimeoutExpired):
            return program.wait(min(_LOOK, max(0.0, last - time.monotonic())))
        if time.monotonic() >= last:
            raise subprocess.TimeoutExpired(program.args, seconds)
        if max(os.fstat(file).st_size for file in files) > _FLOOD:
            raise OSError("it writes without end")


def _end(program: subprocess.Popen[bytes]) -> None:
    """End a program and the others of its group."""
    if os.name == "posix":
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(program.pid, signal.SIGKILL)
    program.kill()
    program.wait()


def _one_line(text: str) -> str:
    """A text of others as it may stand in a message."""
    return "".join(letter if letter.isprintable() else "?" for letter in text.strip())[:_LONGEST]
