"""Documents written down: one self-contained HTML file, or plain text."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.io import to_json
from plotly.offline import get_plotlyjs

from truepose.identification.report.document import Block, Card, Document, Items, Plot, Table, Text

_TEMPLATES = Path(__file__).parent / "templates"
_CONFIG = '{"displaylogo": false, "responsive": true, "modeBarButtonsToRemove": ["lasso2d", "select2d"]}'
_WIDTH = 100


def html(document: Document) -> str:
    """The page with figures and plotly.js inside: it loads nothing. Same document, same bytes."""
    loader = jinja2.FileSystemLoader(_TEMPLATES)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )
    page = environment.get_template("page.html.j2")
    style = Markup((_TEMPLATES / "style.css").read_text(encoding="utf-8"))
    return page.render(document=document, style=style, plotly=Markup(get_plotlyjs()), draw=_Drawer())


class _Drawer:
    """Numbers the plots of a page and embeds them."""

    def __init__(self) -> None:
        self._count = 0

    def __call__(self, plot: Plot) -> Markup:
        self._count += 1
        name = f"plot-{self._count}"
        height = int(plot.figure.layout.height or 400)
        return Markup(
            f'<div id="{name}" style="height:{height}px"></div>\n<script>(function (f) {{'
            f' Plotly.newPlot("{name}", f.data, f.layout, {_CONFIG}); }})({_json(plot.figure)});</script>'
        )


def _json(figure: Any) -> str:
    """A figure as JSON that may stand inside a script element."""
    text = str(to_json(figure, validate=False, engine="json"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def text(document: Document) -> str:
    """The same document for a terminal, without its plots."""
    lines = [document.title, "", *_wrapped(document.headline), ""]
    lines += [f"  {name}: {value}" for name, value in document.facts]
    for number, section in enumerate(document.sections, 1):
        heading = f"{number}. {section.title}"
        body = [line for block in section.blocks for line in _lines(block)]
        lines += ["", heading, "-" * len(heading), *body] if body else []
    return "\n".join(lines) + "\n"


def _lines(block: Block) -> list[str]:
    if isinstance(block, Text):
        return [*_wrapped(block.text), ""]
    if isinstance(block, Items):
        lines = [block.title] if block.title else []
        return [*lines, *(line for item in block.items for line in _wrapped(item, "  - ")), ""]
    if isinstance(block, Table):
        return [*_columns([block.head, *block.rows], block.text_columns), ""]
    if isinstance(block, Card):
        badge = f"  [{block.badge}]" if block.badge else ""
        return [
            f"{block.title}{badge}",
            *(f"  {line}".rstrip() for inner in block.blocks for line in _lines(inner)),
        ]
    return []


def _wrapped(paragraph: str, bullet: str = "") -> list[str]:
    return textwrap.wrap(paragraph, _WIDTH, initial_indent=bullet, subsequent_indent=" " * len(bullet))


def _columns(rows: Sequence[Sequence[str]], text_columns: int) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    out = []
    for row in rows:
        cells = [
            c.ljust(w) if k < text_columns else c.rjust(w)
            for k, (c, w) in enumerate(zip(row, widths, strict=True))
        ]
        out.append("  " + "  ".join(cells).rstrip())
    return out
