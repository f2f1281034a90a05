"""Result files that are either whole or not there at all.

`atomic_write_text` for one file, `write_table` for one table, `atomic_directory` for several that belong together.
"""

from __future__ import annotations

import contextlib
import shutil
import uuid
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from truepose.errors import InputError

if TYPE_CHECKING:
    import pandas as pd


def _hidden_sibling(path: Path) -> Path:
    # a sibling, because a rename is atomic only inside one file system
    return path.with_name(f".{path.name}.{uuid.uuid4().hex[:12]}.partial")


def atomic_write_text(path: Path | str, text: str) -> None:
    """Write a text file (UTF-8, line ends as given) by renaming a finished one over it.

    A link is followed; what is no regular file (a pipe, a terminal) is written to directly. Raises
    InputError when it cannot be written; an older file then stays as it was.
    """
    target = Path(path).resolve()
    if target.exists() and not target.is_file() and not target.is_dir():
        target.write_text(text, encoding="utf-8")
        return
    partial = _hidden_sibling(target)
    try:
        with partial.open("w", encoding="utf-8", newline="") as stream:
            stream.write(text)
        partial.replace(target)
    except OSError as exc:
        raise InputError(f"{path}: cannot write the file: {exc.strerror}") from exc
    finally:
        partial.unlink(missing_ok=True)


def write_table(path: Path, frame: pd.DataFrame, comments: Iterable[str] = ()) -> None:
    """CSV, or Parquet by the file's ending; whole or not at all, floats at full precision.

    ``comments`` stand above the header of a CSV; Parquet has no place for them.
    """
    if path.suffix.lower() not in {".parquet", ".pq"}:
        head = "".join(f"# {line}\n" for line in comments)
        atomic_write_text(path, head + frame.to_csv(index=False, lineterminator="\n"))
        return
    target = path.resolve()
    partial = _hidden_sibling(target)
    try:
        frame.to_parquet(partial, index=False)
        partial.replace(target)
    except OSError as exc:
        raise InputError(f"{path}: cannot write the file: {exc.strerror}") from exc
    finally:
        partial.unlink(missing_ok=True)


@contextlib.contextmanager
def atomic_directory(path: Path | str) -> Iterator[Path]:
    """A directory to fill; its files reach `path` only when the block ends without an exception.

    Yields an empty temporary directory beside `path`. A directory that exists keeps its other files. On
    failure nothing is left behind. Raises InputError when `path` cannot be written.
    """
    target = Path(path).resolve()
    partial = _hidden_sibling(target)
    made = [parent for parent in target.parents if not parent.exists()]  # nearest first
    done = False
    try:
        if target.exists() and not target.is_dir():
            raise InputError(f"{path}: expected a directory, found a file")
        with _naming(path):
            partial.mkdir(parents=True)
        yield partial
        with _naming(path):
            _move(partial, target)
        done = True
    finally:
        shutil.rmtree(partial, ignore_errors=True)
        for parent in [] if done else made:
            with contextlib.suppress(OSError):
                parent.rmdir()


@contextlib.contextmanager
def _naming(path: Path | str) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise InputError(f"{path}: cannot write the directory: {exc.strerror}") from exc


def _move(source: Path, target: Path) -> None:
    if not target.exists():
        source.rename(target)
        return
    files = sorted(file for file in source.rglob("*") if not file.is_dir())
    for file in files:
        new = target / file.relative_to(source)
        if new.is_dir():  # found before the first rename, so that all files arrive or none
            raise InputError(f"{new}: expected a file, found a directory")
    for file in files:
        new = target / file.relative_to(source)
        new.parent.mkdir(parents=True, exist_ok=True)
        file.replace(new)
