"""Names in the generated C: which machine names can be used, and identifiers of parameters and drivers."""

from __future__ import annotations

import re
from collections.abc import Sequence

from truepose.errors import InputError

LONGEST = 63
"""Initial characters of an internal identifier that C99 guarantees to tell apart."""

_KEYWORDS = frozenset(
    """auto break case char const continue default do double else enum extern float for goto if inline int long
    register restrict return short signed sizeof static struct switch typedef union unsigned void volatile while""".split()
)


def check_machine_name(name: str) -> str:
    """The name, if it can stand in C as it is written. Raises InputError that says which rule it breaks."""
    broken = _broken_rule(name)
    if broken:
        raise InputError(f"name: found {name!r}, expected a C identifier for the generated code: {broken}")
    return name


def _broken_rule(name: str) -> str | None:
    if not name:
        return "it is empty"
    if name[0] == "_":
        return "it begins with an underscore, which C reserves"
    if not re.match(r"[A-Za-z]", name[0]):
        return f"it begins with {name[0]!r}, not with a letter a-z or A-Z"
    wrong = re.search(r"[^A-Za-z0-9_]", name)
    if wrong:
        return f"it contains {wrong.group()!r}; only letters a-z A-Z, digits and underscores may follow"
    if name in _KEYWORDS:
        return "it is a keyword of C"
    if len(name) > LONGEST:
        return f"it has {len(name)} characters, more than the {LONGEST} that C tells apart"
    return None


def identifiers(names: Sequence[str]) -> list[str]:
    """One C identifier tail per name: other characters become underscores; what then collides gets _2, _3 ..."""
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


def comment(text: str) -> str:
    """A text that may stand inside a C comment."""
    return re.sub(r"\s+", " ", text).replace("*/", "* /").replace("/*", "/ *").rstrip("\\")
