"""Statements of a RAPID module, the values they give to names, and literals of targets in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from truepose.identification.programs.program import NUMBER, Span


def _list(count: int) -> str:
    return r"\[\s*" + r"\s*,\s*".join([NUMBER] * count) + r"\s*\]"


def _lists(*counts: int) -> str:
    return r"\[\s*" + r"\s*,\s*".join(_list(n) for n in counts) + r"\s*\]"


_ROBTARGET, _JOINTTARGET = re.compile(_lists(3, 4, 4, 6)), re.compile(_lists(6, 6))
_STATEMENT = re.compile(r"[^;]*;?")
_DECLARED = re.compile(
    r"(?i)\b(?:CONST|PERS|VAR)\s+(?P<type>robtarget|jointtarget)\s+(?P<name>\w+)\s*(?P<array>\{[^{}]*\})?\s*:=\s*"
)
_ASSIGNED = re.compile(r"(?i)\s*(?P<name>\w+)\s*(?P<array>\{[^{}]*\})?\s*:=\s*")
_CHANGED = re.compile(r"(?i)^\s*(?P<what>(?P<name>\w+)(?:\s*\{[^{}]*\})?\s*(?:\.\w+)+\s*:=.*)$", re.S)


@dataclass(frozen=True)
class Statement:
    """The text ``[start:end]``. A ``value`` is given to ``name`` (lower case), ``declared`` as written there.

    ``array``: to elements of an array; ``partly``: to a component.
    """

    start: int
    end: int
    name: str | None = None
    declared: str | None = None
    value: Span = (0, 0)
    array: bool = False
    partly: bool = False


def statements(mask: str) -> Iterator[Statement]:
    """Yield the statements of a module whose comments and strings are blank."""
    for m in _STATEMENT.finditer(mask):
        if not m.group().strip():
            continue
        start, end = m.span()
        declared, changed = _DECLARED.search(mask, start, end), _CHANGED.match(m.group().rstrip(";"))
        given = declared or _ASSIGNED.match(mask, start, end)
        if given is not None:
            value = given.end(), given.end() + len(mask[given.end() : end].rstrip("; \t\r\n"))
            own = declared["name"] if declared else None
            begin = given.start() if declared else start
            yield Statement(begin, end, given["name"].lower(), own, value, given["array"] is not None)
        elif changed is not None:
            yield Statement(start + changed.start("what"), end, changed["name"].lower(), partly=True)
        else:
            yield Statement(start, end)


def literals(mask: str, statement: Statement) -> Iterator[tuple[re.Match[str], bool]]:
    """Yield the literals of a statement, and whether each is a pose."""
    for pattern in (_ROBTARGET, _JOINTTARGET):
        for m in pattern.finditer(mask, statement.start, statement.end):
            yield m, pattern is _ROBTARGET


__all__ = ["Statement", "literals", "statements"]
