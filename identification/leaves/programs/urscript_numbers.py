"""Numbers of a URScript literal: plain, products of plain ones, or ``d2r`` of one."""

from __future__ import annotations

import math
import re

from truepose.identification.leaves.programs.program import NUMBER, Number

CONSTANT = rf"(?:[+-]?d2r\s*\(\s*{NUMBER}\s*\)|{NUMBER}(?:\s*[*/]\s*{NUMBER})*+)"
_CONSTANT = re.compile(CONSTANT)
_DEGREES = re.compile(rf"(?P<sign>[+-]?)d2r\s*\(\s*(?P<deg>{NUMBER})")
_FACTOR = re.compile(rf"(?P<how>[*/]?)\s*(?P<number>{NUMBER})")


def constants_in(text: str, start: int, end: int) -> list[Number]:
    """Return the constants between two positions; the text of one that is worked out is its value."""
    found = _CONSTANT.finditer(text, start, end)
    return [Number(m.start(), m.end(), _plain(m.group())) for m in found]


def _plain(text: str) -> str:
    """Return the text of a constant's value; one that is none is beyond every limit."""
    degrees, factors = _DEGREES.match(text), list(_FACTOR.finditer(text))
    if degrees is None and len(factors) == 1:
        return text
    if degrees is not None:
        value = math.radians(float(f"{degrees['sign']}1") * float(degrees["deg"]))
    else:
        value = 1.0
        for m in factors:
            number = float(m["number"])
            value = value * number if m["how"] != "/" else value / number if number else math.inf
    return f"{value:.10f}" if math.isfinite(value) else "1e99"


__all__ = ["CONSTANT", "constants_in"]
