"""Columns that mean nothing here: which ones a note names, and which might drive an error all the same."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np

from truepose.errors import InputError
from truepose.identification.recording.table import Table
from truepose.wording import cut, meant, shortened

_HINTED: Final = 200
"""Columns that are compared with known names."""
_LISTED: Final = 40
"""Columns that a note names."""


def ignored_columns(table: Table, known: Collection[str], optional: Collection[str]) -> tuple[str, ...]:
    """A note on the columns that are not ``known``, with the known or ``optional`` name that may be meant; none without any."""
    others = _beside(table, known)
    if not others:
        return ()
    absent = {*known, *optional} - set(table.names)
    hints = {name: meant(name, absent) for name in others[:_HINTED]}
    named = [f"{name!r} ({hint})" for name, hint in hints.items() if hint]
    named += [repr(cut(name)) for name in others if not hints.get(name)]
    return (f"{table.file}: ignored columns that mean nothing here: {shortened(named, _LISTED)}",)


def untried_columns(table: Table, known: Collection[str]) -> tuple[str, ...]:
    """Columns of numbers that vary, beside those that are ``known``: what might drive an error."""
    return tuple(name for name in _beside(table, known) if name and _varies(table, name))


def _beside(table: Table, known: Collection[str]) -> list[str]:
    """Columns that are neither known nor say of known ones how they were averaged."""
    named = {*known, "samples", *(f"{name}.sigma" for name in known)}
    named |= {f"{name.rpartition('.')[0]}.samples" for name in known}
    return [name for name in table.names if name not in named]


def _varies(table: Table, name: str) -> bool:
    try:
        return bool(np.ptp(table.numbers(name)) > 0.0)
    except InputError:
        return False
