"""Universal Robots' URScript: poses ``p[x, y, z, rx, ry, rz]`` in m and rad, joints ``[q1, ..., q6]`` in rad.

Targets are constants in motions (movej, movel, movep, movec, servoj), in ``get_inverse_kin``, and in variables that these
go to. ``pose_trans(feature, p[...])`` in a motion is a pose in that feature; features may be poses in features again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.flow import Assignment, Keywords
from truepose.identification.leaves.programs.pose_forms import RotationVector, numbers_of
from truepose.identification.leaves.programs.program import NUMBER, Number, Span, Target, closing, parts
from truepose.identification.leaves.programs.reader import (
    UNUSED,
    Going,
    Language,
    Motion,
    Reader,
    bare_span,
)

_CALL = re.compile(r"\b(?P<what>movej|movel|movep|movec|servoj|servoc|get_inverse_kin)\s*\(")
_SET_TCP = re.compile(r"\bset_tcp\s*\(")
_TRANS = re.compile(r"\s*pose_trans\s*\(")
_NEAR = re.compile(r"\s*(?:qnear\s*=)?")
_IN_FORCE = "set_tcp"
"""What the flow of a text calls the tool in force."""
_PLACES = {"movec": 2}
_BEGIN = r"(?<![^\r\n:;])[ \t]*+(?:(?:global|local)[ \t]+)?(?P<name>[A-Za-z_]\w*)"
_VALUE = rf"(?:[+-]?d2r\s*\(\s*{NUMBER}\s*\)|{NUMBER}(?:\s*[*/]\s*{NUMBER})*+)"
"""Numbers of a constant: plain, products and quotients of plain ones, or ``d2r`` of one."""
_DEGREES = re.compile(rf"(?P<sign>[+-]?)d2r\s*\(\s*(?P<number>{NUMBER})")
_FACTOR = re.compile(rf"(?P<how>[*/]?)\s*(?P<number>{NUMBER})")
_CONSTANT = r"(?:(?P<pose>(?<!\w)p[ \t]*)|(?<![\w\]]))\[\s*" + r"\s*,\s*".join([_VALUE] * 6) + r"\s*\]"
_ASSIGNED = re.compile(rf"{_BEGIN}\s*=(?!=)[ \t]*(?P<value>{_CONSTANT}(?=[ \t]*(?:[\r\n;]|\Z))|[^\r\n]*)")
_COMPONENT = re.compile(rf"(?P<what>{_BEGIN}\s*\[[^\]\r\n]*\]\s*=[^=][^\r\n]*)")


class UrScript(Language):
    """URScript, .script."""

    name, title = "urscript", "URScript"
    form = RotationVector(
        ("m",) * 3, ("rad",) * 3, (7, 7, 7, 8, 8, 8), "x,y,z,rx,ry,rz in m and rad, a rotation vector"
    )
    joint_units: ClassVar[Mapping[str, str]] = {"rad": "rad", "mm": "m"}
    comment, quote = r"#[^\r\n]*", r"\"[^\"\r\n]*\"|'[^'\r\n]*'"
    words = Keywords(
        function=r"(?:def|thread|sec)\b",
        loop=r"(?:while|for)\b",
        branch=r"if\b",
        turn=r"(?:elif|else)\b",
        close=r"end\b",
        jump=r"thread\b",
    )
    constant = re.compile(_CONSTANT)
    skipped = re.compile(r"get_inverse_kin\b")
    has_base = False

    def assignments(self, mask: str) -> Iterator[Assignment]:
        for m in _ASSIGNED.finditer(mask):
            yield Assignment(m["name"], *m.span("value"))
        for m in _COMPONENT.finditer(mask):
            yield Assignment(m["name"], *m.span("what"), partly=True)
        for m in _SET_TCP.finditer(mask):
            end = closing(mask, m.end() - 1)
            if end is not None:
                yield Assignment(_IN_FORCE, *parts(mask, m.end(), end)[0])

    def motions(self, reader: Reader) -> Iterator[Motion]:
        for call in _CALL.finditer(reader.mask):
            end = closing(reader.mask, call.end() - 1)
            if end is None:
                continue
            tool, sure = reader.in_force(_IN_FORCE, call.start())
            arguments = [bare_span(reader.mask, span) for span in parts(reader.mask, call.end(), end)]
            near = _near(reader, arguments[1:2]) if call["what"] == "get_inverse_kin" else None
            for goal in arguments[: _PLACES.get(call["what"], 1)]:
                yield Motion(goal, Going(None, tool, goal[0], sure=sure, near=near))

    def target(self, reader: Reader, span: Span, *, is_used: bool) -> Target | str | None:
        mask = reader.mask
        is_pose = mask[span[0]] == "p"
        assigned = re.fullmatch(rf"{_BEGIN}\s*=\s*", mask[reader.line(span[0])[0] : span[0]])
        if not is_used:
            return UNUSED if is_pose and assigned else None
        name = assigned["name"] if assigned else "literal"
        return reader.target(span, name, "pose" if is_pose else "joints", _numbers_in(mask, *span), [])

    def pose(self, text: str) -> Array | None:
        values = [n.value for n in _numbers_in(text, 0, len(text))]
        return np.asarray(self.form.poses(np.array([values]))[0]) if text.startswith("p") else None

    def written(self, reader: Reader, span: Span) -> str | None:
        pose = reader.pose(span)
        if pose is None:
            return None
        reader.keep(span)
        values = numbers_of(self.form, pose)
        return f"p[{', '.join(f'{v:.1f}' if v == 0 else f'{v:.10f}' for v in values)}]"

    def factors(self, mask: str, span: Span) -> list[Span]:
        """Return the arguments of ``pose_trans``, those of one in another one by one."""
        trans = _TRANS.match(mask, *span)
        start, end = bare_span(mask, span)
        if trans is None or closing(mask, trans.end() - 1) != end - 1:
            return [(start, end)]
        inside = parts(mask, trans.end(), end - 1)
        if len(inside) != 2:
            return [(start, end)]
        return [one for argument in inside for one in self.factors(mask, argument)]


def _near(reader: Reader, argument: list[Span]) -> tuple[float, ...] | None:
    """Return the joints of the argument ``qnear``, where they stand there or in a variable."""
    for start, end in argument:
        named = _NEAR.match(reader.mask, start, end)
        begin = named.end() if named else start
        reaching = reader.flow.reaching(reader.mask[begin:end], start)
        spans = [(begin, end), *((one.start, one.end) for one in reaching if one is not None)]
        for span in spans:
            piece = reader.mask[slice(*bare_span(reader.mask, span))]
            if UrScript.constant.fullmatch(piece) and not piece.startswith("p"):
                return tuple(n.value for n in _numbers_in(piece, 0, len(piece)))
    return None


def _numbers_in(text: str, start: int, end: int) -> list[Number]:
    """Return the numbers between two positions; the text of one that is worked out is its value."""
    return [
        Number(m.start(), m.end(), _plain(m.group())) for m in re.compile(_VALUE).finditer(text, start, end)
    ]


def _plain(text: str) -> str:
    """Return the text of a number's value; one that has none is beyond every limit."""
    degrees, factors = _DEGREES.match(text), list(_FACTOR.finditer(text))
    if degrees is None and len(factors) == 1:
        return text
    if degrees is not None:
        value = math.radians(float(f"{degrees['sign']}1") * float(degrees["number"]))
    else:
        value = 1.0
        for m in factors:
            number = float(m["number"])
            value = value * number if m["how"] != "/" else value / number if number else math.inf
    return f"{value:.10f}" if math.isfinite(value) else "1e99"
