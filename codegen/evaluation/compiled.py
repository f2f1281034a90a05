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
import signal
import stat
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

_OTHERS = stat.S_IWGRP | stat.S_IWOTH
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
"""A link or a pipe in place of a library is neither followed nor waited for."""
MOST = 500
"""Libraries kept; the ones not used for longest go first."""


@dataclass(frozen=True)
class LibraryCache:
    """A folder of libraries that only this user may write to; None where there is no such folder: then nothing is kept."""

    folder: Path | None

    def load(self, key: str, build: Callable[[Path], None], functions: Sequence[str] = ()) -> ctypes.CDLL:
        """The library kept under a key (hexadecimal); where there is none, ``build`` writes it to the path it is given.

        ``functions`` must be in it. Raises OSError when the new library cannot be loaded, and what ``build`` raises.
        """
        found = self._kept(key, functions)
        if found is not None:
            return found
        with tempfile.TemporaryDirectory(dir=self.folder, prefix=".truepose-") as work:
            fresh = Path(work) / "new.so"
            build(fresh)
            library = _loaded(
                fresh, functions
            )  # what does not load is not kept; it stays loaded when its file moves
            if self.folder is not None:
                fresh.chmod(0o700)  # whatever the compiler, or the user's mask, would have it
                fresh.replace(self.folder / f"{key}-{_digest(fresh.read_bytes())}.so")
                self._prune()
        return library

    def _kept(self, key: str, functions: Sequence[str]) -> ctypes.CDLL | None:
        for path in sorted(self.folder.glob(f"{key}-*.so")) if self.folder else []:
            with suppress(OSError):
                content = _private_bytes(path)
                if path.stem.removeprefix(f"{key}-") == _digest(content):
                    library = self._loaded_copy(content, functions)
                    os.utime(path)
                    return library
            with suppress(OSError):
                path.unlink()
        return None

    def _loaded_copy(self, content: bytes, functions: Sequence[str]) -> ctypes.CDLL:
        """A library from its bytes: those that were looked at, whatever became of the file in between."""
        with tempfile.TemporaryDirectory(dir=self.folder, prefix=".load-") as work:
            copy = Path(work) / "kept.so"
            copy.write_bytes(content)
            return _loaded(copy, functions)

    def _prune(self) -> None:
        assert self.folder is not None
        with suppress(OSError):  # another process may prune too
            libraries = sorted(self.folder.glob("*.so"), key=lambda path: path.stat().st_mtime)
            for path in libraries[:-MOST]:
                path.unlink(missing_ok=True)


def library_cache(environment: Mapping[str, str] = os.environ) -> LibraryCache:
    """The cache in TRUEPOSE_CACHE, else in truepose of XDG_CACHE_HOME or ~/.cache.

    A folder that another user may write to, or put another one in place of, and one that cannot be made, is not used: it
    could hold anybody's code. Links are followed first.
    """
    try:
        folder = _folder(environment)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder = folder.resolve(strict=True)
        safe = os.access(folder, os.W_OK | os.X_OK) and _is_private(folder.stat()) and _is_held(folder)
    except (OSError, RuntimeError):  # no home
        return LibraryCache(None)
    return LibraryCache(folder if safe else None)


def _folder(environment: Mapping[str, str]) -> Path:
    own = environment.get("TRUEPOSE_CACHE")
    if own:
        return Path(own).expanduser().absolute()
    general = environment.get("XDG_CACHE_HOME")
    return (Path(general) if general else Path.home() / ".cache").absolute() / "truepose"


def _is_private(found: os.stat_result) -> bool:
    """Whether it is this user's and nobody else may write to it."""
    if os.name != "posix":
        return True
    return found.st_uid == os.getuid() and not found.st_mode & _OTHERS


def _is_held(folder: Path) -> bool:
    """Whether nobody but this user and root may move the folder away: that is up to each folder above it."""
    if os.name != "posix":
        return True
    above = [parent.stat() for parent in folder.parents]
    return all(
        found.st_uid in (0, os.getuid()) and (not found.st_mode & _OTHERS or found.st_mode & stat.S_ISVTX)
        for found in above
    )


def _private_bytes(path: Path) -> bytes:
    """The content of a private file. Raises OSError for one that is not, or is none."""
    with os.fdopen(os.open(path, os.O_RDONLY | _NO_LINK), "rb") as file:
        found = os.fstat(file.fileno())
        if not stat.S_ISREG(found.st_mode) or not _is_private(found):
            raise PermissionError(f"{path}: others may write to it")
        return file.read()


def _loaded(path: Path, functions: Sequence[str]) -> ctypes.CDLL:
    """A library with these functions. Raises OSError where it is none, or has not all of them."""
    try:
        library = ctypes.CDLL(str(path))
    except OSError as exc:  # the path is another each time: said without it, it is said once
        raise OSError(str(exc).removeprefix(f"{path}: ")) from None
    for name in functions:
        if not hasattr(library, name):
            raise OSError(f"it has no function {name}")
    return library


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:32]


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


FLAGS = ("-std=c99", "-O2", "-march=native", "-fno-math-errno", "-shared", "-fPIC")
FUSED = {False: "-ffp-contract=off", True: "-ffp-contract=fast"}
_ONE = "source.c"


def load(
    source: str | Mapping[str, str], functions: Sequence[str] = (), *, fused: bool = False
) -> ctypes.CDLL:
    """The library of a C text, or of several by file name, ``*.c`` and the headers that they include by these names.

    ``functions`` must be in it. ``TRUEPOSE_CC`` names the compiler, with arguments or without, or none where it is empty.
    ``fused`` lets products be added without rounding, faster, but not digit for digit as CasADi does. Raises NotCompiledError.
    """
    flags = (*FLAGS, FUSED[fused])
    compiler = compiler_of(os.environ.get("TRUEPOSE_CC"), os.environ.get("PATH", ""))
    sources = {_ONE: source} if isinstance(source, str) else source
    texts = [part for item in sources.items() for part in item]
    making = "\0".join([*texts, compiler.path, *compiler.arguments, compiler.version, *flags, _processor()])
    key = hashlib.sha256(making.encode()).hexdigest()[:40]
    try:
        return library_cache().load(key, lambda path: compiler.build(sources, flags, path), functions)
    except OSError as exc:
        raise NotCompiledError(f"what {compiler.path} made cannot be loaded: {exc}") from None


@cache
def _processor() -> str:
    """What ``-march=native`` depends on: a cache may be shared by unlike machines."""
    told = [platform.machine(), platform.processor()]
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text(encoding="utf-8", errors="replace").splitlines()
        told += sorted(
            {line for line in lines if line.startswith(("flags", "Features", "model name", "CPU part"))}
        )
    return "\n".join(told)
