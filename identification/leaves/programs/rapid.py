"""ABB's RAPID: robtargets and jointtargets in modules.

Targets are literals ``[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax...]]`` and ``[[six axes],[eax...]]``, in declarations or
in motions. The work object and the tool of one are those of the motions of this file that go to it.
"""

from __future__ import annotations

import bisect
import functools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array
from truepose.identification.leaves.programs.flow import (
    ARGUMENT,
    Assignment,
    Flow,
    Going,
    Keywords,
    Way,
    targets_of,
    unsure,
    ways_to,
    worked_out,
)
from truepose.identification.leaves.programs.program import (
    BASE_ITSELF,
    LARGEST,
    NUMBER,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Quadrants,
    Quaternion,
    Span,
    Target,
    closing,
    in_order,
    masked,
    numbers_in,
    parts,
    replaced,
    shown,
    shown_name,
)
from truepose.models.lie import pose_of
from truepose.models.machine.machine import Machine

# -- Statements of a RAPID module, the values they give to names, and literals of targets in them


def _list(*pieces: str) -> str:
    return r"\[\s*" + r"\s*,\s*".join(pieces) + r"\s*\]"


def _lists(*counts: int, number: str = NUMBER) -> str:
    return _list(*(_list(*[number] * n) for n in counts))


ROBTARGET, _JOINTTARGET = re.compile(_lists(3, 4, 4, 6)), re.compile(_lists(6, 6))
_STATEMENT = re.compile(r"[^;]*;?")
_DECLARED = re.compile(
    r"(?i)\b(?:CONST|PERS|VAR)\s+(?P<type>robtarget|jointtarget)\s+(?P<name>\w+)\s*(?P<array>\{[^{}]*\})?\s*:=\s*"
)
_OTHER = re.compile(r"(?i)\b(?:CONST|PERS|VAR)\s+\w+\s+\Z")
_ASSIGNED = re.compile(
    r"(?i)(?<![\\\w.])(?P<name>[A-Z]\w*)\s*(?P<array>\{[^{}]*\})?\s*(?P<part>(?:\.\w+)*)\s*:=\s*"
)


@dataclass(frozen=True)
class Statement:
    """The text ``[start:end]``. A ``value`` is given to ``name`` (lower case), ``declared`` as written there.

    ``array``: to elements of an array; ``partly``: to a component; ``maybe``: under a condition that stands in the statement.
    """

    start: int
    end: int
    name: str | None = None
    declared: str | None = None
    value: Span = (0, 0)
    array: bool = False
    partly: bool = False
    maybe: bool = False


def statements(mask: str) -> Iterator[Statement]:
    """Yield the statements of a module whose comments and strings are blank."""
    for m in _STATEMENT.finditer(mask):
        if not m.group().strip():
            continue
        start, end = m.span()
        declared = _DECLARED.search(mask, start, end)
        given = declared or _ASSIGNED.search(mask, start, end)
        if given is None or (declared is None and _OTHER.search(mask, start, given.start())):
            yield Statement(start, end)
            continue
        value = given.end(), given.end() + len(mask[given.end() : end].rstrip("; \t\r\n"))
        name, own = given["name"].lower(), declared["name"] if declared else None
        before = re.split(r"[\r\n]", mask[start : given.start()])[-1]
        partly = declared is None and bool(given["part"])
        yield Statement(
            given.start(), end, name, own, value, given["array"] is not None, partly, not declared and bool(before.strip())
        )  # fmt: skip


def literals(mask: str, statement: Statement) -> Iterator[tuple[re.Match[str], bool]]:
    """Yield the literals of a statement, and whether each is a pose."""
    for pattern in (ROBTARGET, _JOINTTARGET):
        for m in pattern.finditer(mask, statement.start, statement.end):
            yield m, pattern is ROBTARGET


# -- RAPID's ``Offs`` and ``RelTool`` of constants: targets that a module works out, as literals

_CALL = re.compile(
    r"(?i)(?P<how>Offs|RelTool)\s*\(\s*(?P<name>\w+)"
    + "".join(rf"\s*,\s*(?P<{axis}>{NUMBER})" for axis in "xyz")
    + rf"\s*(?P<turns>(?:,?\s*\\\s*R[xyz]\s*:=\s*{NUMBER}\s*)*+)\)"
)
_TURN = re.compile(rf"(?i)R(?P<axis>[xyz])\s*:=\s*(?P<deg>{NUMBER})")


