"""Shared libraries kept on disk by what they were made of, for one user and any number of processes.

A library's name holds the key of its making and a digest of its content: a file that was cut short or spoilt is noticed
before it is loaded, and made again. What is loaded is a copy of the bytes that were looked at.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from truepose.publication import claimed, clear

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
        with self._workplace() as work:
            fresh = work / "new.so"
            build(fresh)
            library = _loaded(
                fresh, functions
            )  # what does not load is not kept; it stays loaded when its file moves
            if self.folder is not None:
                fresh.chmod(0o700)  # whatever the compiler, or the user's mask, would have it
                fresh.replace(self.folder / f"{key}-{_digest(fresh.read_bytes())}.so")
                self._prune()
        return library

    @contextmanager
    def _workplace(self) -> Iterator[Path]:
        """A folder to build in; those of processes that were killed go."""
        if self.folder is None:
            with tempfile.TemporaryDirectory(prefix="truepose-") as name:
                yield Path(name)
            return
        with claimed(self.folder, partial(Path.mkdir, mode=0o700)) as work:
            clear(self.folder, work)
            yield work

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
