"""Shared libraries kept on disk by what they were made of, for one user and any number of processes.

A library's name holds the key of its making and a digest of its content: a file that was cut short or spoilt is noticed
before it is loaded, and made again.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from truepose.publication import claimed, clear

MOST = 500
"""Libraries kept; the ones not used for longest go first."""


@dataclass(frozen=True)
class LibraryCache:
    """A folder of libraries that only this user may write to; None where there is no such folder: then nothing is kept."""

    folder: Path | None

    def load(self, key: str, build: Callable[[Path], None]) -> ctypes.CDLL:
        """The library kept under a key (hexadecimal); where there is none, ``build`` writes it to the path it is given.

        Raises OSError when the new library cannot be loaded, and what ``build`` raises.
        """
        found = self._kept(key)
        if found is not None:
            return found
        with self._workplace() as work:
            fresh = work / "new.so"
            build(fresh)
            library = ctypes.CDLL(
                str(fresh)
            )  # what does not load is not kept; it stays loaded when its file moves
            if self.folder is not None:
                fresh.replace(self.folder / f"{key}-{_digest(fresh)}.so")
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

    def _kept(self, key: str) -> ctypes.CDLL | None:
        for path in sorted(self.folder.glob(f"{key}-*.so")) if self.folder else []:
            with suppress(OSError):
                if path.stem.removeprefix(f"{key}-") == _digest(path) and _is_private(path):
                    library = ctypes.CDLL(str(path))
                    os.utime(path)
                    return library
            with suppress(OSError):
                path.unlink()
        return None

    def _prune(self) -> None:
        assert self.folder is not None
        with suppress(OSError):  # another process may prune too
            libraries = sorted(self.folder.glob("*.so"), key=lambda path: path.stat().st_mtime)
            for path in libraries[:-MOST]:
                path.unlink(missing_ok=True)


def library_cache(environment: Mapping[str, str] = os.environ) -> LibraryCache:
    """The cache in TRUEPOSE_CACHE, else in truepose of XDG_CACHE_HOME or ~/.cache.

    A folder that another user may write to, or that cannot be made, is not used: it could hold anybody's code.
    """
    try:
        folder = _folder(environment)
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        probe = os.access(folder, os.W_OK | os.X_OK)
    except (OSError, RuntimeError):  # no home
        return LibraryCache(None)
    return LibraryCache(folder if probe and _is_private(folder) else None)


def _folder(environment: Mapping[str, str]) -> Path:
    own = environment.get("TRUEPOSE_CACHE")
    if own:
        return Path(own).expanduser().absolute()
    general = environment.get("XDG_CACHE_HOME")
    return (Path(general) if general else Path.home() / ".cache").absolute() / "truepose"


def _is_private(path: Path) -> bool:
    """Whether it is this user's and nobody else may write to it."""
    if os.name != "posix":
        return True
    found = path.stat()
    return found.st_uid == os.getuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:32]


__all__ = ["LibraryCache", "library_cache"]