@dataclass(frozen=True)
class Offset:
    """A target ``name`` (lower case) that is moved (4, 4), mm, along the axes of its work object or ``of_tool``."""

    name: str
    moved: Array
    of_tool: bool

    def literal(self, text: str, numbers: Sequence[Number]) -> str:
        """Return the literal of the moved target, of that of the target with these numbers in it."""
        form, values = Quaternion(), np.array([[n.value for n in numbers[:7]]])
        pose = form.poses(values)[0]
        new = pose @ self.moved if self.of_tool else pose.copy()
        new[:3, 3] += 0.0 if self.of_tool else self.moved[:3, 3]
        told = form.numbers(new[None], values)[0].tolist()
        texts = [n.text if v == n.value else f"{v:.10f}" for v, n in zip(told, numbers, strict=False)]
        return replaced(text, [(n.start, n.end, new) for n, new in zip(numbers, texts, strict=False)])


def offset_of(mask: str, span: Span) -> Offset | None:
    """Return what a motion goes to, where that is an offset by plain numbers."""
    m = _CALL.fullmatch(mask, *span)
    if m is None:
        return None
    turns = {t["axis"].lower(): float(t["deg"]) for t in _TURN.finditer(m["turns"])}
    of_tool = m["how"].lower() == "reltool"
    if turns and not of_tool:
        return None
    turn = Rotation.from_euler("XYZ", [turns.get(axis, 0.0) for axis in "xyz"], degrees=True).as_matrix()
    moved = pose_of(turn, [float(m[axis]) for axis in "xyz"])
    return Offset(m["name"].lower(), moved, of_tool)


# -- Work objects and tools of a RAPID module, and which of them its motions go by

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


@dataclass(frozen=True)
class Move:
    """The names of the work object and tool of a motion; None where nothing tells. ``checked``: it looks at configurations.

    ``span`` is what it goes to; ``one``: that names one value, not an element of an array; ``sure``: where it stands in the
    motion nothing else can.
    """

    wobj: str | None
    tool: str | None
    checked: bool = field(default=True, compare=False)
    span: Span = field(default=(0, 0), compare=False)
    one: bool = field(default=True, compare=False)
    sure: bool = field(default=False, compare=False)


@dataclass(frozen=True)
class Moves:
    """Motions by the name (lower case) of their target, and in the order of the text with where they begin and end.

    ``others`` go to what is neither a name nor a literal.
    """

    names: Mapping[str, list[Move]]
    spans: list[tuple[int, int, Move]]
    others: list[Move]

    def of_place(self, start: int) -> list[Move]:
        k = bisect.bisect_right(self.spans, start, key=lambda one: one[0]) - 1
        return [self.spans[k][2]] if k >= 0 and start < self.spans[k][1] else []


@dataclass(frozen=True)
class Cell:
    """Numbers (x y z q1 q2 q3 q4) of frames by name, and why others of them cannot be known."""

    frames: Mapping[str, tuple[float, ...]]
    moved: Mapping[str, str]


def moves(mask: str) -> Moves:
    """All motions of a module whose comments and strings are blank."""
    names: dict[str, list[Move]] = {}
    spans: list[tuple[int, int, Move]] = []
    others: list[Move] = []
    unchecked = {m["which"].upper() for m in _UNCHECKED.finditer(mask)}
    for m in _MOVE.finditer(mask):
        start, end = m.span("rest")
        pieces = parts(mask, start, end)
        wobj = _WITH.search(mask, start, end)
        positional = [p for p in pieces if not mask[slice(*p)].lstrip().startswith("\\")]
        tool = _NAME.match(mask, _tool_at(mask, m["how"], positional)) if len(positional) > 2 else None
        kind = "J" if re.search(r"(?i)J|Abs", m["how"]) else "L"
        named = wobj[1].lower() if wobj else "wobj0", tool["name"].lower() if tool else None
        move = Move(*named, kind not in unchecked)
        spans.append((start, end, move))
        about = 1 if re.match(r"(?i)(?:Move|Trigg)C", m["how"]) else 0  # an arc has two places
        for k, (a, b) in enumerate(positional[:-1]):
            bare = re.sub(r"\\\s*\w+(?:\s*:=\s*\w+)?", "", mask[a:b])
            name = _NAME.fullmatch(bare)
            at = a + len(mask[a:b]) - len(mask[a:b].lstrip())
            if name is not None:
                to = replace(move, span=(at, at + len(name["name"])), one="{" not in bare, sure=k <= about)
                names.setdefault(name["name"].lower(), []).append(to)
            elif mask[at : at + 1].isalpha():
                others.append(replace(move, span=(at, a + len(mask[a:b].rstrip()))))
    return Moves(names, spans, others)


