"""Lists and names in sentences, for messages of every floor."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence


def joined(parts: Iterable[str], word: str = "and") -> str:
    """``a, b and c``; nothing for nothing."""
    *others, last = list(parts) or [""]
    return f"{', '.join(others)} {word} {last}" if others else last


def shortened(items: Sequence[str], most: int) -> str:
    """``a, b and 3 more``: the first of a list, and how many follow."""
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(items[:most]) + more


def meant(name: str, known: Iterable[str]) -> str:
    """Ending of a message: the known name meant; empty where none is near."""
    if len(name) > _LONGEST:  # it would be compared letter by letter, and is no slip of a key
        return ""
    short = sorted({each for each in known if len(each) <= 2 * _LONGEST})
    near = difflib.get_close_matches(name, short, n=3, cutoff=0.6)
    return "did you mean " + " or ".join(repr(item) for item in near) + "?" if near else ""


_MOST, _LONGEST = 30, 60
"""Known names that a message lists, and letters of each."""


def close_matches(name: str, known: Iterable[str]) -> str:
    """Ending of a message: the known name meant, or the names there are."""
    names = sorted(set(known))
    return meant(name, names) or ("known: " + shortened([cut(n) for n in names], _MOST) if names else "")


def cut(text: str, longest: int = _LONGEST) -> str:
    """A text of a file in one line of a message: its beginning where it is long, without what no line holds."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text[: 4 * longest]).split())
    return words if len(words) <= longest and len(text) <= 4 * longest else f"{words[:longest]}..."
