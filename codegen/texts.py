"""The templates of the generated C: one environment for all that is printed."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import jinja2

from truepose.codegen.quoting import FILTERS

TEMPLATES = Path(__file__).parent / "templates"


@cache
def environment() -> jinja2.Environment:
    """Templates by their path below ``templates``; a name that a template reads and is not given is an error."""
    out = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,
    )
    out.filters |= FILTERS
    return out
