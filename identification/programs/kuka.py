"""KUKA's KRL: positions in .src and .dat files.

Targets are constants ``{X 1, Y 2, ...}`` and ``{A1 1, A2 2, ...}`` behind a motion (PTP, LIN, CIRC, SPTP, SLIN, SCIRC, SPL) and
in variables of the types POS, E6POS, AXIS and E6AXIS, or of FRAME where a motion goes to them. Which base and tool a
target is told in comes from the FDAT of its name (taught points), else from ``$BASE`` and ``$TOOL``, ``BAS(#BASE, n)`` and
``BAS(#TOOL, n)`` before the motions to it, in the order of the text.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass, field

from truepose.identification.programs.configurations import StatusTurn
from truepose.identification.programs.forms import Euler
from truepose.identification.programs.krl_frames import Stand, fdats, frames, uses
from truepose.identification.programs.program import (
    NUMBER,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Target,
    closing,
    in_order,
    masked,
    parts,
    shown,
)
from truepose.models.machine import Machine

_COMMENT = r";[^\r\n]*|(?m:^[ \t]*&[^\r\n]*)"
_AGGREGATE = re.compile(r"\{")
_FIELD = re.compile(rf"\s*(\w+)\s+({NUMBER})\s*")
_TYPED = r"(?:(?:GLOBAL|DECL|CONST)\s+)*(?P<type>POS|E6POS|FRAME|AXIS|E6AXIS)\s+"
_ASSIGNED = re.compile(
    rf"(?i)^\s*(?:(?:GLOBAL|DECL|CONST)\s+)*(?:{_TYPED})?(?P<name>\$?\w+(?:\s*\[[^\]]*\])?(?:\.\w+)*)\s*=\s*$"
)
_DECLARED = re.compile(rf"(?im)^[ \t]*{_TYPED}(?P<names>[\w \t,\[\]]+)$")
_MOTION = re.compile(
    r"(?i)^\s*(?P<how>S?PTP|S?LIN|S?CIRC|SPL|S?(?:PTP|LIN|CIRC)_REL)\b\s*(?P<before>(?:[^,{}]*,|\{[^{}]*\}\s*,)?)\s*$"
)
_POSE, _JOINTS = ("X", "Y", "Z", "A", "B", "C"), ("A1", "A2", "A3", "A4", "A5", "A6")
_FRAMES = re.compile(r"(?i)^(?:\$BASE|\$TOOL|\$WORLD|\$ROBROOT|(?:BASE|TOOL)_DATA\[.*|\$?MACHINE_\w+.*)$")
_OWN, _OTHER = "", "beside:"
_EXTERNAL = re.compile(r"E[1-6]")


@dataclass
class _Found:
    """What is collected while a text is read."""

    targets: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)


class Kuka:
    """KRL, .src and .dat."""

    name, title = "kuka", "KUKA KRL"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, lines, found = masked(text, _COMMENT), Lines(text), _Found()
        other = "" if beside is None else masked(beside, _COMMENT)
        taught = fdats(other) | fdats(mask)
        used = uses(mask, taught, _OWN)
        for name, stands in uses(other, taught, _OTHER).items():
            own = used.setdefault(name, {})
            own |= {stand: ptp or own.get(stand, False) for stand, ptp in stands.items()}
        reader = _Reader(mask, lines, found, used, taught, _types(mask) | _types(other))
        for start, end in _aggregates(mask):
            begin = max(mask.rfind("\n", 0, start), mask.rfind("\r", 0, start)) + 1
            reader.take(begin, start, end)
        self._computed(mask, lines, found)
        return Program(
            text, tuple(found.targets), in_order(found.left), Euler(), {"rad": "deg", "mm": "mm"},
            frames(other, _OTHER) | frames(mask, _OWN), StatusTurn(),
            again=functools.partial(self.read, machine=machine, beside=beside),
        )  # fmt: skip

    def _computed(self, mask: str, lines: Lines, found: _Found) -> None:
        """Motions to what the program works out while it runs."""
        motion = re.compile(r"(?im)^[ \t]*((?:S?PTP|S?LIN|S?CIRC|SPL)\b[^\r\n]*)")
        for m in motion.finditer(mask):
            what = m.group(1)
            if ":" in re.sub(r"\{[^{}]*\}", "", what):
                why = "worked out by `:` while the program runs: it gets the correction of its first point"
                found.left.append(Left(lines.of(m.start(1)), shown(what), why, computed=True))
            elif re.match(r"(?i)\w+\s+[A-Z_]\w*\s*\(", what):
                found.left.append(
                    Left(
                        lines.of(m.start(1)), shown(what), "a function gives the point while the program runs"
                    )
                )
        component = re.compile(r"(?im)^[ \t]*(\w+(?:\[[^\]]*\])?\.(?:[XYZABC]|A[1-6])\s*=[^\r\n]*)")
        for m in component.finditer(mask):
            why = "the program changes a coordinate while it runs: it stands for what was written there, not corrected"
            found.left.append(Left(lines.of(m.start(1)), shown(m.group(1)), why, computed=True))


def _types(mask: str) -> dict[str, str]:
    """Types of positions by name, of declarations without values."""
    out: dict[str, str] = {}
    for m in _DECLARED.finditer(mask):
        names = re.findall(r"(\w+)\s*(?:\[[^\]]*\])?", m["names"])
        out |= {name.upper(): m["type"].upper() for name in names}
    return out


def _aggregates(mask: str) -> Iterator[tuple[int, int]]:
    """Spans of constants in braces, outermost ones."""
    at = 0
    while (found := _AGGREGATE.search(mask, at)) is not None:
        end = closing(mask, found.start())
        if end is None:
            at = found.end()
            continue
        yield found.start(), end + 1
        at = end + 1


@dataclass
class _Reader:
    """One text: what its constants are."""

    mask: str
    lines: Lines
    found: _Found
    used: dict[str, dict[Stand, bool]]
    taught: dict[str, Stand]
    types: dict[str, str]

    def take(self, begin: int, start: int, end: int) -> None:
        """A constant ``[start:end]`` on the line that begins at ``begin``."""
        before, line = self.mask[begin:start], self.lines.of(start)
        assigned, motion = _ASSIGNED.match(before), _MOTION.match(before)
        if assigned is None and motion is None:
            return
        fields = _fields(self.mask, start, end)
        if fields is None or not (set(fields) & {*_POSE, *_JOINTS}):
            if fields is None and self._is_position(assigned, motion, start, end):
                self._leave(line, begin, end, "not all of its coordinates are plain numbers")
            return
        if assigned is not None:
            self._assigned(assigned, fields, begin, end, line)
        elif motion is not None:
            how = motion["how"].upper()
            if how.endswith("_REL"):
                self._leave(line, begin, end, "a relative motion: it starts where the motion before it ended")
                return
            self._target(line, how, fields, self.used.get(f"{_OWN}@{start}", {}), begin, end)

    def _assigned(
        self, assigned: re.Match[str], fields: dict[str, Number], begin: int, end: int, line: int
    ) -> None:
        name = re.sub(r"\s", "", assigned["name"]).upper()
        kind = (assigned["type"] or "").upper()
        if _FRAMES.match(name):
            return
        bare = name.partition("[")[0]
        stands = self.used.get(bare, {})
        if bare in self.taught:
            stands = {self.taught[bare]: any(stands.values()) or not stands}
        kind = kind or self.types.get(bare, "")
        if kind == "FRAME" and not stands:
            return  # a base or a tool of the program's own
        if not kind and not stands and not {"S", "T"} & set(fields):
            self._leave(line, begin, end, "no motion here goes to it")
            return
        self._target(line, name, fields, stands, begin, end)

    def _target(
        self, line: int, name: str, fields: dict[str, Number], stands: dict[Stand, bool], begin: int, end: int
    ) -> None:
        kind: Kind = "joints" if "A1" in fields else "pose"
        names = _JOINTS if kind == "joints" else _POSE
        missing = [f for f in names if f not in fields]
        external = [f for f in fields if _EXTERNAL.fullmatch(f) and fields[f].value != 0.0]
        stand = next(iter(stands), Stand(None, None))
        why = None
        if missing:
            why = f"{', '.join(missing)} of it stay what they are when the robot comes there"
        elif external:
            why = f"external axes are in use ({', '.join(f'{f} {fields[f].text}' for f in external)})"
        elif len(stands) > 1 and kind == "pose":
            told = sorted(f"base {s.base or 'none'} with tool {s.tool or 'none'}" for s in stands)
            why = f"used with several frames ({'; '.join(told)})"
        elif stand.fixed and kind == "pose":
            why = "the tool is fixed in the cell and the robot holds the part (#TCP)"
        if why is not None:
            self._leave(line, begin, end, why)
            return
        chosen = ("S" in fields, "T" in fields)
        configuration = (fields["S"], fields["T"]) if all(chosen) and kind == "pose" else ()
        numbers = tuple(fields[f] for f in names)
        loose = bool(stands) and not any(stands.values())
        self.found.targets.append(
            Target(line, name, kind, numbers, configuration, stand.base, stand.tool, begin, loose=loose)
        )

    def _is_position(
        self, assigned: re.Match[str] | None, motion: re.Match[str] | None, start: int, end: int
    ) -> bool:
        inside = self.mask[start + 1 : end]
        typed = assigned is not None and assigned["type"] is not None
        return (motion is not None or typed) and re.match(
            r"(?i)\s*(?:\w+\s*:)?\s*(?:X|A1)\s", inside
        ) is not None

    def _leave(self, line: int, begin: int, end: int, why: str) -> None:
        self.found.left.append(Left(line, shown(self.mask[begin:end]), why))


def _fields(mask: str, start: int, end: int) -> dict[str, Number] | None:
    """Fields of a constant by name; None where one is no plain number."""
    typed = re.compile(r"\s*\w+\s*:").match(mask, start + 1, end - 1)
    out: dict[str, Number] = {}
    for a, b in parts(mask, typed.end() if typed else start + 1, end - 1):
        m = _FIELD.fullmatch(mask, a, b)
        if m is None:
            return None
        out[m.group(1).upper()] = Number(m.start(2), m.end(2), m.group(2))
    return out


__all__ = ["Kuka"]
