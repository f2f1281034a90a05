"""Result files that are either whole or not there at all.

`atomic_file` for one file, `atomic_write_text` and `write_table` for what most files hold, `atomic_directory` for
several that belong together. Each file is written under a temporary name and then renamed. A process that is killed
while it renames several files leaves a folder with files of two runs; `sha256_of` lets a result name its files, so that
`mixed_files` can report such a folder. `read_input` reads files that are not too large.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

from truepose.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

FILES_SHA256 = "files_sha256"
"""Field of a result (JSON) that holds the SHA-256 of each file that belongs to it, by name."""
NAME_MAX = 255
"""Bytes of a name, on all usual systems."""


@contextlib.contextmanager
def atomic_file(path: Path | str) -> Iterator[Path]:
    """Yield a temporary file to write; rename it over `path` when the block ends without an exception.

    A link is followed; what is no regular file (a pipe, a terminal) is written to directly. Raises
    InputError when it cannot be written; an older file then stays as it was.
    """
    with _naming(path, "file"):
        target = _resolved(path)
        if target.is_dir():
            raise InputError(f"{path}: cannot write the file: Is a directory")
        if target.exists() and not target.is_file():
            yield target
            return
        unfinished = target.with_name(f".{uuid.uuid4().hex[:12]}.partial")
        try:
            unfinished.touch()
            yield unfinished
            unfinished.replace(target)
        finally:
            with contextlib.suppress(OSError):
                unfinished.unlink()


def atomic_write_text(path: Path | str, text: str) -> None:
    """Write a text file (UTF-8, line ends as given) as `atomic_file` does."""
    with atomic_file(path) as unfinished, unfinished.open("w", encoding="utf-8", newline="") as stream:
        stream.write(text)


def write_table(path: Path, frame: pd.DataFrame, comments: Iterable[str] = ()) -> None:
    """Write CSV, or Parquet by the file's ending; floats have full precision.

    ``comments`` stand above the header of a CSV; Parquet has no place for them.
    """
    if path.suffix.lower() in {".parquet", ".pq"}:
        with atomic_file(path) as unfinished:
            frame.to_parquet(unfinished, index=False)
        return
    head = "".join(f"# {line}\n" for line in comments)
    atomic_write_text(path, head + frame.to_csv(index=False, lineterminator="\n"))


@contextlib.contextmanager
def atomic_directory(path: Path | str, last: str = "") -> Iterator[Path]:
    """Yield an empty temporary folder to fill; move its files to `path` when the block ends without an exception.

    A directory that exists keeps its other files. The file called ``last`` is moved after all others. Raises
    InputError when `path` cannot be written; where the block fails, `path` is as it was.
    """
    with _naming(path, "directory"):
        target = _resolved(path)
        if target.exists() and not target.is_dir():
            raise InputError(f"{path}: expected a directory, found a file")
        made = [folder for folder in (target, *target.parents) if not folder.exists()]
        try:
            target.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".", suffix=".partial", dir=target) as name:
                with _renamed(Path(name), path):
                    yield Path(name)
                _move(Path(name), target, last)
        except BaseException:
            for folder in made:
                with contextlib.suppress(OSError):  # others have filled it meanwhile
                    folder.rmdir()
            raise


def _move(stage: Path, target: Path, last: str) -> None:
    """Move all files of one folder into another."""
    for place in (found := sorted(stage.rglob("*"), key=lambda file: (file.name == last, file))):
        to = target / place.relative_to(stage)
        if place.is_dir():
            to.mkdir(exist_ok=True)
        elif to.is_dir():
            raise InputError(f"{to}: expected a file, found a directory")
    for place in found:
        if not place.is_dir():
            place.replace(target / place.relative_to(stage))


def sha256_of(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each file of a folder, by name."""
    return {file.name: _digest(file) for file in sorted(folder.iterdir()) if file.is_file()}


def _digest(file: Path) -> str:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def mixed_files(result: Path) -> tuple[str, ...]:
    """Return the names of files beside a result (JSON) that are others than those that it was written with."""
    try:
        stated = json.loads(result.read_text(encoding="utf-8"))[FILES_SHA256].items()
        places = [(result.parent / name, digest) for name, digest in stated]
        return tuple(place.name for place, digest in places if place.is_file() and _digest(place) != digest)
    except (
        OSError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
    ):  # no result: who reads it reports that
        return ()


def mixture_notes(result: Path, name: str = "") -> tuple[str, ...]:
    """Return a note where files beside a result (all, or the one of this name) are not its own."""
    mixed = [found for found in mixed_files(result) if name in ("", found)]
    text = (
        f"{result.parent}: found {', '.join(mixed)} other than {result.name} was written with, expected files of one run; run"
        " it again unless you changed them"
    )
    return (text,) if mixed else ()


def check_place(path: Path | str, kind: Literal["file", "directory"]) -> None:
    """Raise InputError where nothing can be written, as far as that can be known before; leave no trace."""
    with _naming(path, kind):
        there, names = _resolved(path), list[str]()
        if there.exists() and not there.is_dir():
            if not there.is_file():  # a pipe or a device
                return
            there = there.parent
        while not there.exists():
            names.append(there.name)
            there = there.parent
        if not there.is_dir():
            raise NotADirectoryError(errno.ENOTDIR, f"{there} is no directory")
        if any(len(os.fsencode(name)) > NAME_MAX for name in names):
            raise OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG))
        tempfile.TemporaryFile(dir=there).close()


def _resolved(path: Path | str) -> Path:
    try:
        return Path(path).resolve()
    except RuntimeError:
        raise OSError(errno.ELOOP, os.strerror(errno.ELOOP)) from None
    except ValueError as exc:
        raise InputError(f"{str(path)!r}: found no name of a file: {exc}") from None


@contextlib.contextmanager
def _renamed(stage: Path, path: Path | str) -> Iterator[None]:
    """Let errors of the block name files where they are to be."""
    try:
        yield
    except InputError as exc:
        raise InputError(str(exc).replace(str(stage), str(path))) from exc
    except OSError as exc:
        if str(stage) not in str(exc.filename):
            raise
        name = str(exc.filename).replace(str(stage), str(path))
        raise InputError(f"{name}: cannot write the file: {reason(exc)}") from exc


@contextlib.contextmanager
def _naming(path: Path | str, kind: str) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise InputError(f"{path}: cannot write the {kind}: {reason(exc)}") from exc


def reason(exc: OSError) -> str:
    """Return why the system refused."""
    return exc.strerror or str(exc) or type(exc).__name__


FILE_BYTES: Final = 1 << 30
"""Bytes of an input file: 1 GiB."""


def check_input(path: Path) -> None:
    """Refuse what has no end, such as a device, and a file beyond the limit. Raises InputError."""
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise InputError(f"{path}: cannot read the file: expected a file, found a device or a pipe")
    if path.is_file() and path.stat().st_size > FILE_BYTES:
        raise InputError(
            f"{path}: cannot read the file: found {path.stat().st_size / 1e9:.2f} GB, "
            f"expected at most {FILE_BYTES / 1e9:.2f} GB"
        )


def read_input(path: Path) -> bytes:
    """Return the bytes of a file. Raises InputError as ``check_input``, OSError where it cannot be opened."""
    check_input(path)
    return path.read_bytes()
