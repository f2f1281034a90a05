"""What a plug-in's own code does wrong while it is used, as one line that names its file and its entry.

Entries of the catalogue itself are left as they are. Of those that a user's file registers every function of that file is
wrapped where it is registered: whatever it raises becomes an InputError, what it prints goes to standard error, and what it
gives is checked where a check is known for it.
"""

from __future__ import annotations

import contextlib
import inspect
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any

from truepose.errors import InputError, TrueposeError

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


__all__ = ["PREFIX", "Check", "Kind", "a", "a_tuple_of", "guarded", "is_plugins", "translated"]