def _tool_at(mask: str, how: str, positional: list[tuple[int, int]]) -> int:
    """Where the tool's name stands: before its work object, else last, but for signals and calls behind it."""
    for a, b in positional:
        if _WITH.search(mask, a, b):
            return a
    behind = 2 if re.search(r"(?:DO|AO|GO)$", how, re.I) else 1 if how.lower().endswith("sync") else 0
    return positional[max(len(positional) - 1 - behind, 0)][0]


def cell_of(text: str, mask: str) -> Cell:
    """Work objects and tools that a module states in numbers; names in lower case."""
    frames: dict[str, tuple[float, ...]] = {}
    moved: dict[str, str] = {}
    for m in _WOBJ.finditer(text):
        if mask[m.start()] != text[m.start()]:
            continue  # in a comment
        name, held, fixed, *numbers = m.groups()
        if held.upper() == "TRUE":
            moved[name.lower()] = "the robot holds this work object"
        elif fixed.upper() == "FALSE":
            moved[name.lower()] = "a mechanical unit moves this work object"
        else:
            user, own = np.array(numbers, dtype=float).reshape(2, 7)
            if not all(abs(float(np.sum(np.clip(f[3:], -9.0, 9.0) ** 2)) - 1.0) <= 0.01 for f in (user, own)):
                moved[name.lower()] = "the square of a quaternion of it is not 1"
            elif max(np.abs(user).max(), np.abs(own).max()) <= LARGEST:
                frames[name.lower()] = _product(user, own)
    for m in _TOOL.finditer(text):
        if mask[m.start()] != text[m.start()]:
            continue
        name, held, *numbers = m.groups()
        if held.upper() == "FALSE":
            moved[name.lower()] = "this tool stands in the cell"
        else:
            frames[name.lower()] = tuple(float(n) for n in numbers)
    return Cell(frames, moved)


def _product(first: Array, second: Array) -> tuple[float, ...]:
    """Numbers of one frame in another."""
    a, b = (Rotation.from_quat(f[[4, 5, 6, 3]]) for f in (first, second))
    place = first[:3] + a.apply(second[:3])
    x, y, z, w = (a * b).as_quat()
    return (*place.tolist(), w, x, y, z)


# -- ABB's RAPID: robtargets and jointtargets in modules

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
                going = goings.get(statement.start, [])
                if statement.name is None:
                    going = [self._going(move, m.start()) for move in self.moved.of_place(m.start())]
                self._literal(m, is_pose, statement.declared or statement.name or "literal", going)
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
        own, configuration, external = numbers[:7], numbers[7:11], numbers[11:]
        if not is_pose:
            own, configuration, external = self._axes(numbers[:6]), [], numbers[6:]
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
            end = self.mask.find(";", m.end())
            first = parts(self.mask, m.end(), closing(self.mask, m.end() - 1) or m.end())[0]
            text = self.mask[m.start() : end if end >= 0 else m.end() + 40]
            origins = self.flow.origins(self.mask, first, ROBTARGET)
            yield self.lines.left(m.start(), text, "worked out while the program runs", True, origins)
        for one in self.statements:
            if one.partly:
                why = "the program changes a target while it runs; what it writes is not corrected"
                yield self.lines.left(
                    one.start, self.mask[one.start : one.end].rstrip("; "), why, computed=True
                )

    def _leave(self, place: int, what: str, why: str) -> None:
        self.left.append(self.lines.left(place + len(what) - len(what.lstrip()), what, why))


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
