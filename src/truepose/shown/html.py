"""A document as HTML that loads nothing: a page with its pictures, style and scripts inside."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from truepose.shown.chart import legend
from truepose.shown.chart_svg import svg
from truepose.shown.document import Document
from truepose.shown.text import printable

_TEMPLATES = Path(__file__).parent / "templates"
_CODE = re.compile(r"`([^`]+)`")
_SLUG = re.compile(r"\(([a-z]+(?:-[a-z0-9]+)+)\)")


def page(document: Document) -> str:
    """The whole page. Same document, same bytes."""
    scripts = [f"\n{_text(name)}" for name in ("tables.js", "scene.js", "picks.js")]
    scene = document.scene()
    data = {"rows": list(document.rows), "scene": None if scene is None else scene.data}
    return _template().render(
        document=document,
        scene=scene,
        sections=document.sections(),
        style=Markup(_text("charts.css") + _text("style.css")),
        scripts=[Markup(script) for script in scripts],
        policy=_policy(scripts),
        data=Markup(_json(data)),
    )


@cache
def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        finalize=lambda value: printable(value) if type(value) is str else value,
    )
    environment.filters |= {"plain": _plain, "drawn": lambda chart: Markup(svg(chart)), "verbatim": escape}
    environment.filters["kind"] = lambda block: type(block).__name__
    environment.globals |= {"legend": legend}
    return environment.get_template("page.html.j2")


def _policy(scripts: Iterable[str]) -> str:
    """What a browser is told to allow: the page's own scripts, by their digests, its style, and nothing from elsewhere."""
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    own = " ".join(f"'sha256-{digest}'" for digest in digests)
    return f"default-src 'none'; style-src 'unsafe-inline'; script-src {own}; base-uri 'none'; form-action 'none'"


def _text(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")


def _plain(text: str) -> Markup:
    """The text with slugs, which stand behind plain names in brackets, in small type, and `code` as code."""
    small = _SLUG.sub(r"<small>(\1)</small>", str(escape(printable(text))))
    return Markup(_CODE.sub(r"<code>\1</code>", small))


def _json(data: Mapping[str, Any]) -> str:
    """Data as JSON that may stand inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
