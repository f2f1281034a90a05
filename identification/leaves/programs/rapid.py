"""ABB's RAPID: robtargets and jointtargets in modules.

Targets are literals ``[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax...]]`` and ``[[six axes],[eax...]]``, in declarations or
in motions. The work object and the tool of one are those of the motions of this file that go to it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.identification.leaves.programs.configurations import Quadrants
from truepose.identification.leaves.programs.flow import Assignment, Keywords
from truepose.identification.leaves.programs.frames import is_rigid
from truepose.identification.leaves.programs.pose_forms import Quaternion
from truepose.identification.leaves.programs.program import (
    BASE_ITSELF,
    LARGEST,
    NUMBER,
    Number,
    Span,
    Target,
    numbers_in,
    parts,
    replaced,
)
from truepose.identification.leaves.programs.reader import (
    Going,
    Language,
    Motion,
    Reader,
    bare_span,
)
from truepose.models.lie import pose_of


def _list(*pieces: str) -> str:
    return r"\[\s*" + r"\s*,\s*".join(pieces) + r"\s*\]"


def _lists(*counts: int, number: str = NUMBER) -> str:
    return _list(*(_list(*[number] * n) for n in counts))


_ROBTARGET = re.compile(_lists(3, 4, 4, 6))
_STATEMENT = re.compile(r"[^;]*;?")
_DECLARED = re.compile(
    r"(?i)\b(?:CONST|PERS|VAR)\s+(?:robtarget|jointtarget)\s+(?P<name>\w+)\s*(?P<array>\{[^{}]*\})?\s*:=\s*"
)
_OTHER = re.compile(r"(?i)\b(?:CONST|PERS|VAR)\s+\w+\s+\Z")
_ASSIGNED = re.compile(
    r"(?i)(?<![\\\w.])(?P<name>[A-Z]\w*)\s*(?P<array>\{[^{}]*\})?\s*(?P<part>(?:\.\w+)*)\s*:=\s*"
)
_OFFSET = re.compile(
    r"(?i)(?P<how>Offs|RelTool)\s*\(\s*(?P<name>\w+)"
    + "".join(rf"\s*,\s*(?P<{axis}>{NUMBER})" for axis in "xyz")
    + rf"\s*(?P<turns>(?:,?\s*\\\s*R[xyz]\s*:=\s*{NUMBER}\s*)*+)\)"
)
_TURN = re.compile(rf"(?i)R(?P<axis>[xyz])\s*:=\s*(?P<deg>{NUMBER})")
_TEXT = r'(?:"(?:[^"]|"")*"|\w+)'
_POSE = _lists(3, 4, number=f"({NUMBER})")
_WOBJ = re.compile(
    rf"(?i)\bwobjdata\s+(\w+)\s*:=\s*\[\s*(TRUE|FALSE)\s*,\s*(TRUE|FALSE)\s*,\s*{_TEXT}\s*,\s*{_POSE}\s*,\s*{_POSE}\s*\]"
)
_TOOL = re.compile(rf"(?i)\btooldata\s+(\w+)\s*:=\s*\[\s*(TRUE|FALSE)\s*,\s*{_POSE}")
_MOVE = re.compile(
    r"(?i)(?<![\w.])(?P<how>(?:Move|Search|Trigg|Arc|Spot|Disp|Paint|Cap)[A-Za-z]*)(?:\s+|(?=\\))(?P<rest>[^;]*)"
)
_UNCHECKED = re.compile(r"(?i)(?<![\w.])Conf(?P<which>[LJ])\s*\\\s*Off\b")
_WITH = re.compile(r"(?i)\\\s*WObj\s*:=\s*(\w+)")
_NAME = re.compile(r"\s*(?P<name>[A-Za-z]\w*)\s*(?:\{[^{}]*\})?\s*")
_SWITCH = re.compile(r"(?:\\\s*\w+(?:\s*:=\s*\w+)?\s*)++\Z")
_NOT_IN_USE = (9e9, 0.0)
_NO_POSE = "the square of a quaternion of it is not 1"
_WRITES = "the program changes it while it runs"


class Rapid(Language):
    """RAPID modules."""

    name, title = "rapid", "ABB RAPID"
    form, configuration = Quaternion(), Quadrants()
    joint_units: ClassVar[Mapping[str, str]] = {"rad": "deg", "mm": "mm"}
    comment, quote = r"![^\r\n]*", r'"(?:[^"\r\n]|"")*"'
    words = Keywords(
        function=r"(?:LOCAL[ \t]+)?(?:PROC|FUNC|TRAP)\b",
        loop=r"(?:WHILE|FOR)\b",
        branch=r"(?:IF\b[^;\r\n]*\bTHEN\b|TEST\b)",
        turn=r"(?:ELSEIF|ELSE|CASE|DEFAULT)\b",
        close=r"END(?:PROC|FUNC|TRAP|WHILE|FOR|IF|TEST)\b",
        jump=r"(?:GOTO\b|TRAP\b|CallByVar\b|%[ \t])",
        parameter=r"(?P<name>\w+)\s*(?:\{[^{}]*\}\s*)?$",
        call=r"\b\w+\b",
    )
    constant = re.compile(f"{_ROBTARGET.pattern}|{_lists(6, 6)}")

    def assignments(self, mask: str) -> Iterator[Assignment]:
        """Yield the values that statements give; a part of one, where a condition stands before it in its line."""
        for m in _STATEMENT.finditer(mask):
            start, end = m.span()
            declared = _DECLARED.search(mask, start, end)
            given = declared or _ASSIGNED.search(mask, start, end)
            if given is None or (declared is None and _OTHER.search(mask, start, given.start())):
                continue
            last = given.end() + len(mask[given.end() : end].rstrip("; \t\r\n"))
            before = re.split(r"[\r\n]", mask[start : given.start()])[-1].strip()
            partly = bool(given["array"]) or (declared is None and bool(given["part"] or before))
            yield Assignment(given["name"], given.end(), last, partly)

    def motions(self, reader: Reader) -> Iterator[Motion]:
        _take_frames(reader)
        mask = reader.mask
        unchecked = {m["which"].upper() for m in _UNCHECKED.finditer(mask)}
        for m in _MOVE.finditer(mask):
            pieces = [bare_span(mask, span) for span in parts(mask, *m.span("rest"))]
            positional = [p for p in pieces if not mask.startswith("\\", p[0])]
            wobj = _WITH.search(mask, *m.span("rest"))
            tool = _NAME.match(mask, _tool_at(mask, m["how"], positional)) if len(positional) > 2 else None
            base, own = wobj[1].lower() if wobj else "wobj0", tool["name"].lower() if tool else None
            loose = ("J" if re.search(r"(?i)J|Abs", m["how"]) else "L") in unchecked
            about = 1 if re.match(r"(?i)(?:Move|Trigg)C", m["how"]) else 0  # an arc has two places
            for k, span in enumerate(positional[:-1]):
                goal = bare_span(mask, (span[0], span[0] + len(_SWITCH.sub("", mask[slice(*span)]))))
                if goal[0] == goal[1] or mask[goal[0]].isdigit():
                    continue
                frames = (None if name is None else reader.flow.scoped(name, goal[0]) for name in (base, own))
                base_name, tool_name = (BASE_ITSELF if n in ("wobj0", "tool0") else n for n in frames)
                is_known = "@" not in f"{base_name}{tool_name}"
                going = Going(base_name, tool_name, goal[0], sure=is_known, loose=loose)
                yield Motion(goal, going, optional=k > about)

    def target(self, reader: Reader, span: Span, *, is_used: bool) -> Target | str | None:
        """Return a robtarget or jointtarget; axes that a robot of fewer than six does not have are not in use."""
        numbers = numbers_in(reader.mask, *span)
        is_pose = _ROBTARGET.fullmatch(reader.mask, *span) is not None
        own, configuration, external = numbers[:7], numbers[7:11], numbers[11:]
        if not is_pose:
            unused = all(n.value in _NOT_IN_USE for n in numbers[reader.axes : 6])
            own, configuration, external = numbers[: reader.axes if unused else 6], [], numbers[6:]
        used = [n.text for n in external if n.value not in _NOT_IN_USE]
        if used:
            return f"external axes are in use ({', '.join(used)})"
        norm = sum(n.value * n.value for n in own[3:])
        if is_pose and not abs(norm - 1.0) <= 0.01:
            return f"its quaternion's square is {norm:.4g}, not 1"
        before = reader.mask[: span[0]].rpartition(";")[2]
        given = _DECLARED.search(before) or _ASSIGNED.search(before)
        name = given["name"] if given else "literal"
        return reader.target(span, name, "pose" if is_pose else "joints", own, configuration)

    def pose(self, text: str) -> Array | None:
        return None

    def factors(self, mask: str, span: Span) -> list[Span]:
        """Return the name of an element's array: which of its targets is meant is not known."""
        name = _NAME.fullmatch(mask, *span)
        return [name.span("name") if name else bare_span(mask, span)]

    def written(self, reader: Reader, span: Span) -> str | None:
        """Return the literal of ``Offs`` and ``RelTool`` of a robtarget by plain numbers."""
        m = _OFFSET.fullmatch(reader.mask, *span)
        reaching = reader.flow.reaching(m["name"], span[0]) if m else ()
        one = reaching[0] if len(reaching) == 1 else None
        text = reader.mask[one.start : one.end] if one is not None and one.is_whole else ""
        numbers = numbers_in(text, 0, len(text))
        if m is None or not _ROBTARGET.fullmatch(text) or not is_rigid([n.value for n in numbers[:7]]):
            return None
        return self._moved(m, text, numbers)

    def _moved(self, m: re.Match[str], text: str, numbers: list[Number]) -> str | None:
        """Return the literal ``text`` of a robtarget moved along the axes of its work object, or of the tool."""
        turns = {t["axis"].lower(): float(t["deg"]) for t in _TURN.finditer(m["turns"])}
        is_of_tool = m["how"].lower() == "reltool"
        if turns and not is_of_tool:
            return None
        values = np.array([[n.value for n in numbers[:7]]])
        pose = self.form.poses(values)[0]
        turn = Rotation.from_euler("XYZ", [turns.get(axis, 0.0) for axis in "xyz"], degrees=True).as_matrix()
        moved = pose_of(turn, [float(m[axis]) for axis in "xyz"])
        if is_of_tool:
            pose = pose @ moved
        else:
            pose[:3, 3] += moved[:3, 3]
        told = self.form.numbers(pose[None], values)[0].tolist()
        pairs = zip(told, numbers, strict=False)
        return replaced(text, [(n.start, n.end, n.text if v == n.value else f"{v:.10f}") for v, n in pairs])


