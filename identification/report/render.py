"""Documents written down: one self-contained HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup
from plotly.io import to_json
from plotly.offline import get_plotlyjs

from truepose.identification.report.document import Document, Plot

_TEMPLATES = Path(__file__).parent / "templates"
_CONFIG = '{"displaylogo": false, "responsive": true, "modeBarButtonsToRemove": ["lasso2d", "select2d"]}'


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
