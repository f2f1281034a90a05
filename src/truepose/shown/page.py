"""A view for notebooks: a sentence, a picture and a table; it loads nothing and takes the notebook's own colours."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from truepose.shown.view import View, printable

ROWS = 40
"""Most rows of a table."""
TEXT = 400
"""Most characters of a fact or a cell."""
_LEFT = ' style="text-align:left"'


def page(view: View) -> str:
    """The view as HTML, small enough for a notebook's file. Every text is escaped."""
    parts = [f"<p><strong>{_text(view.title, 4 * TEXT)}</strong></p>"]
    if view.facts:
        items = "".join(f"<li>{_text(fact)}</li>" for fact in view.facts[:ROWS])
        parts.append(f"<ul>{items}</ul>")
    if view.picture is not None:
        parts.append(view.picture())
    if view.rows:
        parts.append(_table(view))
    left = len(view.rows) - ROWS
    if left > 0:
        tail = f": {view.more}" if view.more else ""
        parts.append(f"<p>... {left} more rows{_text(tail)}</p>")
    return f'<div class="truepose">{"".join(parts)}</div>'


def _table(view: View) -> str:
    head = _row("th", view.head)
    body = "".join(_row("td", row) for row in view.rows[:ROWS])
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _row(tag: str, cells: Sequence[str]) -> str:
    made = (f"<{tag}{_LEFT if k == 0 else ''}>{_text(cell)}</{tag}>" for k, cell in enumerate(cells))
    return f"<tr>{''.join(made)}</tr>"


def _text(text: str, most: int = TEXT) -> str:
    plain = printable(text)
    return escape(plain if len(plain) <= most else plain[: most - 4] + " ...")
