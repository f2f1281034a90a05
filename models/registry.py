"""Where effects, sensors and builders of mechanisms are found by name.

A module in the folder of its kind is enough: it registers its class, and nothing else is edited.
A user's own file does the same (``truepose --plugin FILE``, or an import).
"""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import importlib
import importlib.util
import inspect
import pkgutil
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from types import ModuleType
from typing import Any, Generic, TypeVar

from truepose.errors import InputError, TrueposeError
from truepose.stopping import stopping

PREFIX = "truepose_plugin_"
"""How the names of modules begin that are plug-ins."""
CALLED = ("__init__", "__post_init__")
Check = Callable[[Any, Any], str]
"""What is wrong with a result, given the object that gave it; empty where nothing is."""


@dataclass(frozen=True)
class Kind:
    """What entries of a kind are, and what their functions must give. base: the class of entries that are classes."""

    name: str
    base: type | None
    checks: Mapping[str, Check]

    def fits(self, entry: object) -> bool:
        """Whether it is an entry of this kind at all."""
        if self.base is None:
            return callable(entry)
        return inspect.isclass(entry) and issubclass(entry, self.base)


def is_plugins(entry: object) -> bool:
    """Whether an entry comes from a user's file."""
    return str(getattr(entry, "__module__", "")).startswith(PREFIX)


def guarded(entry: Any, name: str, kind: Kind) -> Any:
    """The entry with its own functions guarded. Raises InputError for what is no entry of the kind."""
    where = f"the plug-in's {kind.name} {name!r}"
    if not kind.fits(entry):
        expected = "a function" if kind.base is None else f"a class made from {kind.base.__name__}"
        raise InputError(f"{where}: found {_shown(entry)}, expected {expected}")
    if kind.base is None:
        return _wrapped(entry, where, kind.checks.get("", _anything))
    missing = sorted(getattr(entry, "__abstractmethods__", ()))
    if missing:
        raise InputError(f"{where}: found no {', '.join(missing)}, expected all of them")
    slug = getattr(entry, "slug", None)
    if any("slug" in vars(home).get("__annotations__", {}) for home in kind.base.__mro__) and slug != name:
        raise InputError(f"{where}: found the slug {slug!r}, expected {name!r}, by which it is known")
    for home in entry.__mro__:
        if is_plugins(home):
            _guard_class(home, where, kind.checks)
    return entry


def _guard_class(home: type, where: str, checks: Mapping[str, Check]) -> None:
    for attribute, value in list(vars(home).items()):
        check = checks.get(attribute, _anything)
        if attribute.startswith("__") and attribute not in CALLED:
            continue
        if isinstance(value, classmethod | staticmethod):
            changed: Any = type(value)(_wrapped(value.__func__, where, check))
        elif isinstance(value, property) and value.fget is not None:
            changed = property(_wrapped(value.fget, where, check), value.fset, value.fdel, value.__doc__)
        elif inspect.isfunction(value):
            changed = _wrapped(value, where, check)
        else:
            continue
        setattr(home, attribute, changed)


def _anything(_: Any, __: Any) -> str:
    return ""


def _wrapped(function: Callable[..., Any], where: str, check: Check) -> Callable[..., Any]:
    """The function, once: a class that two entries share is guarded for the first."""
    if hasattr(function, "__guarded__"):
        return function
    code = getattr(function, "__code__", None)
    file = code.co_filename if code is not None else ""
    if file == "<string>":  # a dataclass made it
        return function
    called = f"{file}: {where}"

    @wraps(function)
    def guard(*arguments: Any, **options: Any) -> Any:
        with translated(f"{called}: {function.__name__} failed", file):
            given = function(*arguments, **options)
        wrong = check(given, arguments[0] if arguments else None)
        if wrong:
            raise InputError(f"{called}: {function.__name__} gave {wrong}")
        return given

    guard.__guarded__ = True  # type: ignore[attr-defined]
    return guard


@contextlib.contextmanager
def translated(where: str, file: str) -> Iterator[None]:
    """Let whatever a user's code raises in the block be an InputError that begins with ``where``."""
    try:
        with _aside():
            yield
    except TrueposeError:
        raise
    except BaseException as exc:
        if not _their_own(exc):
            raise
        words = f"{type(exc).__name__}: {exc}" if str(exc) else type(exc).__name__
        raise InputError(f"{where}: {words}{_line(exc, file)}") from exc


def _aside() -> contextlib.AbstractContextManager[object]:
    """Prints to standard error: standard output is the command's. Threads, which share it, leave it as it is."""
    if threading.current_thread() is threading.main_thread():
        return contextlib.redirect_stdout(sys.stderr)
    return contextlib.nullcontext()


def _their_own(exc: BaseException) -> bool:
    """Not a signal to this process, nor what stops a block from outside."""
    if isinstance(exc, KeyboardInterrupt):
        return stopping.listens and not stopping.number
    kind = type(exc)
    own = kind is BaseException or kind.__module__.startswith(PREFIX)
    return isinstance(exc, Exception | SystemExit) or own


def _line(exc: BaseException, file: str) -> str:
    lines = [frame.lineno for frame in traceback.extract_tb(exc.__traceback__) if frame.filename == file]
    return f" (line {lines[-1]})" if lines else ""


def _shown(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:60]} ..."


def a_tuple_of(kind: type | tuple[type, ...], what: str) -> Check:
    """A check: a sequence of such things."""

    def check(given: Any, _: Any) -> str:
        sequence = isinstance(given, Sequence) and not isinstance(given, str)
        right = sequence and all(isinstance(one, kind) for one in given)
        return "" if right else f"{_shown(given)}, expected a tuple of {what}"

    return check


def a(kind: type, what: str) -> Check:
    """A check: one such thing."""

    def check(given: Any, _: Any) -> str:
        return "" if isinstance(given, kind) else f"{_shown(given)}, expected {what}"

    return check


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


def load_once(path: Path) -> None:
    """The same, unless it was loaded before."""
    if _module_name(path) not in sys.modules:
        load_plugin(path)


def loaded_plugins() -> tuple[Path, ...]:
    """Absolute paths of the files that were loaded, in their order."""
    files = [module.__file__ for name, module in sys.modules.items() if name.startswith(PREFIX)]
    return tuple(Path(file).resolve() for file in files if file is not None)


def _module_name(path: Path) -> str:
    return f"{PREFIX}{hashlib.sha256(str(Path(path).resolve()).encode()).hexdigest()[:12]}_{Path(path).stem}"
