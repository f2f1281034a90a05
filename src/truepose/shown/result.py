"""What results have in common: how they show themselves, and what they write.

A result is data on a low floor; its words, tables and pages are made above it. So the functions that need them are declared
here and implemented there, in modules called ``showing`` (`truepose.leaves`), which are loaded when somebody looks.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from truepose.files import atomic_write_text
from truepose.leaves import modules_named
from truepose.shown.document import Document
from truepose.shown.text import screen

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")


class Declared(Generic[T]):
    """A function of a result that is implemented above, one implementation for each type (``functools.singledispatch``)."""

    def __init__(self, expected: str) -> None:
        def missing(result: object, *_: object) -> T:
            raise TypeError(f"found a {type(result).__name__}, expected {expected}")

        self._implemented = singledispatch(missing)

    def register(self, function: Callable[..., T]) -> Callable[..., T]:
        """Decorator: implement it for the type that the function's first parameter is annotated with."""
        self._implemented.register(function)
        return function

    def __call__(self, result: object, *arguments: Any) -> T:
        modules_named("showing")
        return self._implemented(result, *arguments)


document: Declared[Document] = Declared("a result")
frame: Declared[pd.DataFrame] = Declared("a result")
files: Declared[list[str]] = Declared("a result with files")
"""Writes the files of a result into a directory and returns their names."""


class Shown:
    """One screen of ``repr``, and a table. The repr of a broken object says so; it raises nothing."""

    def __repr__(self) -> str:
        try:
            return screen(document(self))
        except Exception as exc:  # debuggers and messages show objects that are half made, or made up
            return f"<{type(self).__name__}, which cannot be shown: {type(exc).__name__}>"

    def to_frame(self) -> pd.DataFrame:
        """Return the result as a table, with the columns that its class names."""
        return frame(self)


class Written(Shown):
    """A result with a report."""

    def report(self, path: Path | str) -> Path:
        """Write the report, one HTML file that loads nothing, whole or not at all; its path. Raises InputError."""
        from truepose.shown.html import page

        atomic_write_text(path, page(document(self)))
        return Path(path)

    def save(self, directory: Path | str) -> list[Path]:
        """Write what the command of the same name writes, all or nothing; the paths. Raises InputError."""
        return [Path(directory) / name for name in files(self, Path(directory))]

    write = save  # its former name
