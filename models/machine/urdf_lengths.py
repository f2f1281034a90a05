"""A URDF with its lengths times a factor: what was written in millimetres, say, in metres; all else stays."""

from __future__ import annotations

import re
from functools import partial

_ORIGIN = re.compile(r"""(<origin\b[^>]*?\bxyz\s*=\s*["'])([^"']*)""")
_SLIDE = re.compile(r"""<joint\b[^>]*\btype\s*=\s*["']prismatic["'].*?</joint>""", re.DOTALL)
_LIMITS = re.compile(r"""(<limit\b[^>]*>)""")
_LIMIT = re.compile(r"""(\b(?:lower|upper)\s*=\s*["'])([^"']*)""")


def rescaled(text: str, factor: float) -> str:
    """The text of a URDF whose origins and limits of slides are ``factor`` times as long."""
    grown = partial(_times, factor)
    text = _ORIGIN.sub(grown, text)
    return _SLIDE.sub(lambda joint: _LIMITS.sub(lambda limit: _LIMIT.sub(grown, limit[0]), joint[0]), text)


def _times(factor: float, match: re.Match[str]) -> str:
    return match[1] + " ".join(f"{factor * float(number):.12g}" for number in match[2].split())
