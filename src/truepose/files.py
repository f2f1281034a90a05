"""Result files that are either whole or not there at all.

`atomic_file` for one file, `atomic_write_text` and `write_table` for what most files hold, `atomic_directory` for
several that belong together.
"""

from __future__ import annotations

import contextlib
import errno
import os
import uuid
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from truepose.errors import InputError
from truepose.faults import reason
from truepose.publication import NEW, claimed, clear, publish
from truepose.stopping import stopping

if TYPE_CHECKING:
    import pandas as pd


@contextlib.contextmanager
def atomic_file(path: Path | str) -> Iterator[Path]:
    """A file to write; it is renamed over `path` when the block ends without an exception.

    A link is followed; what is no regular file (a pipe, a terminal) is written to directly. Raises
    InputError when it cannot be written; an older file then stays as it was.
    """
    with _naming(path, "file"):
        _settle(Path(path))
        target = _resolved(path)
        if target.is_dir():
            raise InputError(f"{path}: cannot write the file: Is a directory")
        if target.exists() and not target.is_file():
            yield target
            return
        with claimed(target, Path.touch) as unfinished:
            yield unfinished
            with stopping.undisturbed():
                unfinished.replace(target)
                if not _inside(target):
                    stopping.written.append(str(target))
            clear(target, unfinished)


def atomic_write_text(path: Path | str, text: str) -> None:
    """Write a text file (UTF-8, line ends as given) as `atomic_file` does."""
    with atomic_file(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as stream:
        stream.write(text)


def write_table(path: Path, frame: pd.DataFrame, comments: Iterable[str] = ()) -> None:
    """CSV, or Parquet by the file's ending; whole or not at all, floats at full precision.

    ``comments`` stand above the header of a CSV; Parquet has no place for them.
    """
    if path.suffix.lower() in {".parquet", ".pq"}:
        with atomic_file(path) as unfinished:
            frame.to_parquet(unfinished, index=False)
        return
    head = "".join(f"# {line}\n" for line in comments)
    atomic_write_text(path, head + frame.to_csv(index=False, lineterminator="\n"))


@contextlib.contextmanager
def atomic_directory(path: Path | str) -> Iterator[Path]:
    """A directory to fill; its files reach `path`, all in one step, when the block ends without an exception.

    Yields an empty temporary directory. A directory that exists keeps its other files. On failure nothing is
    left behind; what a killed run left goes with the next one. Raises InputError when `path` cannot be written.
    """
    with _naming(path, "directory"):
        target = _resolved(path)
        if target.exists() and not target.is_dir():
            raise InputError(f"{path}: expected a directory, found a file")
        made = [parent for parent in target.parents if not parent.exists()]  # nearest first
        try:
            with claimed(target, partial(Path.mkdir, parents=True)) as stage:
                (stage / NEW).mkdir()
                with _renamed(stage / NEW, path):
                    yield stage / NEW
                publish(stage, target)
        finally:
            with stopping.undisturbed():
                for parent in made:
                    with contextlib.suppress(OSError):  # it is not empty where the result is in it
                        parent.rmdir()


def check_place(path: Path | str, kind: Literal["file", "directory"]) -> None:
    """Raise InputError where nothing can be written, as far as that can be known before: it leaves no trace."""
    with _naming(path, kind):
        target = _resolved(path)
        if target.exists() and not target.is_dir():
            if not target.is_file():  # a pipe or a device
                _check_access(target)
                return
            target = target.parent
        there, names = target, list[str]()
        while not there.exists():
            names.append(there.name)
            there = there.parent
        if not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{there} is no directory")
        if any(len(os.fsencode(name)) > NAME_MAX for name in names):
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
        _check_access(there)
        _try(there)


NAME_MAX = 255
"""Bytes of a name, on all usual systems."""


def _check_access(place: Path) -> None:
    if not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, f"no permission for {place}")


def _try(folder: Path) -> None:
    """Make a file without a name there; where a file system has none, a folder that goes at once."""
    with contextlib.suppress(OSError, AttributeError):
        os.close(os.open(folder, os.O_TMPFILE | os.O_WRONLY))
        return
    with stopping.undisturbed():
        tried = folder / f".{uuid.uuid4().hex[:12]}.partial"
        tried.mkdir()
        tried.rmdir()


def _resolved(path: Path | str) -> Path:
    try:
        return Path(path).resolve()
    except RuntimeError:
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP)) from None
    except ValueError as exc:
        raise InputError(f"{str(path)!r}: found no name of a file: {exc}") from None


def _settle(path: Path) -> None:
    """End what a killed run began to publish in the folder of this file: it may be one of several, and a link of them yet."""
    with contextlib.suppress(ValueError):
        folder = path.absolute().parent
        clear(folder, folder)


def _inside(path: Path) -> bool:
    """Whether a file is part of a result that is not published yet."""
    return any(part.endswith(".partial") for part in path.parts[:-1])


@contextlib.contextmanager
def _renamed(stage: Path, path: Path | str) -> Iterator[None]:
    """Let errors of the block name files where they are to be."""
    try:
        yield
    except InputError as exc:
        if str(stage) not in str(exc):
            raise
        raise InputError(str(exc).replace(str(stage), str(path))) from exc
    except OSError as exc:
        if exc.errno is None or str(stage) not in str(exc.filename):
            raise
        name = str(exc.filename).replace(str(stage), str(path))
        raise InputError(f"{name}: cannot write the file: {exc.strerror}") from exc


@contextlib.contextmanager
def _naming(path: Path | str, kind: str) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise InputError(f"{path}: cannot write the {kind}: {reason(exc)}") from exc
