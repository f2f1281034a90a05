"""Where effects, sensors and builders of mechanisms are found by name.

A module in the folder of its kind is enough: it registers its class, and nothing else is edited.
A user's own file does the same (``truepose --plugin FILE``, or an import).
"""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import inspect
import pkgutil
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Generic, TypeVar

from truepose.errors import InputError, TrueposeError

T = TypeVar("T")
PREFIX = "truepose_plugin_"
"""How the names of modules begin that are plug-ins."""


class Registry(Generic[T]):
    """Named entries of one kind, filled on first use from the modules of a package; classes are made from ``base``."""

    def __init__(self, kind: str, package: str, base: type | None = None) -> None:
        self._base = base
        self._kind, self._package, self._entries, self._filled = kind, package, dict[str, T](), False

    def add(self, name: str) -> Callable[[T], T]:
        """Decorator: the class that follows is known by ``name``. Raises InputError for what is no entry of this kind."""
        if not isinstance(name, str) or not name:
            raise InputError(f"the plug-in's {self._kind}: found the name {name!r}, expected a text")

        def register(entry: T) -> T:
            self._check(entry, name)
            self._check_free(entry, name)
            self._entries[name] = entry
            return entry

        return register

    def _check(self, entry: object, name: str) -> None:
        """Raise InputError for an entry that cannot be used: of another class, incomplete, or with another name."""
        where = f"the plug-in's {self._kind} {name!r}"
        if self._base is None and not callable(entry):
            raise InputError(f"{where}: found {entry!r}, expected a function")
        if self._base is not None and not (inspect.isclass(entry) and issubclass(entry, self._base)):
            raise InputError(f"{where}: found {entry!r}, expected a class made from {self._base.__name__}")
        missing = sorted(getattr(entry, "__abstractmethods__", ()))
        if missing:
            raise InputError(f"{where}: found no {', '.join(missing)}, expected all of them")
        slug = getattr(entry, "slug", None if self._kind == "effect" else name)
        if slug != name:
            raise InputError(f"{where}: found the slug {slug!r}, expected {name!r}")

    def _check_free(self, entry: object, name: str) -> None:
        """Raise InputError where the name is that of another entry which comes with the package."""
        there = getattr(self._entries.get(name), "__module__", "")
        if there.startswith(f"{self._package}.") and there != getattr(entry, "__module__", ""):
            raise InputError(
                f"the plug-in's {self._kind} {name!r}: found the name in {there}, expected another one"
            )

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
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)  # reported as an error, or harmless
            spec.loader.exec_module(module)
    except KeyboardInterrupt:
        del sys.modules[name]
        raise
    except BaseException as exc:  # sys.exit among them
        del sys.modules[name]
        words = str(exc) if isinstance(exc, TrueposeError) else f"{type(exc).__name__}: {exc}"
        raise InputError(f"{path}: the plugin cannot be loaded: {words}") from exc
    return module


def plugin_fault(exc: Exception) -> str | None:
    """Return what a plug-in's own code did wrong, with its file and line; None where no plug-in was running."""
    files = {str(path) for path in loaded_plugins()}
    frames = [f for f in traceback.extract_tb(exc.__traceback__) if str(Path(f.filename).resolve()) in files]
    if not frames:
        return None
    words = f"{type(exc).__name__}: {exc}" if str(exc) else type(exc).__name__
    return f"{frames[-1].filename}: line {frames[-1].lineno}: the plug-in's {frames[-1].name} failed: {words}"


def loaded_plugins() -> tuple[Path, ...]:
    """Absolute paths of the files that were loaded, in their order."""
    files = [module.__file__ for name, module in sys.modules.items() if name.startswith(PREFIX)]
    return tuple(Path(file).resolve() for file in files if file is not None)


def _module_name(path: Path) -> str:
    return f"{PREFIX}{hashlib.sha256(str(Path(path).resolve()).encode()).hexdigest()[:12]}_{Path(path).stem}"
