"""Names in the generated C: identifiers of machines, parameters and drivers."""

from __future__ import annotations

import re
from collections.abc import Sequence

LONGEST = 63
"""Initial characters of an internal identifier that C99 guarantees to tell apart."""

_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int
    long register restrict return short signed sizeof static struct switch typedef union unsigned void
    volatile while
"""


def machine_identifier(name: str) -> str:
    """Return what a machine is called in C: its name as it is written where C can have it, else the nearest identifier."""
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name).lstrip("_")
    if not plain[:1].isalpha() or plain in _KEYWORDS.split():
        plain = f"machine_{plain}".rstrip("_")
    return plain[:LONGEST]


def identifiers(names: Sequence[str]) -> list[str]:
    """Tails of C identifiers: other characters become underscores; what then collides gets _2, _3 ..."""
    taken: set[str] = set()
    out = []
    plain = [re.sub(r"[^A-Za-z0-9_]", "_", name) for name in names]
    for name in plain:
        candidate, count = name, 1
        while candidate in taken or (count > 1 and candidate in plain):
            count += 1
            candidate = f"{name}_{count}"
        taken.add(candidate)
        out.append(candidate)
    return out
