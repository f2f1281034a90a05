"""Universal Robots' URScript: poses ``p[x, y, z, rx, ry, rz]`` in m and rad, joints ``[q1, ..., q6]`` in rad.

Targets are literals in motions (movej, movel, movep, movec, servoj), in ``get_inverse_kin``, and in variables that these
go to. ``pose_trans(feature, p[...])`` in a motion is a pose in that feature.
"""

from __future__ import annotations

import bisect
import functools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

from truepose.identification.programs.forms import RotationVector
from truepose.identification.programs.program import (
    NUMBER,
    Kind,
    Left,
    Lines,
    Program,
    Target,
    closing,
    in_order,
    masked,
    numbers_in,
    parts,
    shown,
)
from truepose.models.machine import Machine

_COMMENT, _QUOTE = r"#[^\r\n]*", r"\"[^\"\r\n]*\"|'[^'\r\n]*'"
_SIX = r"\[\s*" + r"\s*,\s*".join([NUMBER] * 6) + r"\s*\]"
_LITERAL = re.compile(rf"(?:(?P<pose>(?<!\w)p[ \t]*)|(?<![\w\]])){_SIX}")
_ASSIGNED = re.compile(r"(?m)^[ \t]*(?:(?:global|local)\s+)?(?P<name>[A-Za-z_]\w*)\s*=\s*$")
_CALL = re.compile(r"\b(?P<what>movej|movel|movep|movec|servoj|servoc|get_inverse_kin)\s*\(")
_SET_TCP = re.compile(r"\bset_tcp\s*\(")
_TRANS = re.compile(r"\s*pose_trans\s*\(")
_PLACES = {"movec": 2}
_COMPUTED = "worked out while the program runs"
Tool = tuple[str, tuple[float, ...] | None]
_COMPONENT = re.compile(r"(?m)^[ \t]*(?P<what>(?P<name>[A-Za-z_]\w*)\s*\[[^\]]*\]\s*=[^=][^\r\n]*)")
_FORM = RotationVector(
    ("m",) * 3, ("rad",) * 3, (7, 7, 7, 8, 8, 8), "x,y,z,rx,ry,rz in m and rad, a rotation vector"
)


@dataclass(frozen=True)
class _Use:
    """What a motion goes to: the frames it is told in, where in the text, and next to which joints."""

    base: str | None
    tool: str | None
    place: int = field(compare=False)
    near: tuple[float, ...] | None = field(default=None, compare=False)


@dataclass
class _Uses:
    names: dict[str, dict[_Use, None]] = field(default_factory=dict)
    places: dict[int, _Use] = field(default_factory=dict)
    left: list[Left] = field(default_factory=list)


class UrScript:
    """URScript, .script."""

    name, title = "urscript", "URScript"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, lines = masked(text, _COMMENT, _QUOTE), Lines(text)
        frames, tools = _frames(mask), _tools(mask)
        used = _uses(mask, lines, tools)
        frames |= {f"set_tcp@{at}": numbers for at, (_, numbers) in tools.items() if numbers is not None}
        targets: list[Target] = []
        left = list(used.left)
        for m in _LITERAL.finditer(mask):
            is_pose = m["pose"] is not None
            name, uses = _told(mask, m, used)
            if not uses:
                left += _unused(mask, m, name, is_pose, lines)
                continue
            if len(uses) > 1 and is_pose:
                why = "used with several features or tools"
                left.append(Left(lines.of(m.start()), shown(f"{name} = {m.group()}"), why))
                continue
            use = uses[0]
            numbers = tuple(numbers_in(mask, m.end("pose") if is_pose else m.start(), m.end()))
            kind: Kind = "pose" if is_pose else "joints"
            line = lines.of(m.start())
            targets.append(Target(line, name, kind, numbers, (), use.base, use.tool, use.place, use.near))
        left += _changed(mask, {t.name for t in targets}, lines)
        return Program(text, tuple(targets), in_order(left), _FORM, {"rad": "rad", "mm": "m"}, frames)


def _told(mask: str, m: re.Match[str], used: _Uses) -> tuple[str, list[_Use]]:
    """The name of a literal and what motions go to it."""
    if m.start() in used.places:
        return "literal", [used.places[m.start()]]
    begin = max(mask.rfind("\n", 0, m.start()), mask.rfind("\r", 0, m.start())) + 1
    assigned = _ASSIGNED.fullmatch(mask[begin : m.start()])
    if assigned is None:
        return "literal", []
    return assigned["name"], list(used.names.get(assigned["name"], ()))


def _unused(mask: str, m: re.Match[str], name: str, is_pose: bool, lines: Lines) -> list[Left]:
    """Poses that no motion here goes to; features and lists of other things are no targets."""
    if not is_pose or name == "literal":
        return []
    words, features = _words(mask)
    if name in features:
        return []
    why = "no motion here goes to it" if words[name] == 1 else "motions go to what is worked out of it"
    return [Left(lines.of(m.start()), shown(f"{name} = {m.group()}"), why)]


