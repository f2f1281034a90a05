"""Documents as HTML that loads nothing: a page with its pictures, style and scripts inside, and a piece for a notebook."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from truepose.shown.chart import Chart, legend
from truepose.shown.chart_svg import svg
from truepose.shown.document import Block, Document, Items, Table
from truepose.shown.text import printable

ROWS = 40
"""Most rows of a table, and items of a list, of a notebook's piece."""
_TEMPLATES = Path(__file__).parent / "templates"
_CODE = re.compile(r"`([^`]+)`")
_SLUG = re.compile(r"\(([a-z]+(?:-[a-z0-9]+)+)\)")


def page(document: Document) -> str:
    """The whole page. Same document, same bytes."""
    scripts = [f"\n{_text(name)}" for name in ("tables.js", "scene.js", "picks.js")]
    scene = document.scene()
    data = {"rows": list(document.rows), "scene": None if scene is None else scene.data}
    return _template("page.html.j2").render(
        document=document,
        scene=scene,
        sections=document.sections(),
        style=Markup(_text("charts.css") + _text("style.css")),
        scripts=[Markup(script) for script in scripts],
        policy=_policy(scripts),
        data=Markup(_json(data)),
    )


def fragment(document: Document) -> str:
    """The first screen for a notebook, small enough for its file, in the notebook's own colours."""
    notes = [Items(document.notes, title="Notes")] if document.notes else []
    blocks: list[Block] = [*document.summary, *notes, *document.tables()]
    left = sum(len(block.rows[ROWS:]) for block in blocks if isinstance(block, Table))
    more = f"... {left} more rows{f': {document.more}' if document.more else ''}" if left else ""
    return _template("fragment.html.j2").render(
        document=document,
        blocks=[_shortened(block) for block in blocks],
        charts=document.charts(),
        style=Markup(_text("charts.css")),
        more=more,
    )


def _shortened(block: Block) -> Block:
    if isinstance(block, Table):
        return replace(block, rows=block.rows[:ROWS])
    return replace(block, items=block.items[:ROWS]) if isinstance(block, Items) else block


@cache
def _template(name: str) -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        finalize=lambda value: value if isinstance(value, Markup) else _printable(value),
    )
    environment.filters |= {"plain": _plain, "drawn": _drawn, "verbatim": escape}
    environment.globals |= {"legend": legend}
    return environment.get_template(name)


def _printable(value: object) -> object:
    return printable(value) if isinstance(value, str) else value


def _policy(scripts: Iterable[str]) -> str:
    """What a browser is told to allow: the page's own scripts, by their digests, its style, and nothing from elsewhere."""
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    own = " ".join(f"'sha256-{digest}'" for digest in digests)
    return f"default-src 'none'; style-src 'unsafe-inline'; script-src {own}; base-uri 'none'; form-action 'none'"


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _drawn(chart: Chart) -> Markup:
    return Markup(svg(chart))


def _plain(text: str) -> Markup:
    """The text with slugs, which stand behind plain names in brackets, in small type, and `code` as code."""
    small = _SLUG.sub(r"<small>(\1)</small>", str(escape(printable(text))))
    return Markup(_CODE.sub(r"<code>\1</code>", small))


def _json(data: Mapping[str, Any]) -> str:
    """Data as JSON that may stand inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
