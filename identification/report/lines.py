"""Words in lines of a terminal: wrapped, cut where they are too long, and no more of them than a screen shows."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

COLUMNS, LINES = 110, 25
"""Widest line, and most lines, of what is told of a result."""
CUT = " ..."
_CAUTIONS = 3


def wrapped(text: str, indent: int = 2, most: int = 2) -> list[str]:
    """A sentence in at most so many lines; what goes beyond is cut, and its end says so."""
    made = textwrap.wrap(
        text,
        COLUMNS,
        initial_indent=" " * indent,
        subsequent_indent=" " * (indent + 2),
        break_on_hyphens=False,
    )
    if len(made) <= most:
        return made
    last = textwrap.shorten(made[most - 1] + " " + made[most].strip(), COLUMNS - indent - 2, placeholder=CUT)
    return [*made[: most - 1], " " * (indent + 2 if most > 1 else indent) + last]


def several_lines(texts: Sequence[str], label: str, most: int, each: int = 2) -> list[str]:
    """Sentences after one label, in at most so many lines altogether; the last line counts those left out."""
    blocks = [wrapped(f"{label}: {text}", most=each) for text in texts]
    return listed(blocks, most, f"  {label}: and {{}} more: see report.html")


def listed(
    blocks: Sequence[Sequence[str]], room: int, more: str = "  and {} more: see report.html"
) -> list[str]:
    """Blocks of lines as long as there is room; the last line counts those left out."""
    out: list[str] = []
    for k, block in enumerate(blocks):
        left = len(blocks) - k - 1
        if len(out) + len(block) + (left > 0) > room:
            return [*out, more.format(left + 1)][:room] if room else []
        out += block
    return out


def caution_lines(sentences: Sequence[str]) -> list[str]:
    """Return what stands above a result: the first three sentences, two lines each."""
    shown = [line for text in sentences[:_CAUTIONS] for line in wrapped(text, indent=0)]
    left = len(sentences) - _CAUTIONS
    return [*shown, f"and {left} more: see report.html"] if left > 0 else shown


__all__ = ["COLUMNS", "LINES", "caution_lines", "listed", "several_lines", "wrapped"]
