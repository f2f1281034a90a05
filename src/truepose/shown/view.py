"""What there is to see of a result, free of any form: a sentence, facts, a table, a picture; and its text on one screen."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass

LINES, WIDTH = 24, 100
"""One screen of text."""
TITLE_LINES, FACT_LINES = 4, 2
"""Most lines of the sentence, and of one fact."""
TABLE_LINES = 8
"""Lines that facts leave to a table, if it has as many."""
CELL = 34
GAP = "  "


@dataclass(frozen=True)
class View:
    """A result to be shown.

    title: what it is and says, in a sentence; facts: further plain sentences; head, rows: a table of texts whose first
    column is set to the left; more: where the rest is, when rows or facts are left out; picture: makes a small SVG, None
    where there is nothing to draw.
    """

    title: str
    facts: tuple[str, ...] = ()
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    more: str = ""
    picture: Callable[[], str] | None = None


def screen(view: View) -> str:
    """At most 24 lines of at most 100 characters: the sentence, then facts and rows as far as they fit."""
    lines = _wrapped(view.title, "", TITLE_LINES)
    room = LINES - len(lines) - 1  # the last line says what is left out
    table = _table(view)
    facts = [_wrapped(fact, GAP, FACT_LINES) for fact in view.facts]
    left = room - min(len(table), TABLE_LINES)
    shown = 0
    while shown < len(facts) and len(facts[shown]) <= left:
        left -= len(facts[shown])
        lines += facts[shown]
        shown += 1
    rows = table[: left + min(len(table), TABLE_LINES)]
    cut = _left_out(len(facts) - shown, len(table) - len(rows), printable(view.more))
    return "\n".join([*lines, *rows, *cut])


def _left_out(facts: int, rows: int, more: str) -> list[str]:
    """What is not shown, and where it is."""
    said = [f"{n} more {one if n == 1 else one + 's'}" for n, one in ((facts, "line"), (rows, "row")) if n]
    if not said:
        return []
    return [_clipped(f"{GAP}... {', '.join(said)}{': ' + more if more else ''}", WIDTH)]


def _table(view: View) -> list[str]:
    """Head and rows, columns set apart; numbers to the right."""
    if not view.rows:
        return []
    cells = [[_clipped(printable(cell), CELL) for cell in row] for row in (view.head, *view.rows)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(view.head))]
    return [_clipped(GAP + GAP.join(_set(row, widths)).rstrip(), WIDTH) for row in cells]


def _set(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    return [
        f"{cell:<{width}}" if k == 0 else f"{cell:>{width}}"
        for k, (cell, width) in enumerate(zip(row, widths, strict=True))
    ]


def _wrapped(text: str, indent: str, most: int) -> list[str]:
    """A sentence in a few lines; what is beyond them is cut with an ellipsis."""
    return textwrap.wrap(
        printable(text),
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + GAP,
        max_lines=most,
        break_on_hyphens=False,
        placeholder=" ...",
    )


def _clipped(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 4].rstrip() + " ..."


def printable(text: str) -> str:
    """The text without what would move a terminal's cursor or change its colours: names are a user's own."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
