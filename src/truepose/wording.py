"""Lists in sentences, for messages of every floor."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def joined(parts: Iterable[str], word: str = "and") -> str:
    """``a, b and c``; nothing for nothing."""
    *others, last = list(parts) or [""]
    return f"{', '.join(others)} {word} {last}" if others else last


def shortened(items: Sequence[str], most: int) -> str:
    """``a, b and 3 more``: the first of a list, and how many follow."""
    more = f" and {len(items) - most} more" if len(items) > most else ""
    return ", ".join(items[:most]) + more
