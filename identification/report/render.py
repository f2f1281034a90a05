"""Documents written down: one self-contained HTML file."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup, escape

from truepose.identification.report.document import Document
from truepose.models.effects.base import effects
from truepose.shown.chart import Chart, legend
from truepose.shown.chart_svg import svg

_TEMPLATES = Path(__file__).parent / "templates"
_CODE = re.compile(r"`([^`]+)`")
_SLUG = re.compile(r"\(([a-z]+(?:-[a-z0-9]+)*)\)")


def html(document: Document) -> str:
    """The page with its pictures, style and script inside: it loads nothing. Same document, same bytes."""
    loader = jinja2.FileSystemLoader(_TEMPLATES)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, keep_trailing_newline=True
    )
    environment.filters |= {"plain": _plain, "drawn": _drawn}
    environment.globals |= {"legend": legend}
    page = environment.get_template("page.html.j2")
    scene = document.opening.scene
    scripts = [f"\n{_text(name)}" for name in ("tables.js", "scene.js", "picks.js")]
    data = {"rows": list(document.rows), "scene": None if scene is None else scene.data}
    return page.render(
        document=document,
        style=Markup(_text("style.css")),
        scripts=[Markup(script) for script in scripts],
        policy=_policy(scripts),
        data=Markup(_json(data)),
    )


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
    """The text with the catalogue's slugs, which stand behind plain names in brackets, in small type, and `code` as code."""
    known = set(effects)

    def small(match: re.Match[str]) -> str:
        return f"<small>({match[1]})</small>" if match[1] in known else match[0]

    return Markup(_CODE.sub(r"<code>\1</code>", _SLUG.sub(small, str(escape(text)))))


def _json(data: Mapping[str, Any]) -> str:
    """Data as JSON that may stand inside a script element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
