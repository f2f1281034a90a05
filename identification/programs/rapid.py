"""ABB's RAPID: robtargets and jointtargets in modules.

Targets are literals ``[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax...]]`` and ``[[six axes],[eax...]]``, in declarations or
in motions. The work object and the tool of one are those of the motions of this file that go to it.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator
from dataclasses import dataclass

from truepose.identification.programs.configurations import Quadrants
from truepose.identification.programs.forms import Quaternion
from truepose.identification.programs.program import (
    BASE_ITSELF,
    NUMBER,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Target,
    in_order,
    masked,
    numbers_in,
    shown,
)
from truepose.identification.programs.rapid_frames import Cell, Move, cell_of, moves
from truepose.models.machine import Machine

_COMMENT = r"![^\r\n]*"
_QUOTE = r'"(?:[^"\r\n]|"")*"'


def _list(count: int) -> str:
    return r"\[\s*" + r"\s*,\s*".join([NUMBER] * count) + r"\s*\]"


def _lists(*counts: int) -> str:
    return r"\[\s*" + r"\s*,\s*".join(_list(n) for n in counts) + r"\s*\]"


_ROBTARGET, _JOINTTARGET = re.compile(_lists(3, 4, 4, 6)), re.compile(_lists(6, 6))
_STATEMENT = re.compile(r"[^;]*;?")
_DECLARED = re.compile(
    r"(?i)\b(?:CONST|PERS|VAR)\s+(?P<type>robtarget|jointtarget)\s+(?P<name>\w+)\s*(?:\{[^{}]*\})?\s*:="
)
_OFFSET = re.compile(r"(?i)\b(Offs|RelTool|ORobT|PoseMult|CRobT|CalcRobT|MirPos)\s*\(")
_CHANGED = re.compile(r"(?i)^\s*(?P<what>\w+(?:\s*\{[^{}]*\})?\s*(?:\.\w+)+\s*:=.*)$", re.S)
_NOT_IN_USE = (9e9, 0.0)


@dataclass(frozen=True)
class _Statement:
    start: int
    end: int


class Rapid:
    """RAPID modules."""

    name, title = "rapid", "ABB RAPID"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, lines = masked(text, _COMMENT, _QUOTE), Lines(text)
        cell, moved = cell_of(text, mask), moves(mask)
        targets: list[Target] = []
        left: list[Left] = list(_computed(mask, lines))
        for statement in _statements(mask):
            declared = _DECLARED.search(mask, statement.start, statement.end)
            found = list(_literals(mask, statement))
            if declared is not None and not found:
                why = "its value is no list of plain numbers"
                left.append(
                    Left(lines.of(declared.start()), shown(mask[declared.start() : statement.end]), why)
                )
            for m, is_pose in found:
                name = declared["name"].lower() if declared else None
                uses = moved.of_name(name) if name else moved.of_place(m.start())
                one = _target(
                    mask, m, is_pose, declared["name"] if declared else "literal", uses, lines, cell
                )
                (targets if isinstance(one, Target) else left).append(one)  # type: ignore[arg-type]
        return Program(
            text, tuple(targets), in_order(left), Quaternion(), {"rad": "deg", "mm": "mm"}, cell.frames, Quadrants(),
            again=functools.partial(self.read, machine=machine, beside=beside),
        )  # fmt: skip


def _statements(mask: str) -> Iterator[_Statement]:
    for m in _STATEMENT.finditer(mask):
        if m.group().strip():
            yield _Statement(m.start(), m.end())


def _literals(mask: str, statement: _Statement) -> Iterator[tuple[re.Match[str], bool]]:
    for pattern in (_ROBTARGET, _JOINTTARGET):
        for m in pattern.finditer(mask, statement.start, statement.end):
            yield m, pattern is _ROBTARGET


def _target(
    mask: str, m: re.Match[str], is_pose: bool, name: str, uses: list[Move], lines: Lines, cell: Cell
) -> Target | Left:
    numbers = numbers_in(mask, m.start(), m.end())
    line = lines.of(m.start())
    own, configuration, external = (
        (numbers[:7], numbers[7:11], numbers[11:]) if is_pose else (numbers[:6], [], numbers[6:])
    )
    move = uses[0] if uses else Move(None, None)
    why = _reason(is_pose, own, external, uses, move, cell)
    if why is not None:
        return Left(line, f"{name} := {shown(m.group(), 40)}", why)
    kind: Kind = "pose" if is_pose else "joints"
    loose = bool(uses) and not any(use.checked for use in uses)
    base, tool = _named(move.wobj, "wobj0"), _named(move.tool, "tool0")
    return Target(line, name, kind, tuple(own), tuple(configuration), base, tool, m.start(), loose=loose)


def _reason(
    is_pose: bool, own: list[Number], external: list[Number], uses: list[Move], move: Move, cell: Cell
) -> str | None:
    """Why a literal cannot be corrected."""
    if any(n.value not in _NOT_IN_USE for n in external):
        told = ", ".join(n.text for n in external if n.value not in _NOT_IN_USE)
        return f"external axes are in use ({told})"
    if not is_pose:
        return None
    if len(set(uses)) > 1:
        told = "; ".join(sorted(f"{m.wobj or 'wobj0'} with {m.tool or 'tool0'}" for m in set(uses)))
        return f"used with several frames ({told})"
    for name in (move.wobj, move.tool):
        if name is not None and name in cell.moved:
            return f"{name}: {cell.moved[name]}"
    # a power that overflows is an error, a product is infinite
    norm = sum(n.value * n.value for n in own[3:])
    if abs(norm - 1.0) > 0.01:
        return f"its quaternion's square is {norm:.4g}, not 1"
    return None


def _named(name: str | None, null: str) -> str | None:
    return BASE_ITSELF if name == null else name


def _computed(mask: str, lines: Lines) -> Iterator[Left]:
    """Places where targets are worked out while the program runs."""
    for m in _OFFSET.finditer(mask):
        end = mask.find(";", m.end())
        text = shown(mask[m.start() : end if end >= 0 else m.end() + 40])
        why = "worked out while the program runs: it gets the correction of its target"
        yield Left(lines.of(m.start()), text, why, computed=True)
    for statement in _statements(mask):
        changed = _CHANGED.match(mask[statement.start : statement.end].rstrip(";"))
        if changed is not None:
            at = statement.start + changed.start("what")
            why = "the program changes a target while it runs; what it writes is not corrected"
            yield Left(lines.of(at), shown(changed["what"]), why, computed=True)


__all__ = ["Rapid"]
