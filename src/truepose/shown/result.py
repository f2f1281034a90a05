"""What results have in common: how they show themselves, and what they write.

A result is data on a low floor; its words, tables and pages are made above it. So a class names the module that shows
it, in ``shown_by``, and that module is imported when somebody looks. It has ``view(result)`` and ``frame(result)``.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, cast

from truepose.shown.page import page
from truepose.shown.view import View, screen

if TYPE_CHECKING:
    import pandas as pd

REPORT = "truepose.identification.report"


class Shown:
    """One screen of ``repr``, a table with a picture in notebooks. The repr of a broken object says so; it raises nothing."""

    shown_by: ClassVar[str] = f"{REPORT}.views"
    internal: ClassVar[frozenset[str]] = frozenset()
    """Public names of a class that its user does not need: completion leaves them out."""

    def __dir__(self) -> list[str]:
        """The names that completion offers: fields and methods for a user."""
        hidden = {"shown_by", "internal", "write", *self.internal}
        return sorted(name for name in super().__dir__() if not name.startswith("_") and name not in hidden)

    def __repr__(self) -> str:
        try:
            return screen(_view(self))
        except Exception as exc:  # debuggers and messages show objects that are half made, or made up
            return f"<{type(self).__name__}, which cannot be shown: {type(exc).__name__}>"

    def _repr_html_(self) -> str:
        return page(_view(self))


class Written(Shown):
    """A result with a report."""

    def report(self, path: Path | str) -> Path:
        """Write the report, one HTML file that loads nothing, whole or not at all; its path. Raises InputError."""
        return cast(Path, above("files", "write_report")(self, path))

    def save(self, directory: Path | str) -> list[Path]:
        """Write what the command of the same name writes, all or nothing; the paths. Raises InputError."""
        return cast("list[Path]", above("files", "write_files")(self, directory))

    write = save  # its former name


def frame_of(result: Shown) -> pd.DataFrame:
    """The table of a result."""
    return cast("pd.DataFrame", importlib.import_module(result.shown_by).frame(result))


def _view(result: Shown) -> View:
    return cast(View, importlib.import_module(result.shown_by).view(result))


def above(module: str, name: str) -> Any:
    """Return what a module of the report defines: it stands above the results that it is about."""
    return getattr(importlib.import_module(f"{REPORT}.{module}"), name)
