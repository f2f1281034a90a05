"""Names in the generated C: which machine names can be used, and identifiers of parameters and drivers."""

from __future__ import annotations

import re
from collections.abc import Sequence

from truepose.errors import InputError

LONGEST = 63
"""Initial characters of an internal identifier that C99 guarantees to tell apart."""

_KEYWORDS = """
    auto break case char const continue default do double else enum extern float for goto if inline int
    long register restrict return short signed sizeof static struct switch typedef union unsigned void
    volatile while
"""


def check_machine_name(name: str) -> str:
    """The name, if it can stand in C as it is written. Raises InputError that says which rule it breaks."""
    broken = _broken_rule(name)
    if broken:
        raise InputError(f"name: found {name!r}, expected a C identifier for the generated code: {broken}")
    return name


def _broken_rule(name: str) -> str | None:
    """The first rule that a name breaks, in words."""
    wrong = re.search(r"[^A-Za-z0-9_]", name)
    rules = (
        (not name, "it is empty"),
        (name[:1] == "_", "it begins with an underscore, which C reserves"),
        (name[:1].isdigit(), f"it begins with {name[:1]!r}, not with a letter a-z or A-Z"),
        (wrong, f"it contains {wrong and wrong.group()!r}, which is no letter a-z A-Z, digit or underscore"),
        (name in _KEYWORDS.split(), "it is a keyword of C"),
        (len(name) > LONGEST, f"it has {len(name)} characters, more than the {LONGEST} that C tells apart"),
    )
    return next((text for broken, text in rules if broken), None)


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
