"""KUKA's KRL: positions in .src and .dat files.

Targets are constants ``{X 1, Y 2, ...}`` and ``{A1 1, A2 2, ...}`` behind a motion (PTP, LIN, CIRC, SPTP, SLIN, SCIRC, SPL) and
in variables of the types POS, E6POS, AXIS and E6AXIS, or of FRAME where a motion goes to them. Which base and tool a
target is told in comes from the FDAT of its name (taught points), else from ``$BASE`` and ``$TOOL``, ``BAS(#BASE, n)`` and
``BAS(#TOOL, n)`` before the motions to it.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.leaves.programs.configurations import StatusTurn
from truepose.identification.leaves.programs.flow import Assignment, Keywords
from truepose.identification.leaves.programs.pose_forms import Euler, numbers_of
from truepose.identification.leaves.programs.program import (
    BASE_ITSELF,
    NUMBER,
    Kind,
    Number,
    Span,
    Target,
    parts,
)
from truepose.identification.leaves.programs.reader import (
    UNUSED,
    Going,
    Language,
    Motion,
    Reader,
    bare_span,
)

FIXED = "#TCP"
"""Name of the tool of motions whose tool stands in the cell."""
_IN_CELL = "the tool is fixed in the cell and the robot holds the part (#TCP)"
_NULL = {"$NULLFRAME", "$WORLD", "$ROBROOT"}
_POSE, _JOINTS = ("X", "Y", "Z", "A", "B", "C"), ("A1", "A2", "A3", "A4", "A5", "A6")
_EXTERNAL = re.compile(r"E[1-6]")
_FDAT = re.compile(r"(?i)\bFDAT\s+(?P<name>\w+)\s*=\s*\{(?P<fields>[^{}]*)\}")
_MODIFIERS = r"(?:(?:GLOBAL|DECL|CONST)[ \t]+)*"
_TYPED = rf"{_MODIFIERS}(?P<type>POS|E6POS|FRAME|AXIS|E6AXIS)[ \t]+"
_DECLARED = re.compile(rf"(?im)^[ \t]*{_TYPED}(?P<names>[\w \t,\[\]]+)$")
_ASSIGNED = re.compile(
    rf"(?im)^[ \t]*+{_MODIFIERS}(?:\w++[ \t]++)?(?P<name>\$?[A-Za-z_]\w*+)[ \t]*+(?:\[(?P<index>[^\]\r\n]*)\])?[ \t]*+"
    r"(?P<part>(?:\.\w++)*+)[ \t]*+=(?!=)[ \t]*+(?P<value>[^\r\n]*)"
)
_BEFORE = re.compile(
    rf"(?i)^\s*(?:{_TYPED}|{_MODIFIERS})(?P<name>\$?\w+(?:\s*\[[^\]]*\])?(?:\.\w+)*)\s*=\s*$"
)
_BAS = re.compile(r"(?im)^[ \t]*BAS\s*\(\s*#(?P<which>BASE|TOOL)\s*,\s*(?P<value>\d+)\s*\)")
_IPO_MODE = re.compile(r"(?im)^[ \t]*+\$IPO_MODE\s*=\s*#TCP\b")
_MOTION = re.compile(r"(?im)^[ \t]*(?P<how>S?(?:PTP|LIN|CIRC)(?:_REL)?|SPL)\b(?P<rest>[^\r\n]*)")
_ELEMENT = r"\$?[A-Za-z_]\w*+(?:\[\d+\])?"
_FACTOR = rf"(?:\{{[^{{}}]*\}}|[A-Za-z_]\w*+[ \t]*\[[^\]]*\]|{_ELEMENT})"
_PLACE = re.compile(rf"\s*+(?P<what>{_FACTOR}(?:\s*:\s*{_FACTOR})*)\s*+(?P<rest>.*)")
_BEHIND = re.compile(r"(?:C_\w++\s*+)*+(?:WITH\b.*)?|\(.*")
_FIELD = re.compile(rf"\s*(\w+)\s+({NUMBER})\s*")
_FRAMES = re.compile(r"(?i)^(?:\$BASE|\$TOOL|\$WORLD|\$ROBROOT|(?:BASE|TOOL)_DATA\[.*|\$?MACHINE_\w+.*)$")


@dataclass(frozen=True)
class Stand:
    """Names of the base and the tool in force, None where the text says nothing."""

    base: str | None = None
    tool: str | None = None


class Kuka(Language):
    """KRL, .src and .dat."""

    name, title = "kuka", "KUKA KRL"
    form, configuration = Euler(), StatusTurn()
    joint_units: ClassVar[Mapping[str, str]] = {"rad": "deg", "mm": "mm"}
    comment = r";[^\r\n]*|(?m:^[ \t]*&[^\r\n]*)"
    words = Keywords(
        function=r"(?:GLOBAL[ \t]+)?(?:DEF|DEFFCT)\b",
        loop=r"(?:LOOP|WHILE|REPEAT|FOR)\b",
        branch=r"(?:IF|SWITCH)\b",
        turn=r"(?:ELSE|CASE|DEFAULT)\b",
        close=r"(?:END(?:FCT|LOOP|WHILE|FOR|IF|SWITCH)?|UNTIL)\b",
        jump=r"GOTO\b",
    )
    constant = re.compile(r"\{[^{}]*\}")
    element = re.compile(_ELEMENT)

    def assignments(self, mask: str) -> Iterator[Assignment]:
        """Yield assignments; those to an element of an array change a part of the array, and with an index that is no number
        they may be to any element (``name[]``)."""
        for m in _ASSIGNED.finditer(mask):
            start, end = bare_span(mask, m.span("value"))
            name, partly = m["name"].upper(), bool(m["part"])
            if name == "FDAT_ACT":
                for which in ("$BASE", "$TOOL"):
                    yield Assignment(which, start, end)
            elif m["index"] is None:
                yield Assignment(m["name"], start, end, partly)
            else:
                index = m["index"].strip()
                yield Assignment(m["name"], start, end, partly=True)
                element = f"{m['name']}[{index if index.isdigit() else ''}]"
                yield Assignment(element, start, end, partly)
        for m in _BAS.finditer(mask):
            yield Assignment(f"${m['which']}", *m.span("value"))

    def setting(self, reader: Reader, one: Assignment, called: str) -> str | None:
        text = re.sub(r"\s", "", reader.mask[one.start : one.end]).upper()
        which = called.removeprefix("$")
        if not one.partly and text in _NULL:
            return BASE_ITSELF
        if text.isdigit():
            return reader.named_frame(_numbered(which, text) or "", one.start) if int(text) else BASE_ITSELF
        stand = _taught(reader.mask).get(f"X{text.removeprefix('F')}")
        if stand is not None:
            return stand.base if which == "BASE" else stand.tool
        return super().setting(reader, one, called)

    def motions(self, reader: Reader) -> Iterator[Motion]:
        reader.unusable[FIXED] = _IN_CELL
        taught = _taught(reader.mask)
        if (fixed := _IPO_MODE.search(reader.mask)) is not None and fixed.start() < reader.length:
            raise InputError(
                f"line {reader.lines.of(fixed.start())}: found $IPO_MODE=#TCP, expected tools "
                "that the robot holds"
            )
        for line in _MOTION.finditer(reader.mask):
            if line["how"].upper().endswith("_REL"):
                why = "a relative motion: it starts where the motion before it ended"
                reader.leave(line.start("how"), line.group(), why)
                continue
            for span in parts(reader.mask, *line.span("rest")):
                m = _PLACE.match(reader.mask, *span)
                if m is None or not (m["what"].endswith("}") or _BEHIND.fullmatch(m["rest"])):
                    continue
                goal = m.span("what") if not m["rest"].startswith("(") else bare_span(reader.mask, span)
                loose = line["how"].upper() not in ("PTP", "SPTP")
                stand, sure = taught.get(m["what"].upper()), True
                if stand is None:
                    base, sure_base = reader.in_force("$BASE", goal[0])
                    tool, sure_tool = reader.in_force("$TOOL", goal[0])
                    stand, sure = Stand(base, tool), sure_base and sure_tool
                yield Motion(goal, Going(stand.base, stand.tool, goal[0], sure=sure, loose=loose))

    def target(self, reader: Reader, span: Span, *, is_used: bool) -> Target | str | None:
        """Return a position; of axes, those of a robot of fewer than six, if the others are 0."""
        before = reader.mask[reader.line(span[0])[0] : span[0]]
        assigned = _BEFORE.match(before)
        if not is_used and assigned is None:
            return None
        name = re.sub(r"\s", "", assigned["name"]).upper() if assigned else _how(before)
        fields = _fields(reader.mask, span)
        if not is_used and assigned is not None:
            kind = (assigned["type"] or _types(reader.mask).get(name.partition("[")[0], "")).upper()
            if _FRAMES.match(name) or kind == "FRAME" or (fields is None and not kind):
                return None
            if fields is not None and not kind and not {"S", "T"} & set(fields):
                return UNUSED if set(fields) & {*_POSE, *_JOINTS} else None
        if fields is None:
            return "not all of its coordinates are plain numbers"
        return _position(reader, span, name, fields)

    def pose(self, text: str) -> Array | None:
        fields = _fields(text, (0, len(text)))
        if fields is None or not set(fields) >= set(_POSE):
            return None
        return np.asarray(self.form.poses(np.array([[fields[f].value for f in _POSE]]))[0])

    def written(self, reader: Reader, span: Span) -> str | None:
        pose = reader.pose(span)
        if pose is None:
            return None
        reader.keep(span)
        pairs = zip(_POSE, numbers_of(self.form, pose), strict=True)
        return "{" + ",".join(f"{axis} {v:.6f}" for axis, v in pairs) + "}"

    def factors(self, mask: str, span: Span) -> list[Span]:
        """Return what ``:`` multiplies."""
        return [bare_span(mask, one) for one in parts(mask, *span, mark=":")]


def _position(reader: Reader, span: Span, name: str, fields: Mapping[str, Number]) -> Target | str | None:
    """Return the target of a constant with these fields, in the frames of its FDAT."""
    is_pose = not set(fields) & set(_JOINTS)
    if is_pose and not set(fields) & set(_POSE):
        return None
    others = _JOINTS[reader.axes :]
    unused = all(f not in fields or fields[f].value == 0.0 for f in others)
    names = _POSE if is_pose else _JOINTS[: reader.axes] if unused else _JOINTS
    missing = [f for f in names if f not in fields]
    external = [f"{f} {n.text}" for f, n in fields.items() if _EXTERNAL.fullmatch(f) and n.value != 0.0]
    if missing:
        return f"{', '.join(missing)} of it stay what they are when the robot comes there"
    if external:
        return f"external axes are in use ({', '.join(external)})"
    configuration = [fields["S"], fields["T"]] if is_pose and {"S", "T"} <= set(fields) else []
    stand = _taught(reader.mask).get(name.partition("[")[0], Stand())
    kind: Kind = "pose" if is_pose else "joints"
    target = reader.target(span, name, kind, [fields[f] for f in names], configuration)
    return replace(target, base=stand.base, tool=stand.tool)


@functools.lru_cache(maxsize=4)
def _taught(mask: str) -> dict[str, Stand]:
    """Return the frames of taught points by name: FP1 tells of XP1 and of P1."""
    out: dict[str, Stand] = {}
    for m in _FDAT.finditer(mask):
        fields = dict(re.findall(r"(\w+)\s+(#?\w+)", m["fields"].upper()))
        base, tool = (_numbered(which, fields.get(f"{which}_NO")) for which in ("BASE", "TOOL"))
        stand = Stand(base, FIXED if fields.get("IPO_FRAME") == "#TCP" else tool)
        bare = m["name"].upper().removeprefix("F")
        out |= {f"X{bare}": stand, bare: stand}
    return out


def _how(before: str) -> str:
    """Return the word of the motion in whose line a constant stands."""
    return (before.split(maxsplit=1) or ["literal"])[0].upper()


def _numbered(which: str, number: str | None) -> str | None:
    """Return the name of a numbered frame; number 0 is none, one below zero says nothing."""
    if number is None or not number.isdigit():
        return None
    return BASE_ITSELF if int(number) == 0 else f"{which}_DATA[{int(number)}]"


@functools.lru_cache(maxsize=4)
def _types(mask: str) -> dict[str, str]:
    """Return the types of positions by name, of declarations without values."""
    out: dict[str, str] = {}
    for m in _DECLARED.finditer(mask):
        names = re.findall(r"(\w+)\s*(?:\[[^\]]*\])?", m["names"])
        out |= {name.upper(): m["type"] for name in names}
    return out


def _fields(mask: str, span: Span) -> dict[str, Number] | None:
    """Return the fields of a constant by name; None where one is no plain number."""
    start, end = span[0] + 1, span[1] - 1
    typed = re.compile(r"\s*\w+\s*:").match(mask, start, end)
    out: dict[str, Number] = {}
    for a, b in parts(mask, typed.end() if typed else start, end):
        m = _FIELD.fullmatch(mask, a, b)
        if m is None:
            return None
        out[m.group(1).upper()] = Number(m.start(2), m.end(2), m.group(2))
    return out