@functools.lru_cache(maxsize=2)
def _words(mask: str) -> tuple[Counter[str], frozenset[str]]:
    """How often each word stands in a text, and those that are features; once for all of its variables."""
    return Counter(re.findall(r"\w+", mask)), frozenset(re.findall(r"\bpose_trans\s*\(\s*(\w+)\s*,", mask))


def _uses(mask: str, lines: Lines, tools: dict[int, Tool]) -> _Uses:
    out = _Uses()
    lists, starts = _lists(mask), list(tools)
    for call in _CALL.finditer(mask):
        end = closing(mask, call.end() - 1)
        if end is None:
            continue
        arguments = parts(mask, call.end(), end)
        near = _near(mask, arguments[1:2], lists) if call["what"] == "get_inverse_kin" else None
        use = _Use(None, _in_force(tools, starts, call.start()), call.start(), near)
        for a, b in arguments[: _PLACES.get(call["what"], 1)]:
            _take(mask, a, b, use, out, lines, call["what"])
    return out


def _take(mask: str, start: int, end: int, use: _Use, out: _Uses, lines: Lines, what: str) -> None:
    """What one argument of a motion goes to."""
    piece = mask[start:end]
    at = start + len(piece) - len(piece.lstrip())
    literal, name = _LITERAL.fullmatch(piece.strip()), re.fullmatch(r"[A-Za-z_]\w*", piece.strip())
    trans = _TRANS.match(mask, start, end)
    if literal is not None:
        out.places[at] = use
        return
    if name is not None:
        out.names.setdefault(name.group(), {}).setdefault(use)
        return
    if piece.strip().startswith("get_inverse_kin"):  # its own argument is looked at by itself
        return
    if trans is not None and use.base is None and (close := closing(mask, trans.end() - 1)) is not None:
        inside = parts(mask, trans.end(), close)
        feature = mask[slice(*inside[0])].strip()
        if len(inside) == 2 and re.fullmatch(r"[A-Za-z_]\w*", feature):
            _take(mask, *inside[1], replace(use, base=feature), out, lines, what)
            return
    out.left.append(Left(lines.of(at), shown(f"{what}({piece.strip()}"), _COMPUTED, computed=True))


def _near(
    mask: str, argument: list[tuple[int, int]], lists: dict[str, tuple[float, ...]]
) -> tuple[float, ...] | None:
    """Joints of the argument ``qnear``, where they stand there or in a variable."""
    for a, b in argument:
        piece = re.sub(r"^\s*qnear\s*=", "", mask[a:b]).strip()
        if _LITERAL.fullmatch(piece):
            return tuple(n.value for n in numbers_in(piece, 0, len(piece)))
        return lists.get(piece)
    return None


def _lists(mask: str) -> dict[str, tuple[float, ...]]:
    """Six numbers in variables, as joints."""
    return {name: numbers for name, is_pose, numbers in _variables(mask) if not is_pose}


def _variables(mask: str) -> Iterator[tuple[str, bool, tuple[float, ...]]]:
    for m in _LITERAL.finditer(mask):
        begin = max(mask.rfind("\n", 0, m.start()), mask.rfind("\r", 0, m.start())) + 1
        assigned = _ASSIGNED.fullmatch(mask[begin : m.start()])
        if assigned is not None:
            is_pose = m["pose"] is not None
            start = m.end("pose") if is_pose else m.start()
            yield assigned["name"], is_pose, tuple(n.value for n in numbers_in(mask, start, m.end()))


def _tools(mask: str) -> dict[int, Tool]:
    """Calls of set_tcp by position: the name of what they set, and its numbers where they stand there."""
    out: dict[int, Tool] = {}
    for m in _SET_TCP.finditer(mask):
        end = closing(mask, m.end() - 1)
        if end is None:
            continue
        a, b = parts(mask, m.end(), end)[0]
        literal = _LITERAL.fullmatch(mask[a:b].strip())
        numbers = tuple(n.value for n in numbers_in(mask, a, b)) if literal is not None else None
        out[m.start()] = (f"set_tcp@{m.start()}" if literal else mask[a:b].strip(), numbers)
    return out


def _in_force(tools: dict[int, Tool], starts: Sequence[int], at: int) -> str | None:
    """The tool that the last call of set_tcp before a position set, in the order of the text."""
    k = bisect.bisect_left(starts, at)
    return tools[starts[k - 1]][0] if k else None


def _frames(mask: str) -> dict[str, tuple[float, ...]]:
    """Poses in variables, as features."""
    return {name: numbers for name, is_pose, numbers in _variables(mask) if is_pose}


def _changed(mask: str, names: set[str], lines: Lines) -> Iterator[Left]:
    for m in _COMPONENT.finditer(mask):
        if m["name"] in names:
            why = "the program changes a target while it runs; what it writes is not corrected"
            yield Left(lines.of(m.start("what")), shown(m["what"]), why, computed=True)


__all__ = ["UrScript"]
