"""C texts to functions of this process: compiled by the system's C compiler for this processor, once.

``load`` gives the library of a C text, or of several files. ``NotCompiledError`` says why there is none.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

COMPILERS = ("cc", "gcc", "clang")
SECONDS = 600.0
"""Most time that a compiler is given."""
FLAGS = ("-std=c99", "-O2", "-march=native", "-fno-math-errno", "-shared", "-fPIC")
FUSED = {False: "-ffp-contract=off", True: "-ffp-contract=fast"}
_LONGEST = 200


class NotCompiledError(Exception):
    """There is no compiled function; the text says why."""


def load(
    source: str | Mapping[str, str], functions: Sequence[str] = (), *, fused: bool = False
) -> ctypes.CDLL:
    """The library of a C text, or of several by file name, ``*.c`` and the headers that they include by these names.

    ``functions`` must be in it. ``TRUEPOSE_CC`` names the compiler, with arguments or without, or none where it is empty.
    ``fused`` lets products be added without rounding, faster, but not digit for digit as CasADi does. Raises NotCompiledError.
    """
    sources = {"source.c": source} if isinstance(source, str) else source
    compiler = compiler_of(os.environ.get("TRUEPOSE_CC"), os.environ.get("PATH", ""))
    return _library((*compiler, *FLAGS, FUSED[fused]), tuple(sources.items()), tuple(functions))


@cache
def _library(
    command: tuple[str, ...], sources: tuple[tuple[str, str], ...], functions: tuple[str, ...]
) -> ctypes.CDLL:
    """The library that a command makes of texts by file name, compiled once in a process."""
    try:
        with tempfile.TemporaryDirectory(prefix="truepose-", ignore_cleanup_errors=True) as work:
            made = Path(work) / "made.so"
            _build(command, dict(sources), made)
            return _opened(made, functions)  # it stays loaded when its file goes
    except OSError as exc:
        raise NotCompiledError(f"what {command[0]} made cannot be loaded: {exc}") from None


def _opened(path: Path, functions: Sequence[str]) -> ctypes.CDLL:
    """A library with these functions. Raises OSError where it is none, or has not all of them."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError as exc:  # the path is another each time: without it, the reason is told once
        raise OSError(str(exc).removeprefix(f"{path}: ")) from None
    missing = [name for name in functions if not hasattr(library, name)]
    if missing:
        raise OSError(f"it has no function {missing[0]}")
    return library


def _build(command: Sequence[str], sources: Mapping[str, str], library: Path) -> None:
    """Write a library of C texts by file name. Raises NotCompiledError with the first thing the compiler has to say."""
    files = {library.parent / name: text for name, text in sources.items()}
    for path, text in files.items():
        path.write_text(text, encoding="utf-8", newline="\n")
    units = [str(path) for path in files if path.suffix == ".c"]
    code, said = _run([*command, *units, "-lm", "-o", str(library)])
    if code != 0:
        lines = said.splitlines()
        first = next((line for line in lines if "error" in line), next(iter(lines), ""))
        raise NotCompiledError(f"{command[0]} failed: {_one_line(first) or f'exit code {code}'}")


def compiler_of(asked: str | None, path: str) -> tuple[str, ...]:
    """The compiler that is ``asked`` for, a program with or without arguments, or the first known one.

    Raises NotCompiledError where there is none.
    """
    if asked is not None and not asked.strip():
        raise NotCompiledError("TRUEPOSE_CC is empty")
    if asked is None:
        names, arguments = list(COMPILERS), list[str]()
    elif shutil.which(asked, path=path):  # a path may have spaces in it
        names, arguments = [asked], []
    else:
        try:
            program, *arguments = shlex.split(asked)
        except ValueError as exc:
            expected = f"expected a compiler and its arguments: {exc}"
            raise NotCompiledError(f"TRUEPOSE_CC: found {_one_line(asked)}, {expected}") from None
        names = [program]
    found = next((whole for name in names if (whole := shutil.which(name, path=path))), None)
    if found is None:
        raise NotCompiledError(f"found no C compiler ({_one_line(', '.join(names))})")
    return found, *arguments


def _run(command: Sequence[str]) -> tuple[int, str]:
    """Exit code and errors of a program. Raises NotCompiledError for one that cannot be run, or does not end."""
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=SECONDS, check=False
        )
    except OSError as exc:
        raise NotCompiledError(f"{command[0]} failed: {exc}") from None
    except subprocess.TimeoutExpired:
        raise NotCompiledError(f"{command[0]} failed: found no end after {SECONDS:.0f} s") from None
    return done.returncode, done.stderr.decode("utf-8", "replace")


def _one_line(text: str) -> str:
    """A text of others as it may stand in a message."""
    return "".join(letter if letter.isprintable() else "?" for letter in text.strip())[:_LONGEST]
