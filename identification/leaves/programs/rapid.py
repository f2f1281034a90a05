"""ABB's RAPID: robtargets and jointtargets in modules.

Targets are literals ``[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax...]]`` and ``[[six axes],[eax...]]``, in declarations or
in motions. The work object and the tool of one are those of the motions of this file that go to it.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

from truepose.identification.leaves.programs.configurations import Quadrants
from truepose.identification.leaves.programs.flow import Assignment, Flow, Keywords
from truepose.identification.leaves.programs.forms import Quaternion
from truepose.identification.leaves.programs.frames import shown_name
from truepose.identification.leaves.programs.program import (
    BASE_ITSELF,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Target,
    closing,
    in_order,
    masked,
    numbers_in,
    parts,
    shown,
)
from truepose.identification.leaves.programs.rapid_frames import Cell, Move, Moves, cell_of, moves
from truepose.identification.leaves.programs.rapid_offsets import Offset, offset_of
from truepose.identification.leaves.programs.rapid_statements import (
    ROBTARGET,
    Statement,
    literals,
    statements,
)
from truepose.identification.leaves.programs.roles import (
    ARGUMENT,
    Going,
    Way,
    targets_of,
    unsure,
    ways_to,
    worked_out,
)
from truepose.models.machine.machine import Machine

_COMMENT = r"![^\r\n]*"
_QUOTE = r'"(?:[^"\r\n]|"")*"'


_OFFSET = re.compile(r"(?i)\b(Offs|RelTool|ORobT|PoseMult|CRobT|CalcRobT|MirPos)\s*\(")
_NOT_IN_USE = (9e9, 0.0)
_WRITES = "the program changes it while it runs"
_WORDS = Keywords(
    function=r"(?:LOCAL[ \t]+)?(?:PROC|FUNC|TRAP)\b",
    loop=r"(?:WHILE|FOR)\b",
    branch=r"(?:IF\b[^;\r\n]*\bTHEN\b|TEST\b)",
    turn=r"(?:ELSEIF|ELSE|CASE|DEFAULT)\b",
    close=r"END(?:PROC|FUNC|TRAP|WHILE|FOR|IF|TEST)\b",
    jump=r"GOTO\b",
    parameter=r"(?P<name>\w+)\s*(?:\{[^{}]*\}\s*)?$",
)


class Rapid:
    """RAPID modules."""

    name, title = "rapid", "ABB RAPID"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, axes = masked(text, _COMMENT, _QUOTE), len(machine.mechanism.readings) if machine else 6
        said = list(statements(mask))
        flow = Flow.of(mask, _WORDS, _assignments(said))
        reader = _Reader(mask, Lines(text), cell_of(text, mask), moves(mask), said, flow, axes)
        reader.take()
        return Program(
            text, tuple(reader.targets), in_order(reader.left), Quaternion(), {"rad": "deg", "mm": "mm"},
            reader.cell.frames, Quadrants(), again=functools.partial(self.read, machine=machine, beside=beside),
        )  # fmt: skip


@dataclass
class _Reader:
    """One module: its literals, and which motions go to them. ``count`` is how many axes the robot has."""

    mask: str
    lines: Lines
    cell: Cell
    moved: Moves
    statements: list[Statement]
    flow: Flow
    count: int
    targets: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)

    def take(self) -> None:
        """Collect targets, and what is left."""
        changed = {name: _WRITES for name in self.cell.frames if self.flow.assigned(name, 0)}
        self.cell = Cell(self.cell.frames, {**self.cell.moved, **changed})
        goings = self._goings({s.start: s for s in self.statements})
        whole: dict[int, re.Match[str]] = {}
        unread: list[Statement] = []
        for statement in self.statements:
            found = list(literals(self.mask, statement))
            if statement.declared is not None and not found:
                unread.append(statement)
            for m, is_pose in found:
                if statement.name is None:
                    going = [self._going(move, m.start()) for move in self.moved.of_place(m.start())]
                    self._literal(m, is_pose, "literal", going)
                else:
                    self._literal(
                        m, is_pose, statement.declared or statement.name, goings.get(statement.start, [])
                    )
            if len(found) == 1 and not statement.array and found[0][1]:
                whole[statement.start] = found[0][0]
        followed = self._offsets(whole)
        self.left[:0] = self._computed(followed)
        for statement in unread:
            if statement.value[0] not in followed:
                why = "its value is no list of plain numbers"
                self._leave(statement.start, self.mask[statement.start : statement.end], why)

    def _goings(self, named: Mapping[int, Statement]) -> dict[int, list[Going]]:
        """Motions by the start of the statement that gives their target its value."""
        out: dict[int, list[Going]] = {}
        for name, several in self.moved.names.items():
            for move in several:
                reaching = self.flow.reaching(name, move.span[0])
                given = [named[one.start] for one in reaching if not one.parameter]
                if len(given) < max(len(reaching), 1) and move.sure:
                    why = ARGUMENT if reaching else "its value is not in this text"
                    self._leave(move.span[0], self.mask[slice(*move.span)], why)
                sure = len(reaching) == 1 and move.one and not any(one.array for one in given)
                going = replace(self._going(move, move.span[0]), name=move.span, sure=sure)
                for one in given:
                    if not one.partly:
                        out.setdefault(one.start, []).append(going)
        return out

    def _literal(self, m: re.Match[str], is_pose: bool, name: str, goings: list[Going]) -> None:
        numbers = numbers_in(self.mask, m.start(), m.end())
        own, configuration, external = (
            (numbers[:7], numbers[7:11], numbers[11:])
            if is_pose
            else (self._axes(numbers[:6]), [], numbers[6:])
        )
        if (why := _odd(is_pose, own, external)) is not None:
            self._leave(m.start(), f"{name} := {shown(m.group(), 40)}", why)
            return
        kind: Kind = "pose" if is_pose else "joints"
        bare = Target(0, name, kind, tuple(own), tuple(configuration), place=m.start())
        by_itself = Way((Going(None, (), None, m.start(), elsewhere=True),), None)
        for way in ways_to(goings, is_frame=False, in_frames=is_pose) or [by_itself]:
            self.left += unsure(way, name, self.lines)
            for target in targets_of(way, bare, self.mask, m.span(), self.lines):
                at = m.start() if way.names is None else target.place
                if is_pose and (why := self._held(target)) is not None:
                    self._leave(at, f"{name} := {shown(m.group(), 40)}", why)
                else:
                    self.targets.append(target)

    def _axes(self, numbers: list[Number]) -> list[Number]:
        """Values of the robot's axes; of a robot of fewer than six the others are not in use."""
        unused = all(n.value in _NOT_IN_USE for n in numbers[self.count :])
        return numbers[: self.count] if unused else numbers

    def _held(self, going: Going | Target) -> str | None:
        """Why nobody knows where the frames of a motion are."""
        for name in (going.base, going.tool):
            why = ARGUMENT if "@" in (name or "") else self.cell.moved.get(name or "")
            if name and why is not None:
                return f"{shown_name(name)}: {why}"
        return None

    def _offsets(self, whole: Mapping[int, re.Match[str]]) -> set[int]:
        """Take targets that are worked out of constants; return where."""
        values = {s.start: s.value for s in self.statements}
        said = [(move, move.span) for move in self.moved.others]
        for name, several in self.moved.names.items():
            for move in several:
                reaching = self.flow.reaching(name, move.span[0])
                if len(reaching) == 1 and move.one and reaching[0].start in values.keys() - whole.keys():
                    said.append((move, values[reaching[0].start]))
        followed: set[int] = set()
        for move, span in said:
            offset = offset_of(self.mask, span)
            reaching = self.flow.reaching(offset.name, span[0]) if offset else ()
            m = whole.get(reaching[0].start) if len(reaching) == 1 else None
            if offset is not None and m is not None and self._offset(offset, m, move):
                followed.add(span[0])
        return followed

    def _offset(self, offset: Offset, m: re.Match[str], move: Move) -> bool:
        """Take the target that a motion works out of a literal; return False where it cannot be corrected."""
        going, numbers = self._going(move, move.span[0]), numbers_in(self.mask, *m.span())
        if self._held(going) is not None or _odd(True, numbers[:7], numbers[11:]) is not None:
            return False
        literal = offset.literal(m.group(), numbers_in(m.group(), 0, len(m.group())))
        new = numbers_in(literal, 0, len(literal))
        bare = Target(0, shown(self.mask[slice(*move.span)]), "pose", tuple(new[:7]), tuple(new[7:11]))
        self.targets += worked_out(going, move.span, bare, literal, self.lines)
        return True

    def _going(self, move: Move, place: int) -> Going:
        base, tool = (
            None if name is None else BASE_ITSELF if name == null else self.flow.scoped(name, place)
            for name, null in ((move.wobj, "wobj0"), (move.tool, "tool0"))
        )
        return Going(base, (), tool, place, loose=not move.checked)

    def _computed(self, followed: set[int]) -> Iterator[Left]:
        """Yield places where targets are worked out while the program runs."""
        for m in _OFFSET.finditer(self.mask):
            if m.start() in followed:
                continue
            end, first = (
                self.mask.find(";", m.end()),
                parts(self.mask, m.end(), closing(self.mask, m.end() - 1) or m.end())[0],
            )
            text = shown(self.mask[m.start() : end if end >= 0 else m.end() + 40])
            origins = self.flow.origins(self.mask, first, ROBTARGET)
            yield Left(self.lines.of(m.start()), text, "worked out while the program runs", True, origins)
        for one in self.statements:
            if one.partly:
                why = "the program changes a target while it runs; what it writes is not corrected"
                what = shown(self.mask[one.start : one.end].rstrip("; "))
                yield Left(self.lines.of(one.start), what, why, computed=True)

    def _leave(self, place: int, what: str, why: str) -> None:
        self.left.append(Left(self.lines.of(place + len(what) - len(what.lstrip())), shown(what), why))


def _assignments(said: Iterable[Statement]) -> Iterator[Assignment]:
    for one in said:
        if one.name is not None:
            partly = one.partly or one.maybe or (one.array and one.declared is None)
            yield Assignment(one.name, one.start, one.end, partly=partly)


def _odd(is_pose: bool, own: list[Number], external: list[Number]) -> str | None:
    """Why a literal cannot be corrected in any frame."""
    if any(n.value not in _NOT_IN_USE for n in external):
        told = ", ".join(n.text for n in external if n.value not in _NOT_IN_USE)
        return f"external axes are in use ({told})"
    # a power that overflows is an error, a product is infinite
    norm = sum(n.value * n.value for n in own[3:])
    return f"its quaternion's square is {norm:.4g}, not 1" if is_pose and abs(norm - 1.0) > 0.01 else None
