"""Where effects, sensors and builders of mechanisms are found by name.

A module in the folder of its kind is enough: it registers its class, and nothing else is edited.
A user's own file does the same (``truepose --plugin FILE``, or an import).
"""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import pkgutil
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

from truepose.errors import InputError, TrueposeError
from truepose.models.plugin_guard import PREFIX, Kind, guarded, is_plugins, translated

T = TypeVar("T")


class Registry(Generic[T]):
    """Named entries of one kind, filled on first use from the modules of a package."""

    def __init__(self, kind: str, package: str, guard: Kind | None = None) -> None:
        self._guard = guard
        self._kind, self._package, self._entries, self._filled = kind, package, dict[str, T](), False

    def add(self, name: str) -> Callable[[T], T]:
        """Decorator: the class that follows is known by ``name``; one of a user's file is guarded."""
        if not isinstance(name, str) or not name:
            raise InputError(f"the plug-in's {self._kind}: found the name {name!r}, expected a text")

        def register(entry: T) -> T:
            if self._guard is not None and (is_plugins(entry) or not self._guard.fits(entry)):
                entry = guarded(entry, name, self._guard)
            self._entries[name] = entry
            return entry

        return register

    def get(self, name: object, where: str) -> T:
        """The entry of that name; InputError naming ``where``, what exists and close matches."""
        self._fill()
        if isinstance(name, str) and name in self._entries:
            return self._entries[name]
        close = difflib.get_close_matches(str(name), self._entries, n=2)
        hint = f"; did you mean {' or '.join(close)}?" if close else ""
        raise InputError(
            f"{where}: found {self._kind} {name!r}, expected one of {', '.join(sorted(self._entries))}{hint}"
        )

    def __iter__(self) -> Iterator[str]:
        self._fill()
        return iter(sorted(self._entries))

    @contextmanager
    def as_before(self) -> Iterator[None]:
        """What is added or replaced within is forgotten afterwards (tests)."""
        self._fill()
        before = dict(self._entries)
        try:
            yield
        finally:
            self._entries = before

    def _fill(self) -> None:
        if self._filled:
            return
        self._filled = True
        package = importlib.import_module(self._package)
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{self._package}.{module.name}")


def load_plugin(path: Path) -> ModuleType:
    """Run a user's file so that what it registers is known; a file loaded before is run again.

    The module is found in ``sys.modules`` under a name of its own, since dataclasses look their annotations up
    there: files of one name in two folders do not clash. Raises InputError when the file cannot be run; its
    module is then forgotten.
    """
    path = Path(path)
    try:
        there, name = path.is_file(), _module_name(path)
    except (OSError, RuntimeError, ValueError):  # a name too long, a loop of links
        there, name = False, ""
    spec = importlib.util.spec_from_file_location(name, path) if there else None
    if spec is None or spec.loader is None:
        raise InputError(
            f"{path}: found no Python file, expected a plugin that registers effects, sensors or builders"
        )
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with translated(f"{path}: the plugin cannot be loaded", str(path)), warnings.catch_warnings():
            warnings.simplefilter(
                "ignore", SyntaxWarning
            )  # of what is then told as an error, or does no harm
            spec.loader.exec_module(module)
    except BaseException as exc:
        del sys.modules[name]
        if isinstance(exc, TrueposeError) and str(path) not in str(exc):
            raise InputError(f"{path}: the plugin cannot be loaded: {exc}") from exc
        raise
    return module


def _module_name(path: Path) -> str:
    return f"{PREFIX}{hashlib.sha256(str(Path(path).resolve()).encode()).hexdigest()[:12]}_{Path(path).stem}"
