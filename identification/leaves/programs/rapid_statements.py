"""Statements of a RAPID module, the values they give to names, and literals of targets in them."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from truepose.identification.leaves.programs.program import NUMBER, Span


def _list(count: int) -> str:
    return r"\[\s*" + r"\s*,\s*".join([NUMBER] * count) + r"\s*\]"


def _lists(*counts: int) -> str:
    return r"\[\s*" + r"\s*,\s*".join(_list(n) for n in counts) + r"\s*\]"


ROBTARGET, _JOINTTARGET = re.compile(_lists(3, 4, 4, 6)), re.compile(_lists(6, 6))
_STATEMENT = re.compile(r"[^;]*;?")
_DECLARED = re.compile(
    r"(?i)\b(?:CONST|PERS|VAR)\s+(?P<type>robtarget|jointtarget)\s+(?P<name>\w+)\s*(?P<array>\{[^{}]*\})?\s*:=\s*"
)
_OTHER = re.compile(r"(?i)\b(?:CONST|PERS|VAR)\s+\w+\s+\Z")
_ASSIGNED = re.compile(
    r"(?i)(?<![\\\w.])(?P<name>[A-Z]\w*)\s*(?P<array>\{[^{}]*\})?\s*(?P<part>(?:\.\w+)*)\s*:=\s*"
)


@dataclass(frozen=True)
class Statement:
    """The text ``[start:end]``. A ``value`` is given to ``name`` (lower case), ``declared`` as written there.

    ``array``: to elements of an array; ``partly``: to a component; ``maybe``: under a condition that stands in the statement.
    """

    start: int
    end: int
    name: str | None = None
    declared: str | None = None
    value: Span = (0, 0)
    array: bool = False
    partly: bool = False
    maybe: bool = False


def statements(mask: str) -> Iterator[Statement]:
    """Yield the statements of a module whose comments and strings are blank."""
    for m in _STATEMENT.finditer(mask):
        if not m.group().strip():
            continue
        start, end = m.span()
        declared = _DECLARED.search(mask, start, end)
        given = declared or _ASSIGNED.search(mask, start, end)
        if given is None or (declared is None and _OTHER.search(mask, start, given.start())):
            yield Statement(start, end)
            continue
        value = given.end(), given.end() + len(mask[given.end() : end].rstrip("; \t\r\n"))
        name, own = given["name"].lower(), declared["name"] if declared else None
        before = re.split(r"[\r\n]", mask[start : given.start()])[-1]
        partly = declared is None and bool(given["part"])
        yield Statement(
            given.start(), end, name, own, value, given["array"] is not None, partly, not declared and bool(before.strip())
        )  # fmt: skip


def literals(mask: str, statement: Statement) -> Iterator[tuple[re.Match[str], bool]]:
    """Yield the literals of a statement, and whether each is a pose."""
    for pattern in (ROBTARGET, _JOINTTARGET):
        for m in pattern.finditer(mask, statement.start, statement.end):
            yield m, pattern is ROBTARGET
