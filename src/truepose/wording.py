"""Lists and names in sentences, for messages of every floor."""

from __future__ import annotations

import difflib
import itertools
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
    near = difflib.get_close_matches(name, sorted(set(known)), n=3, cutoff=0.6)
    return "did you mean " + " or ".join(repr(item) for item in near) + "?" if near else ""


def close_matches(name: str, known: Iterable[str]) -> str:
    """Ending of a message: the known name meant, or the names there are."""
    names = sorted(set(known))
    return meant(name[:_LONGEST], names) or ("known: " + _listed(names) if names else "")


_LONGEST = 200
"""Characters of a name that others are compared with."""
_ROOM = 1000
"""Characters of a list of names in a message."""


def _listed(names: Sequence[str]) -> str:
    """Names with commas between them; of more than a message has room for the first ones."""
    told = [cut(name) for name in names]
    most = sum(end <= _ROOM for end in itertools.accumulate(len(name) + 2 for name in told))
    return shortened(told, max(most, 1))


def cut(text: str, most: int = 200) -> str:
    """A text that a file says, in one line of a message: its beginning where it is long, without what no line holds."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text[: 4 * most]).split())
    return words if len(words) <= most and len(text) <= 4 * most else f"{words[:most]}..."
