"""C texts to functions of this process: compiled by the system's C compiler for this processor, and kept.

``load`` gives the library of a C text, or of several files, from the cache, or compiles it. ``NotCompiledError`` says why
there is none.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import stat
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

COMPILERS = ("cc", "gcc", "clang")
SECONDS = 600.0
"""Most time that a compiler is given."""
FLAGS = ("-std=c99", "-O2", "-march=native", "-fno-math-errno", "-shared", "-fPIC")
FUSED = {False: "-ffp-contract=off", True: "-ffp-contract=fast"}
MOST = 500
"""Libraries kept; the ones not used for longest go first."""
_OTHERS = stat.S_IWGRP | stat.S_IWOTH
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
    compiler, version = compiler_of(os.environ.get("TRUEPOSE_CC"), os.environ.get("PATH", ""))
    command = [*compiler, *FLAGS, FUSED[fused]]
    making = "\0".join(
        [*(part for item in sources.items() for part in item), *command, version, _processor()]
    )
    key, folder = hashlib.sha256(making.encode()).hexdigest()[:40], cache_folder()
    kept = None if folder is None else folder / f"{key}.so"
    if kept is not None and kept.is_file():
        with suppress(OSError):
            library = _opened(kept, functions)
            os.utime(kept)
            return library
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".truepose-") as work:
            fresh = Path(work) / "new.so"
            _build(command, sources, fresh)
            library = _opened(fresh, functions)  # it stays loaded when its file moves
            if kept is not None:
                fresh.replace(kept)
                _prune(kept.parent)
        return library
    except OSError as exc:
        raise NotCompiledError(f"what {compiler[0]} made cannot be loaded: {exc}") from None


def cache_folder(environment: Mapping[str, str] = os.environ) -> Path | None:
    """The folder of libraries in TRUEPOSE_CACHE, else in truepose of XDG_CACHE_HOME or ~/.cache; None where it is not safe.

    A folder that another user may write to, or put another one in place of, could hold anybody's code.
    """
    own, general = environment.get("TRUEPOSE_CACHE"), environment.get("XDG_CACHE_HOME")
    try:
        folder = Path(own).expanduser() if own else Path(general or Path.home() / ".cache") / "truepose"
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve(strict=True)
        return folder if os.access(folder, os.W_OK | os.X_OK) and _is_private(folder) else None
    except (OSError, RuntimeError):  # no home
        return None


def _is_private(folder: Path) -> bool:
    """Whether this user alone may write to a folder, and nobody but root may move it away."""
    if os.name != "posix":
        return True
    here, above = folder.stat(), [parent.stat() for parent in folder.parents]
    held = all(
        found.st_uid in (0, os.getuid()) and (not found.st_mode & _OTHERS or found.st_mode & stat.S_ISVTX)
        for found in above
    )
    return held and here.st_uid == os.getuid() and not here.st_mode & _OTHERS


def _prune(folder: Path) -> None:
    with suppress(OSError):  # another process may prune too
        for path in sorted(folder.glob("*.so"), key=lambda path: path.stat().st_mtime)[:-MOST]:
            path.unlink(missing_ok=True)


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
    code, _, said = _run([*command, *units, "-lm", "-o", str(library)])
    if code != 0:
        lines = said.splitlines()
        first = next((line for line in lines if "error" in line), next(iter(lines), ""))
        raise NotCompiledError(f"{command[0]} failed: {_one_line(first) or f'exit code {code}'}")


def compiler_of(asked: str | None, path: str) -> tuple[tuple[str, ...], str]:
    """The compiler that is ``asked`` for, a program with or without arguments, or the first known one; and its version.

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
    command = (found, *arguments)
    return command, _version(command)


@cache
def _version(command: tuple[str, ...]) -> str:
    code, told, _ = _run([*command, "--version"])
    if code != 0:
        raise NotCompiledError(f"{command[0]} --version failed: exit code {code}")
    return told


def _run(command: Sequence[str]) -> tuple[int, str, str]:
    """Exit code, output and errors of a program. Raises NotCompiledError for one that cannot be run, or does not end."""
    try:
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=SECONDS, check=False
        )
    except OSError as exc:
        raise NotCompiledError(f"{command[0]} failed: {exc}") from None
    except subprocess.TimeoutExpired:
        raise NotCompiledError(f"{command[0]} failed: found no end after {SECONDS:.0f} s") from None
    return done.returncode, done.stdout.decode("utf-8", "replace"), done.stderr.decode("utf-8", "replace")


def _one_line(text: str) -> str:
    """A text of others as it may stand in a message."""
    return "".join(letter if letter.isprintable() else "?" for letter in text.strip())[:_LONGEST]


@cache
def _processor() -> str:
    """What ``-march=native`` depends on: a cache may be shared by unlike machines."""
    told = [platform.machine(), platform.processor()]
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        told += sorted({x for x in lines if x.startswith(("flags", "Features", "model name", "CPU part"))})
    return "\n".join(told)
