"""Result files that are either whole or not there at all.

`atomic_file` for one file, `atomic_write_text` and `write_table` for what most files hold, `atomic_directory` for
several that belong together.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from truepose.errors import InputError
from truepose.publication import NEW, begun, claimed, clear, publish

if TYPE_CHECKING:
    import pandas as pd


@contextlib.contextmanager
def atomic_file(path: Path | str) -> Iterator[Path]:
    """A file to write; it is renamed over `path` when the block ends without an exception.

    A link is followed; what is no regular file (a pipe, a terminal) is written to directly. Raises
    InputError when it cannot be written; an older file then stays as it was.
    """
    target = Path(path).resolve()
    if target.exists() and not (target.is_file() or target.is_dir()):
        yield target
        return
    if target.is_dir():
        raise InputError(f"{path}: cannot write the file: Is a directory")
    with _naming(path, "file"), claimed(target, Path.touch) as unfinished:
        try:
            yield unfinished
            unfinished.replace(target)
            clear(target, unfinished)
        finally:
            unfinished.unlink(missing_ok=True)


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
    target = Path(path).resolve()
    if target.exists() and not target.is_dir():
        raise InputError(f"{path}: expected a directory, found a file")
    made = [parent for parent in target.parents if not parent.exists()]  # nearest first
    published = False
    try:
        with contextlib.ExitStack() as claims:
            with _naming(path, "directory"):
                stage = claims.enter_context(claimed(target, partial(Path.mkdir, parents=True)))
                (stage / NEW).mkdir()
            try:
                yield stage / NEW
                with _naming(path, "directory"):
                    publish(stage, target)
                published = True
            finally:
                if not begun(stage):
                    shutil.rmtree(stage, ignore_errors=True)
    finally:
        for parent in [] if published else made:
            with contextlib.suppress(OSError):
                parent.rmdir()


@contextlib.contextmanager
def _naming(path: Path | str, kind: str) -> Iterator[None]:
    try:
        yield
    except OSError as exc:
        raise InputError(f"{path}: cannot write the {kind}: {exc.strerror}") from exc
