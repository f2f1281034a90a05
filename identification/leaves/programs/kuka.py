"""KUKA's KRL: positions in .src and .dat files.

Targets are constants ``{X 1, Y 2, ...}`` and ``{A1 1, A2 2, ...}`` behind a motion (PTP, LIN, CIRC, SPTP, SLIN, SCIRC, SPL) and
in variables of the types POS, E6POS, AXIS and E6AXIS, or of FRAME where a motion goes to them. Which base and tool a
target is told in comes from the FDAT of its name (taught points), else from ``$BASE`` and ``$TOOL``, ``BAS(#BASE, n)`` and
``BAS(#TOOL, n)`` before the motions to it, in the order of the text.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.flow import (
    ARGUMENT,
    SEVERAL,
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
    NUMBER,
    Euler,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Span,
    StatusTurn,
    Target,
    closing,
    in_order,
    masked,
    numbers_in,
    numbers_of,
    parts,
    shown,
)
from truepose.models.machine.machine import Machine

# -- Which base and tool the motions of a KRL program go by: followed through its text from top to bottom

_NULL = {"$NULLFRAME", "$WORLD", "$ROBROOT"}
_SET = re.compile(r"(?i)^[ \t]*\$(BASE|TOOL)(?P<part>\.\w+)?\s*=\s*(?P<what>[^\r\n]+?)\s*$")
_BAS = re.compile(r"(?i)^[ \t]*BAS\s*\(\s*#(BASE|TOOL)\s*,\s*(?P<n>\d+)\s*\)")
_FDAT_ACT = re.compile(r"(?i)^[ \t]*FDAT_ACT\s*=\s*(?P<name>\w+)")
_IPO = re.compile(r"(?i)^[ \t]*\$IPO_MODE\s*=\s*#(?P<mode>\w+)")
_FRAME_MOTION = re.compile(r"(?i)^[ \t]*(?P<how>S?PTP|S?LIN|S?CIRC|SPL)\b(?P<rest>[^\r\n]*)")
WORDS = Keywords(
    function=r"(?:GLOBAL[ \t]+)?(?:DEF|DEFFCT)\b",
    loop=r"(?:LOOP|WHILE|REPEAT|FOR)\b",
    branch=r"(?:IF|SWITCH)\b",
    turn=r"(?:ELSE|CASE|DEFAULT)\b",
    close=r"(?:END(?:FCT|LOOP|WHILE|FOR|IF|SWITCH)?|UNTIL)\b",
    jump=r"GOTO\b",
)
_FACTOR = re.compile(r"\{[^{}]*\}|[A-Za-z_]\w*+(?:[ \t]*\[[^\]]*\])?")
_PLACE = re.compile(rf"\s*+(?P<what>(?:{_FACTOR.pattern})(?:\s*:\s*(?:{_FACTOR.pattern}))*)\s*+(?P<rest>.*)")
_BEHIND = re.compile(r"(?:C_\w++\s*+)*+(?:WITH\b.*)?")
_FRAME_FIELD = re.compile(rf"(\w+)\s+({NUMBER})\s*(?=,|$)")
_FDAT = re.compile(r"(?i)\bFDAT\s+(?P<name>\w+)\s*=\s*\{(?P<fields>[^{}]*)\}")
_STATED = re.compile(r"(?<!\w)(?P<name>\$?\w+(?:\s*\[\s*\d+\s*\])?)\s*=\s*\{(?P<fields>[^{}]*)\}")
_NUMBERED = re.compile(
    r"(?im)^[ \t]*(?P<name>(?P<bare>\w+)\s*\[(?P<index>[^\]\r\n]*)\])\s*(?P<part>\.\w+)?\s*=(?!=)(?P<value>[^\r\n]*)"
)
_LINE = re.compile(r"[^\r\n]+")


@dataclass(frozen=True)
class Stand:
    """Names of the base and the tool in force, None where the text says nothing; ``fixed``: the robot holds the part.

    ``base_at`` and ``tool_at`` are where a name of the program's own was put in force.
    """

    base: str | None
    tool: str | None
    fixed: bool = False
    base_at: int | None = field(default=None, compare=False)
    tool_at: int | None = field(default=None, compare=False)


def fdats(mask: str) -> dict[str, Stand]:
    """Frames of taught points by name: FP1 tells of XP1 and of P1."""
    out: dict[str, Stand] = {}
    for m in _FDAT.finditer(mask):
        fields = dict(re.findall(r"(\w+)\s+(#?\w+)", m["fields"].upper()))
        base, tool = (fields.get(f"{which}_NO") for which in ("BASE", "TOOL"))
        stand = Stand(_numbered("BASE", base), _numbered("TOOL", tool), fields.get("IPO_FRAME") == "#TCP")
        bare = m["name"].upper().removeprefix("F")
        out |= {f"X{bare}": stand, bare: stand}
    return out


def frames(mask: str, file: str) -> dict[str, tuple[float, ...]]:
    """Frames whose six numbers a text states, by name; those of ``$BASE`` and ``$TOOL`` by their place in ``file``, too.

    What is stated with several numbers is not known.
    """
    out: dict[str, tuple[float, ...]] = {}
    several: set[str] = set()
    for m in _STATED.finditer(mask):
        name = re.sub(r"\s", "", m["name"]).upper()
        numbers = stated(m["fields"])
        if numbers is not None:
            own = f"{name}@{file}{m.end('name')}" if name in ("$BASE", "$TOOL") else name
            several |= {own} if out.setdefault(own, numbers) != numbers else set()
    return {name: numbers for name, numbers in out.items() if name not in several}


def changing(masks: Iterable[str]) -> set[str]:
    """Return names of numbered frames that texts give several values, or change by component; where the number is none to
    read, without it."""
    values: dict[str, set[str]] = {}
    out: set[str] = set()
    for m in (m for mask in masks for m in _NUMBERED.finditer(mask)):
        bare, name = m["bare"].upper(), re.sub(r"\s", "", m["name"]).upper()
        values.setdefault(name, set()).add(re.sub(r"\s", "", m["value"]).upper())
        if m["part"] or not m["index"].strip().isdigit() or len(values[name]) > 1:
            out.add(name if m["index"].strip().isdigit() else bare)
    return out


@dataclass(frozen=True)
class Motion:
    """What a motion goes to at ``start``: a product of ``factors`` (spans), the last of them its target.

    ``checked``: it goes from point to point; others do not look at status and turn. ``sure``: no other base and tool can be
    in force there.
    """

    start: int
    stand: Stand
    factors: tuple[Span, ...]
    checked: bool
    sure: bool


def motions(mask: str, taught: Mapping[str, Stand], file: str) -> Iterator[Motion]:
    """Yield the motions of a text; ``taught`` are the frames of taught points (``fdats``)."""
    settings = list(_settings(mask, taught, file))
    made = {(one.which, one.place): one for one in settings}
    flow = Flow.of(mask, WORDS, [Assignment(f"${one.which}", one.place, one.place) for one in settings])
    for line in _LINE.finditer(mask):
        text = line.group()
        motion = _FRAME_MOTION.match(text)
        if motion is None:
            continue
        start = line.start() + motion.start("rest")
        for span in parts(mask, start, line.end()):
            m = _PLACE.match(mask, *span)
            if m is None or not (m["what"].endswith("}") or _BEHIND.fullmatch(m["rest"])):
                continue
            factors = tuple(one.span() for one in _FACTOR.finditer(mask, *m.span("what")))
            stand, sure = _stand(flow, made, m.start("what"))
            yield Motion(m.start("what"), stand, factors, motion["how"].upper() in ("PTP", "SPTP"), sure)


def stated(text: str) -> tuple[float, ...] | None:
    """Return the numbers of a position in braces; None where one is missing, or no number."""
    told = dict(_FRAME_FIELD.findall(text.upper().strip("{} ")))
    return tuple(float(told[field]) for field in "XYZABC") if set(told) >= set("XYZABC") else None


@dataclass(frozen=True)
class _Setting:
    """A base, a tool, or that the tool is fixed, put in force by ``text``; ``at`` is where a name of the program's own is.

    ``partly``: only a component of what is in force is changed.
    """

    which: str
    place: int
    value: str | None
    text: str
    at: int | None = None
    partly: bool = False


def _settings(mask: str, taught: Mapping[str, Stand], file: str) -> Iterator[_Setting]:
    """Yield what puts frames in force, in the order of a text."""
    for line in _LINE.finditer(mask):
        text, place = line.group(), line.start()
        setting, bas, act, ipo = (p.match(text) for p in (_SET, _BAS, _FDAT_ACT, _IPO))
        if setting is not None:
            what = re.sub(r"\s", "", setting["what"]).upper()
            which = setting[1].upper()
            own = f"${which}@{file}{place + setting.end(1)}"
            name = BASE_ITSELF if what in _NULL else own if what.startswith("{") else what
            at = place + setting.start("what") if _FACTOR.fullmatch(what) else None
            yield _Setting(which, place, name, what, at, setting["part"] is not None)
        elif bas is not None:
            numbered = _numbered(bas[1].upper(), bas["n"])
            yield _Setting(bas[1].upper(), place, numbered, str(numbered))
        elif act is not None:
            stand = taught.get(f"X{act['name'].upper().removeprefix('F')}", Stand(None, None))
            for part, held in (("BASE", stand.base), ("TOOL", stand.tool)):
                yield _Setting(part, place, held, str(held))
            yield _Setting("FIXED", place, "#TCP" if stand.fixed else None, str(stand.fixed))
        elif ipo is not None:
            fixed = ipo["mode"].upper() == "TCP"
            yield _Setting("FIXED", place, "#TCP" if fixed else None, str(fixed))


def _stand(flow: Flow, made: Mapping[tuple[str, int], _Setting], place: int) -> tuple[Stand, bool]:
    """Return what is in force at a place, and whether nothing else can be."""
    last: dict[str, _Setting | None] = {}
    sure = True
    for which in ("BASE", "TOOL", "FIXED"):
        found = [made[which, one.start] if one else None for one in flow.in_force(f"${which}", place)]
        last[which] = found[-1]
        alike = len({one.text if one else None for one in found}) == 1
        # a name may have another value at each
        named = any(one is not None and one.at is not None for one in found)
        partly = any(one is not None and one.partly for one in found)
        sure = sure and alike and (len(found) == 1 or not named) and not partly
    base, tool, fixed = last["BASE"], last["TOOL"], last["FIXED"]
    stand = Stand(
        base.value if base else None, tool.value if tool else None, bool(fixed and fixed.value),
        base.at if base else None, tool.at if tool else None,
    )  # fmt: skip
    return stand, sure


def _numbered(which: str, number: str | None) -> str | None:
    """Name of a numbered frame; number 0 is none, one below zero says nothing."""
    if number is None or not number.isdigit():
        return None
    return BASE_ITSELF if int(number) == 0 else f"{which}_DATA[{int(number)}]"


# -- Motions of a KRL program: what each goes to, and in which frames, as far as its text and the file beside it tell

FIXED = "#TCP"
"""Name of the tool of motions whose tool stands in the cell."""
_MOVED_ASSIGNED = re.compile(
    r"(?im)^[ \t]*(?:(?:GLOBAL|DECL|CONST)[ \t]+)*(?:\w+[ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*(?P<index>\[[^\]\r\n]*\])?"
    r"(?P<part>(?:\.\w+)*)[ \t]*=(?!=)[ \t]*(?P<value>[^\r\n]*)"
)
_LITERAL = re.compile(r"\{[^{}]*\}")
_NAME = re.compile(r"[A-Za-z_]\w*")
_SEVERAL = "@"
"""Name of a base or tool that may have several values."""
_UNKNOWN = "its value is worked out while the program runs"
_UNSURE = "its base or its tool may have several values there"
Key = tuple[bool, int]
"""A literal: whether it is in the file beside, and where it begins."""


@dataclass
class Motions:
    """What ``follow`` collects: ``goings`` by literal, and literals that are ``features`` as well.

    ``masks`` are the program's own text and that of the file beside it. ``frames`` are numbers of poses that others are in;
    ``followed`` are places of own motions to poses in poses; ``worked_out`` are targets computed of constants.
    """

    masks: tuple[str, str]
    lines: Lines
    taught: Mapping[str, Stand]
    goings: dict[Key, list[Going]] = field(default_factory=dict)
    features: set[Key] = field(default_factory=set)
    frames: dict[str, tuple[float, ...]] = field(default_factory=dict)
    followed: set[int] = field(default_factory=set)
    worked_out: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)
    _flows: list[Flow] = field(default_factory=list)
    _changing: set[str] = field(default_factory=set)
    _parts: list[Key] = field(default_factory=list)
    """Literals that the expression in hand is made of."""

    def follow(self) -> None:
        """Look at every motion of both texts."""
        self._changing = changing(self.masks)
        given = [list(_assignments(mask)) for mask in self.masks]
        for k, mask in enumerate(self.masks):
            beside = [replace(one, file="beside") for one in given[1 - k]]
            self._flows.append(Flow.of(mask, WORDS, [*given[k], *beside]))
        for k, mask in enumerate(self.masks):
            for motion in motions(mask, self.taught, "beside:" if k else ""):
                self._take(bool(k), motion)

    def _take(self, other: bool, motion: Motion) -> None:
        *frames, leaf = motion.factors
        stand = motion.stand
        if not frames:
            stand = self.taught.get(_named(self.masks[other], leaf)[0].upper(), stand)
        named = ((stand.base, stand.base_at), (stand.tool, stand.tool_at))
        base, tool = (self._in_force(other, name, at) for name, at in named)
        if not motion.sure or _SEVERAL in (base, tool):
            self._keep(other, leaf)
            if not other:
                self.left.append(self.lines.left(motion.start, self.masks[0][slice(*leaf)], _UNSURE))
            return
        tool = FIXED if stand.fixed else tool
        self._parts.clear()
        names = [self._frame(other, span) for span in frames]
        if any(name is None for name in names):
            return
        within = tuple(name for name in names if name)
        going = Going(base, within, tool, motion.start, loose=not motion.checked, elsewhere=other)
        if self.masks[other].startswith("{", leaf[0]):
            self.goings.setdefault((other, leaf[0]), []).append(going)
            found = True
        else:
            found = self._take_name(other, leaf, going)
        if found and frames:
            self.features.update(self._parts)
            self.followed |= set() if other else {motion.start}

    def origins(self, product: Span) -> tuple[Span, ...]:
        """Return the literals that the first factor of an own product may be."""
        return self._flows[0].origins(self.masks[0], factors(self.masks[0], *product)[0], _LITERAL)

    def _keep(self, other: bool, span: Span) -> None:
        """Leave what a motion goes to as it is."""
        if self.masks[other].startswith("{", span[0]):
            self.features.add((other, span[0]))
            return
        for one in self._flows[other].reaching(_named(self.masks[other], span)[0], span[0]):
            self.features.add((other != bool(one.file), one.start))

    def _in_force(self, other: bool, name: str | None, at: int | None) -> str | None:
        """The name of a base or tool, with its place where the program gives it several values, of which one holds."""
        if name is None:
            return None
        if {name, name.partition("[")[0]} & self._changing:
            return _SEVERAL
        if at is None:
            return name
        self._parts.clear()
        pose = self._pose(other, (at, at + len(name)))
        self.features.update(self._parts)
        assigned = self._flows[other].assigned(name, at)
        if len(assigned) <= 1 and all(one.is_whole for one in assigned):
            return name
        if pose is None:
            return _SEVERAL
        own = f"{name}@{'beside:' if other else ''}{at}"
        self.frames[own] = numbers_of(Euler(), pose)
        return own

    def _take_name(self, other: bool, span: Span, going: Going) -> bool:
        """What a motion goes to that names a variable; return False where nothing is known of it."""
        name, whole = _named(self.masks[other], span)
        reaching = self._flows[other].reaching(name, span[0])
        going = replace(going, name=span, sure=len(reaching) == 1 and reaching[0].is_whole and whole)
        for one in reaching:
            key = (other != bool(one.file), one.start)
            mask = self.masks[key[0]]
            if mask.startswith("{", one.start) and ":" not in outside(mask[one.start : one.end]):
                self.goings.setdefault(key, []).append(going)
            elif other or one.partly:
                continue
            elif not one.parameter and (pose := self._pose(other, span)) is not None:
                self._work_out(name, pose, going)
            else:
                why = ARGUMENT if one.parameter else _UNKNOWN if len(reaching) == 1 else SEVERAL
                self.left.append(Left(self.lines.of(going.place), name, why))
        if not reaching and not other and not going.within:
            why = "its value is in neither this text nor the file beside it"
            self.left.append(self.lines.left(going.place, self.masks[0][slice(*span)], why))
        return bool(reaching)

    def _work_out(self, name: str, pose: Array, going: Going) -> None:
        """A target that has the value of an expression of constants: the motion gets a copy."""
        self.features.update(self._parts)
        pairs = zip("XYZABC", numbers_of(Euler(), pose), strict=True)
        literal = "{" + ",".join(f"{axis} {v:.6f}" for axis, v in pairs) + "}"
        bare = Target(0, name, "pose", tuple(numbers_in(literal, 0, len(literal))))
        self.worked_out += worked_out(
            replace(going, loose=False), going.name or (0, 0), bare, literal, self.lines
        )

    def _frame(self, other: bool, span: Span) -> str | None:
        """The name of a pose that another is in, its numbers known; None where they are not, or may be several."""
        pose = self._pose(other, span)
        if pose is None:
            return None
        name = f"{shown(self.masks[other][slice(*span)])}@{'beside:' if other else ''}{span[0]}"
        self.frames[name] = numbers_of(Euler(), pose)
        return name

    def _pose(self, other: bool, span: Span, depth: int = 0) -> Array | None:
        """The pose (4, 4), mm, of an expression of constants. What it is made of has to stay as it is."""
        mask, product = self.masks[other], np.eye(4)
        for start, end in factors(mask, *span):
            if mask.startswith("{", start):
                one = _constant(mask[start:end])
                self._parts.append((other, start))
            else:
                one = self._value(other, (start, end), depth)
            if one is None:
                return None
            product = product @ one
        return product

    def _value(self, other: bool, span: Span, depth: int) -> Array | None:
        name, whole = _named(self.masks[other], span)
        reaching = self._flows[other].reaching(name, span[0])
        if depth > 20 or not whole:
            return None
        poses = [self._pose(other != bool(one.file), (one.start, one.end), depth + 1) for one in reaching]
        return poses[0] if len(reaching) == 1 and reaching[0].is_whole else None


def factors(mask: str, start: int, end: int) -> list[Span]:
    """Spans of what `:` multiplies between two positions, without the space around."""
    out = []
    for m in re.compile(r"(?:\{[^{}]*\}|[^:{}])+").finditer(mask, start, end):
        piece = m.group()
        a, b = m.start() + len(piece) - len(piece.lstrip()), m.end() - len(piece) + len(piece.rstrip())
        out.append((a, max(a, b)))
    return out


def _assignments(mask: str) -> Iterator[Assignment]:
    for m in _MOVED_ASSIGNED.finditer(mask):
        start, end = m.span("value")
        partly = bool(m["index"]) or bool(m["part"])
        yield Assignment(m["name"], start, start + len(mask[start:end].rstrip()), partly=partly)


def _named(mask: str, span: Span) -> tuple[str, bool]:
    """The name in a span, and whether it is not that of an element or a component."""
    m = _NAME.match(mask, *span)
    return (m.group(), m.end() == span[1]) if m else ("", False)


def outside(text: str) -> str:
    """The text without what is in braces."""
    return re.sub(r"\{[^{}]*\}", "", text)


def _constant(text: str) -> Array | None:
    numbers = stated(text)
    return None if numbers is None else np.asarray(Euler().poses(np.array([numbers]))[0])


# -- KUKA's KRL: positions in .src and .dat files

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


class Kuka:
    """KRL, .src and .dat."""

    name, title = "kuka", "KUKA KRL"

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        mask, lines = masked(text, _COMMENT), Lines(text)
        other = "" if beside is None else masked(beside, _COMMENT)
        taught = fdats(other) | fdats(mask)
        went = Motions((mask, other), lines, taught)
        went.follow()
        types = _types(mask) | _types(other)
        count = len(machine.mechanism.readings) if machine else len(_JOINTS)
        both = ((mask, False), (other, True))
        readers = [_Reader(*one, lines, went, taught, types, count) for one in both]
        for reader in readers:
            reader.take()
        targets = [*(target for reader in readers for target in reader.targets), *went.worked_out]
        left = [
            *(one for reader in readers for one in reader.left),
            *_computed(mask, lines, went),
            *went.left,
        ]
        return Program(
            text, tuple(targets), in_order(left), Euler(), {"rad": "deg", "mm": "mm"},
            frames(other, _OTHER) | frames(mask, _OWN) | went.frames, StatusTurn(),
            again=functools.partial(self.read, machine=machine, beside=beside),
        )  # fmt: skip


def _computed(mask: str, lines: Lines, went: Motions) -> Iterator[Left]:
    """Yield motions to what the program works out while it runs."""
    motion = re.compile(r"(?im)^[ \t]*((?:S?PTP|S?LIN|S?CIRC|SPL)\b[^\r\n]*)")
    for m in motion.finditer(mask):
        what = m.group(1)
        pieces = parts(mask, m.start(1) + len(what.split()[0]), m.end(1))
        products = [p for p in pieces if ":" in outside(mask[slice(*p)])]
        if products and not any(p[0] <= place < p[1] for p in products for place in went.followed):
            origins = went.origins(products[0])
            why = "worked out by `:` while the program runs"
            yield lines.left(m.start(1), what, why, True, origins)
        elif re.match(r"(?i)\w+\s+[A-Z_]\w*\s*\(", what):
            why = "a function gives the point while the program runs"
            yield lines.left(m.start(1), what, why)
    component = re.compile(r"(?im)^[ \t]*(\w+(?:\[[^\]]*\])?\.(?:[XYZABC]|A[1-6])\s*=[^\r\n]*)")
    for m in component.finditer(mask):
        why = "the program changes a coordinate while it runs: it stands for what was written there, not corrected"
        yield lines.left(m.start(1), m.group(1), why, computed=True)


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
    """What the constants of one text are: the program's, or that of the file ``beside`` it, of which motions get copies.

    ``count`` is how many axes the robot has.
    """

    mask: str
    beside: bool
    lines: Lines
    went: Motions
    taught: dict[str, Stand]
    types: dict[str, str]
    count: int
    targets: list[Target] = field(default_factory=list)
    left: list[Left] = field(default_factory=list)

    def take(self) -> None:
        """Collect targets, and what is left."""
        for start, end in _aggregates(self.mask):
            begin = max(self.mask.rfind("\n", 0, start), self.mask.rfind("\r", 0, start)) + 1
            self._constant(begin, start, end)

    def _constant(self, begin: int, start: int, end: int) -> None:
        """A constant ``[start:end]`` on the line that begins at ``begin``."""
        before, key = self.mask[begin:start], (self.beside, start)
        assigned, motion = _ASSIGNED.match(before), _MOTION.match(before)
        goings = self.went.goings.get(key, [])
        if not goings and ((assigned is None and motion is None) or key in self.went.features):
            return
        fields = _fields(self.mask, start, end)
        if fields is None or not (set(fields) & {*_POSE, *_JOINTS}):
            if fields is None and self._is_position(assigned, motion, start, end):
                self._leave(begin, end, "not all of its coordinates are plain numbers")
            return
        if assigned is not None:
            self._assigned(assigned, fields, goings, begin, (start, end))
        elif motion is not None and motion["how"].upper().endswith("_REL"):
            self._leave(begin, end, "a relative motion: it starts where the motion before it ended")
        else:
            self._target(before.split(maxsplit=1)[0].upper(), fields, goings, begin, (start, end))

    def _assigned(
        self, assigned: re.Match[str], fields: dict[str, Number], goings: list[Going], begin: int, span: Span
    ) -> None:
        name = re.sub(r"\s", "", assigned["name"]).upper()
        if _FRAMES.match(name):
            return
        bare = name.partition("[")[0]
        kind = (assigned["type"] or "").upper() or self.types.get(bare, "")
        if not goings and kind == "FRAME":
            return  # a frame of the program's own
        if not kind and not goings and not {"S", "T"} & set(fields):
            self._leave(begin, span[1], "no motion here goes to it")
            return
        self._target(name, fields, goings, begin, span)

    def _target(
        self, name: str, fields: dict[str, Number], goings: list[Going], begin: int, span: Span
    ) -> None:
        kind: Kind = "joints" if "A1" in fields else "pose"
        names = self._axes(fields) if kind == "joints" else _POSE
        missing = [f for f in names if f not in fields]
        external = [f for f in fields if _EXTERNAL.fullmatch(f) and fields[f].value != 0.0]
        if missing:
            why = f"{', '.join(missing)} of it stay what they are when the robot comes there"
            self._leave(begin, span[1], why)
            return
        if external:
            used = ", ".join(f"{f} {fields[f].text}" for f in external)
            self._leave(begin, span[1], f"external axes are in use ({used})")
            return
        stand = self.taught.get(name.partition("[")[0], Stand(None, None))
        by_itself = Going(stand.base, (), FIXED if stand.fixed else stand.tool, begin, elsewhere=True)
        numbers = tuple(fields[f] for f in names)
        configured = {"S", "T"} <= set(fields) and kind == "pose"
        configuration = (fields["S"], fields["T"]) if configured else ()
        is_frame = (self.beside, span[0]) in self.went.features
        ways = ways_to(goings, is_frame=is_frame, in_frames=kind == "pose") or [Way((by_itself,), None)]
        for way in ways:
            if way.names is not None or not self.beside:
                self._way(way, Target(0, name, kind, numbers, configuration, place=begin), span)
        if not self.beside and ways[0].names is not None and any(one.elsewhere for one in goings):
            told = "; ".join(sorted({_stand_words(one) for one in goings}))
            self._leave(begin, span[1], f"used with several frames ({told}): its motions get copies")

    def _way(self, way: Way, bare: Target, span: Span) -> None:
        """Motions to a constant in the same frames: it is changed itself, or each of them gets a copy."""
        self.left += unsure(way, bare.name, self.lines)
        for target in targets_of(way, bare, self.mask, span, self.lines):
            if target.tool == FIXED and target.kind == "pose":
                why = "the tool is fixed in the cell and the robot holds the part (#TCP)"
                at = bare.place if way.names is None else target.place
                self.left.append(self.lines.left(at, self.mask[bare.place : span[1]], why))
            else:
                self.targets.append(replace(target, tool=None if target.tool == FIXED else target.tool))

    def _axes(self, fields: dict[str, Number]) -> tuple[str, ...]:
        """Names of the robot's axes; a robot of fewer than six has no others, or they are 0."""
        own, others = _JOINTS[: self.count], _JOINTS[self.count :]
        return own if all(f not in fields or fields[f].value == 0.0 for f in others) else _JOINTS

    def _is_position(
        self, assigned: re.Match[str] | None, motion: re.Match[str] | None, start: int, end: int
    ) -> bool:
        placed = re.match(r"(?i)\s*(?:\w+\s*:)?\s*(?:X|A1)\s", self.mask[start + 1 : end]) is not None
        return placed and (motion is not None or (assigned is not None and assigned["type"] is not None))

    def _leave(self, begin: int, end: int, why: str) -> None:
        if not self.beside:
            start = begin + len(self.mask[begin:end]) - len(self.mask[begin:end].lstrip())
            self.left.append(self.lines.left(start, self.mask[begin:end], why))


def _stand_words(going: Going) -> str:
    base, tool = (shown(name.partition("@")[0]) if name else "none" for name in (going.base, going.tool))
    return f"base {base} with tool {tool}"


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