def _tool_at(mask: str, how: str, positional: list[Span]) -> int:
    """Return where the tool's name stands: before its work object, else last, but for signals and calls behind it."""
    for a, b in positional:
        if _WITH.search(mask, a, b):
            return a
    behind = 2 if re.search(r"(?:DO|AO|GO)$", how, re.I) else 1 if how.lower().endswith("sync") else 0
    return positional[max(len(positional) - 1 - behind, 0)][0]


def _take_frames(reader: Reader) -> None:
    """Take the work objects and tools that a module states in numbers; names in lower case."""
    for pattern in (_WOBJ, _TOOL):
        for m in pattern.finditer(reader.text):
            if reader.mask[m.start()] != reader.text[m.start()]:
                continue  # in a comment
            name, (held, *rest) = m[1].lower(), m.groups()[1:]
            numbers = np.array([float(v) for v in rest if v[0] not in "TFtf"]).reshape(-1, 7)
            if pattern is _WOBJ and held.upper() == "TRUE":
                reader.unusable[name] = f"{name}: the robot holds this work object"
            elif pattern is _WOBJ and rest[0].upper() == "FALSE":
                reader.unusable[name] = f"{name}: a mechanical unit moves this work object"
            elif pattern is _TOOL and held.upper() == "FALSE":
                reader.unusable[name] = f"{name}: this tool stands in the cell"
            elif reader.flow.assigned(name, 0):
                reader.unusable[name] = f"{name}: {_WRITES}"
            elif pattern is _TOOL:
                reader.frames[name] = tuple(numbers[0].tolist())
            elif not all(is_rigid([0.0, 0.0, 0.0, *frame[3:]]) for frame in numbers):
                reader.unusable[name] = f"{name}: {_NO_POSE}"
            elif np.abs(numbers).max() <= LARGEST:
                user, own = Quaternion().poses(numbers)
                both = Quaternion().numbers((user @ own)[None], numbers[1:])
                reader.frames[name] = tuple(both[0].tolist())
