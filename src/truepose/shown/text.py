"""Documents as text: one screen of a terminal, for commands and for ``repr``."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from truepose.shown.document import Command, Document, Gain, Items, Table, Text

LINES, WIDTH = 24, 100
"""One screen of text. A command to be typed is never broken, however long."""
HEAD_LINES, CAUTIONS = 4, 3
"""Most lines of the headline, and most cautions above it."""
CELL = 34
GAP = "  "
CUT = " ..."
_ALL = 10**6
_WHOLE = (_ALL, _ALL, _ALL)
_ROOM = (_WHOLE, (_ALL, 3, _ALL), (12, 2, 8), (6, 2, 8), (4, 2, 6), (4, 1, 6), (2, 1, 4), (1, 1, 3))
"""Most items of a list, lines of an item, and rows of a table: the first that lets everything stand on a screen."""


def screen(document: Document) -> str:
    """At most 24 lines of at most 100 characters, with the notes; for ``repr``."""
    return "\n".join(first_screen(document, notes=True))


def first_screen(document: Document, most: int = LINES, *, notes: bool = False) -> list[str]:
    """The first screen of a document in at most so many lines; what is left out is counted.

    notes: with its notes and without its steps, as ``repr`` has it; a command prints its notes apart.
    """
    head = [*_cautions(document.cautions), *wrapped(document.headline or document.title, "", HEAD_LINES)]
    foot = [] if notes else [line for step in document.steps for line in _step(step)]
    room = most - len(head) - len(foot)
    more = f": {document.more}" if document.more else ""
    for items, each, rows in _ROOM:
        body = _body(document, items, each, rows, more, notes=notes)
        if len(body) <= room:
            left = room - len(body)
            body = _body(document, items, each, rows + left, more, notes=notes) if left else body
            break
    if len(body) > room:
        body = [*body[: max(room - 1, 0)], _clipped(f"{GAP}... {len(body) - room + 1} more lines{more}")][
            :room
        ]
    return [*head, *body, *foot]


def _body(document: Document, items: int, each: int, rows: int, more: str, *, notes: bool) -> list[str]:
    out = [line for gain in document.gains for line in wrapped(_gain(gain), GAP, max(each, 2))]
    listed = [Items(document.notes, label="note")] if notes else []
    tables = []
    for block in (*document.summary, *listed):
        if isinstance(block, Items):
            out += _items(block, items, each, more)
        elif isinstance(block, Text):
            out += wrapped(block.text, GAP, each)
        elif isinstance(block, Table):
            tables.append(block)
    return [*out, *(line for table in tables for line in _table(table, rows, more))]


def _items(block: Items, most: int, each: int, more: str) -> list[str]:
    lead = f"{block.label}: " if block.label else ""
    shown = block.items[: most * block.weight]
    out = [line for text in shown for line in wrapped(f"{lead}{text}", GAP, each)]
    left = len(block.items) - len(shown)
    return [*out, _clipped(f"{GAP}{lead}and {left} more{more}")] if left else out


def _gain(gain: Gain) -> str:
    before = gain.each or (f"{gain.before} before" if gain.before else "")
    was = f"{before}, {gain.after} after" if before else gain.after
    return "; ".join(part for part in (f"{gain.kind}: {was}", gain.note, gain.floor) if part)


def _step(step: Command | Text) -> list[str]:
    if isinstance(step, Text):
        return wrapped(f"next: {step.text}", "", 2)
    does = f", {step.does.rstrip(':')}" if step.does else ""
    return [printable(f"next{does}: {step.command}")]


def _cautions(sentences: Sequence[str]) -> list[str]:
    shown = [line for text in sentences[:CAUTIONS] for line in wrapped(text, "", 2)]
    left = len(sentences) - CAUTIONS
    return [*shown, f"and {left} more: see report.html"] if left > 0 else shown


def _table(table: Table, most: int, more: str) -> list[str]:
    """Head and rows, columns set apart; numbers to the right."""
    if not table.rows:
        return []
    shown = table.rows[: max(most, 0)]
    cells = [[_clipped(cell, CELL) for cell in row] for row in (table.head, *shown)]
    widths = [max(len(row[k]) for row in cells) for k in range(len(table.head))]
    out = [_clipped(GAP + GAP.join(_set(row, widths)).rstrip()) for row in cells]
    left = len(table.rows) - len(shown)
    return [*out, _clipped(f"{GAP}... {left} more row{'s' * (left > 1)}{more}")] if left else out


def _set(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    return [
        f"{cell:<{width}}" if k == 0 else f"{cell:>{width}}"
        for k, (cell, width) in enumerate(zip(row, widths, strict=True))
    ]


def wrapped(text: str, indent: str = GAP, most: int = 2) -> list[str]:
    """A sentence in at most so many lines; what goes beyond is cut, and its end says so."""
    return textwrap.wrap(
        printable(text),
        WIDTH,
        initial_indent=indent,
        subsequent_indent=indent + GAP,
        max_lines=most,
        break_on_hyphens=False,
        placeholder=CUT,
    )


def _clipped(text: str, width: int = WIDTH) -> str:
    text = printable(text)
    return text if len(text) <= width else text[: width - len(CUT)].rstrip() + CUT


def printable(text: str) -> str:
    """The text without what would move a terminal's cursor or change its colours: names are a user's own."""
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
