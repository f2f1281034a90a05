"""What a text says, whatever its language: the targets that motions go to, the frames they go by, and what is left as it is.

A correction belongs to a target in its frames. So a constant is corrected where it is written if all motions go to it in the
same frames and nothing takes it for a frame. Otherwise it stays, and each motion gets a corrected copy of its own. A file
that belongs to the program (KUKA's .dat) is read behind it as one text; only what stands in the program itself is changed.
"""

from __future__ import annotations

import functools
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from truepose.arrays import Array
from truepose.identification.leaves.programs.configurations import Configuration
from truepose.identification.leaves.programs.flow import Assignment, Flow, Keywords
from truepose.identification.leaves.programs.pose_forms import Form, numbers_of
from truepose.identification.leaves.programs.program import (
    BASE_ITSELF,
    Copies,
    Kind,
    Left,
    Lines,
    Number,
    Program,
    Span,
    Target,
    in_order,
    masked,
    shown,
)
from truepose.models.machine.machine import Machine

SEVERAL = "@"
"""Name of a frame that may have several values."""
UNUSED = "no motion here goes to it"
_ARGUMENT = "calls of its function give it its value"
_SEVERAL = "motions go to it in several ways, and what they name may have several values there"
_UNSURE = "its base, tool or feature may have several values there"
_UNKNOWN = "its value is not in this text"
_COMPUTED = (
    "worked out while the program runs: it gets the correction of what it starts from, if that has one"
)
_CHANGED = "the program changes a target while it runs; what it writes is not corrected"
_COPIED = "used with several frames, or as a frame: its motions get copies"
_DEEPEST = 20
"""Names of names that are followed."""


@dataclass(frozen=True)
class Going:
    """A motion to a constant: the names of its frames (as in ``Target``), and where in the text it is.

    ``name``: the span of text that names the constant, None where the constant itself is there; ``sure``: no other value, and
    of a motion no other frames, can be there; ``near``, ``loose`` as in ``Target``.
    """

    base: str | None
    tool: str | None
    place: int = field(compare=False)
    within: tuple[str, ...] = ()
    name: Span | None = field(default=None, compare=False)
    sure: bool = field(default=True, compare=False)
    near: tuple[float, ...] | None = field(default=None, compare=False)
    loose: bool = field(default=False, compare=False)


@dataclass(frozen=True)
class Motion:
    """What a motion goes to, and how. An ``optional`` goal may as well be no target: a speed, a zone."""

    goal: Span
    going: Going
    optional: bool = False


class Language(ABC):
    """A way of writing programs: its patterns, and what its constants and motions mean.

    ``constant`` finds constants of targets; ``element`` finds names; ``skipped`` is what may be gone to and is found otherwise.
    """

    name: str
    title: str
    form: Form
    joint_units: ClassVar[Mapping[str, str]]
    configuration: Configuration | None = None
    comment: str
    quote = r'"[^"\r\n]*"'
    words: Keywords
    constant: re.Pattern[str]
    element = re.compile(r"[A-Za-z_]\w*")
    skipped = re.compile(r"(?!)")
    has_base = True
    """Whether a base holds for all motions behind it, so that a motion in a feature is in that base, too."""

    def read(self, text: str, machine: Machine, beside: str | None = None) -> Program:
        """Return what a text says; ``beside`` is the text of the file that belongs to it."""
        axes = len(machine.mechanism.readings) if machine else 6
        reader = Reader(self, text, beside or "", axes)
        reader.take()
        again = functools.partial(self.read, machine=machine, beside=beside)
        return Program(
            text, tuple(reader.targets), in_order(reader.left), self.form, self.joint_units, reader.frames,
            self.configuration, again,
        )  # fmt: skip

    @abstractmethod
    def assignments(self, mask: str) -> Iterator[Assignment]:
        """Yield what a text assigns: to variables, and to the frames that are in force."""

    @abstractmethod
    def motions(self, reader: Reader) -> Iterator[Motion]:
        """Yield what motions go to."""

    @abstractmethod
    def target(self, reader: Reader, span: Span, *, is_used: bool) -> Target | str | None:
        """Return the target that a constant is by itself, why it is not corrected, or None for what is no target."""

    @abstractmethod
    def pose(self, text: str) -> Array | None:
        """Return the pose (4, 4), mm, of a constant; None where it is none."""

    @abstractmethod
    def written(self, reader: Reader, span: Span) -> str | None:
        """Return the constant that an expression is worth; None where the text does not tell."""

    def factors(self, mask: str, span: Span) -> list[Span]:
        """Return the factors of a product of poses."""
        return [bare_span(mask, span)]

    def setting(self, reader: Reader, one: Assignment, called: str) -> str | None:
        """Return the frame that is put in force: None where nothing says which, ``SEVERAL`` where it may be several."""
        found = None if one.partly else reader.frame((one.start, one.end), called)
        return SEVERAL if found is None else found


class Reader:
    """One text: its targets, and what is ``left``.

    ``frames`` are numbers of frames by name; ``unusable`` says why others are not known. ``axes`` is how many the robot has.
    """

    def __init__(self, language: Language, text: str, beside: str, axes: int) -> None:
        self.language, self.length, self.axes = language, len(text), axes
        self.text = f"{text}\n{beside}"
        self.mask = masked(self.text, language.comment, language.quote)
        self.lines = Lines(text)
        self._assignments = list(language.assignments(self.mask))
        self.flow = Flow(self.mask, language.words, self._assignments)
        self.frames: dict[str, tuple[float, ...]] = {}
        self.unusable: dict[str, str] = {}
        self.targets: list[Target] = []
        self.left: list[Left] = []
        self._goings: dict[int, list[Going]] = {}
        self._kept: set[int] = set()
        """Starts of constants that have to stay: they are frames, or motions go to them in frames that nobody knows."""

    def take(self) -> None:
        """Collect targets, and what is left."""
        for motion in self.language.motions(self):
            self._take_motion(motion)
        for m in self.language.constant.finditer(self.mask):
            self._take_constant(m.span())
        names = {target.name.lower() for target in self.targets}
        for one in self._assignments:
            if one.partly and one.name.lower() in names and not self._constants((one.start, one.end)):
                begin, end = self.line(one.start)
                self.leave(one.start, self.mask[begin:end], _CHANGED)

    def leave(self, place: int, what: str, why: str) -> None:
        """List what stands at a place of the program itself."""
        if place < self.length:
            self.left.append(Left(self.lines.of(place), shown(what), why))

    def line(self, place: int) -> Span:
        """Return where the line of a place begins and ends."""
        begin = max(self.mask.rfind("\n", 0, place), self.mask.rfind("\r", 0, place)) + 1
        end = re.compile(r"[^\r\n]*").match(self.mask, place)
        return begin, end.end() if end else place

    def target(
        self, span: Span, name: str, kind: Kind, numbers: list[Number], configuration: list[Number]
    ) -> Target:
        """Return what a constant says of a target by itself."""
        line = self.lines.of(span[0])
        return Target(line, name, kind, tuple(numbers), tuple(configuration), place=span[0])

    def in_force(self, name: str, place: int) -> tuple[str | None, bool]:
        """Return the frame that is in force at a place, None for none, and whether no other can be."""
        held = self.flow.reaching(name, place)
        frames = [None if one is None else self.language.setting(self, one, name) for one in held]
        for one in held:
            self.keep((one.start, one.end) if one else (0, 0))
        alike = {None if name is None else self.frames.get(name, name) for name in frames}
        return frames[-1], len(alike) == 1 and SEVERAL not in alike

    def frame(self, span: Span, called: str = "") -> str | None:
        """Return the name of a pose, its numbers known where the text has them; None where they may be several.

        An expression is ``called`` this.
        """
        start, end = bare_span(self.mask, span)
        piece = self.mask[start:end]
        if self.language.element.fullmatch(piece):
            return self.named_frame(piece, start)
        pose = self.pose((start, end))
        if pose is None:
            return None
        name = f"{called or shown(piece)}@{start}"
        self.frames[name] = numbers_of(self.language.form, pose)
        return name

    def named_frame(self, name: str, place: int) -> str | None:
        """Return what ``frame`` does, of a name."""
        reaching = self.flow.reaching(name, place)
        if reaching == (None,):
            return name
        pose = self._pose_of_name(name, place, 0)
        if pose is None or reaching[0] is None:
            return None
        own = name if len(self.flow.assigned(name, place)) == 1 else f"{name}@{reaching[0].start}"
        self.frames[own] = numbers_of(self.language.form, pose)
        return own

    def pose(self, span: Span, depth: int = 0) -> Array | None:
        """Return the pose (4, 4), mm, of an expression of constants; None where the text does not tell."""
        product = np.eye(4)
        for start, end in self.language.factors(self.mask, span):
            piece = self.mask[start:end]
            if self.language.constant.fullmatch(piece):
                one = self.language.pose(piece)
            elif self.language.element.fullmatch(piece) and depth < _DEEPEST:
                one = self._pose_of_name(piece, start, depth)
            else:
                one = None
            if one is None:
                return None
            product = product @ one
        return product

    def keep(self, span: Span) -> None:
        """Leave the constants that an expression may be made of as they are, its names followed."""
        spans = {span: None}
        queue = [span]
        for one in queue:
            for m in self.language.element.finditer(self.mask, *one):
                reaching = self.flow.reaching(m.group(), m.start())
                new = [(a.start, a.end) for a in reaching if a is not None and not a.parameter]
                queue += [a for a in new if a not in spans]
                spans.update(dict.fromkeys(new))
        self._kept |= {m.start() for one in queue for m in self.language.constant.finditer(self.mask, *one)}

    def _pose_of_name(self, name: str, place: int, depth: int) -> Array | None:
        reaching = self.flow.reaching(name, place)
        only = reaching[0] if len(reaching) == 1 else None
        return None if only is None or not only.is_whole else self.pose((only.start, only.end), depth + 1)

    def _take_motion(self, motion: Motion) -> None:
        """Follow one goal of a motion to its constants."""
        *outer, leaf = self.language.factors(self.mask, motion.goal)
        going, piece, goal = motion.going, self.mask[slice(*leaf)], self.mask[slice(*motion.goal)]
        if self.language.skipped.match(piece):
            return
        is_name = self.language.element.fullmatch(piece) is not None
        reaching = self.flow.reaching(piece, leaf[0]) if is_name else ()
        is_constant = self.language.constant.fullmatch(piece) is not None
        if motion.optional and not is_constant and (not is_name or reaching == (None,)):
            return
        frames = [self.frame(span) for span in outer]
        if not going.sure or None in frames:
            self.keep(motion.goal)
            self.leave(going.place, goal, _UNSURE)
            return
        if outer and going.base is None and not self.language.has_base:
            going = replace(going, base=BASE_ITSELF)
        going = replace(going, within=tuple(name for name in frames if name))
        if reaching == (None,):
            self.leave(going.place, goal, _COMPUTED if outer else _UNKNOWN)
            return
        if is_constant:
            self._goings.setdefault(leaf[0], []).append(going)
        elif is_name:
            only = len(reaching) == 1 and reaching[0] is not None and reaching[0].is_whole
            self._take_name(replace(going, name=leaf, sure=only), [one for one in reaching if one], piece)
        else:
            self._work_out(replace(going, name=leaf), leaf, goal)
        for span in outer:
            self.keep(span)

    def _take_name(self, going: Going, reaching: list[Assignment], name: str) -> None:
        """Follow a motion to what its name may be there."""
        for one in reaching:
            value = bare_span(self.mask, (one.start, one.end))
            constants = self._constants(value)
            if one.parameter:
                self.leave(going.place, name, _ARGUMENT)
            elif constants:
                several = replace(going, sure=going.sure and len(constants) == 1)
                for start in constants:
                    self._goings.setdefault(start, []).append(several)
            elif one.partly or self.language.skipped.match(self.mask, *value):
                continue
            elif going.sure:
                self._work_out(going, value, name)
            else:
                self.leave(going.place, name, _SEVERAL)

    def _constants(self, span: Span) -> list[int]:
        """Return the starts of constants where a value is one, or a list of them."""
        piece = self.mask[slice(*span)]
        if re.fullmatch(r"[\[\],\s]*", self.language.constant.sub("", piece)) is None:
            return []
        return [m.start() for m in self.language.constant.finditer(self.mask, *span)]

    def _work_out(self, going: Going, span: Span, what: str) -> None:
        """Take the target that a motion has by an expression of constants: the motion gets a copy."""
        text = self.language.written(self, span)
        if text is None or going.name is None:
            self.leave(going.place, what, _COMPUTED)
            return
        if going.place >= self.length:
            return
        inside = Reader(self.language, text, "", self.axes)
        bare = self.language.target(inside, (0, len(text)), is_used=True)
        if isinstance(bare, Target):
            bare = replace(bare, name=shown(what), line=self.lines.of(going.place))
            self._add_copies(bare, text, [going])

    def _take_constant(self, span: Span) -> None:
        """Take a constant: it is changed itself, or the motions of each way to it get a copy."""
        goings, text = self._goings.get(span[0], []), self.mask[slice(*span)]
        is_kept, is_own = span[0] in self._kept, span[0] < self.length
        if is_kept and not goings:
            return
        bare = self.language.target(self, span, is_used=bool(goings))
        if not isinstance(bare, Target):
            if bare is not None:
                begin, end = self.line(span[0])
                self.leave(span[0], self.mask[begin : max(end, span[1])], bare)
            return
        ways: dict[Going | None, list[Going]] = {}
        for one in goings:
            ways.setdefault(one if bare.kind == "pose" else None, []).append(one)
        if len(ways) <= 1 and not is_kept:
            if is_own:
                self._add(_gone_to(bare, goings, self.length))
            return
        if is_own and any(one.place >= self.length for one in goings):
            self.leave(span[0], f"{bare.name} = {text}", _COPIED)
        spans = [
            Number(n.start - span[0], n.end - span[0], n.text) for n in (*bare.numbers, *bare.configuration)
        ]
        count = len(bare.numbers)
        moved = replace(bare, numbers=tuple(spans[:count]), configuration=tuple(spans[count:]))
        for way in ways.values():
            self._add_copies(moved, text, [one for one in way if one.place < self.length])

    def _add_copies(self, bare: Target, text: str, goings: list[Going]) -> None:
        """Add a target that motions in the same frames name: each gets a copy of its constant, ``text``."""
        named = [(one, one.name) for one in goings if one.sure and one.name is not None]
        for one in goings:
            if not one.sure:
                self.leave(one.place, bare.name, _SEVERAL)
        if named:
            first = [one for one, _ in named]
            line = self.lines.of(first[0].place)
            target = replace(_gone_to(bare, first, self.length), line=line)
            self._add(replace(target, copies=Copies(text, tuple(name for _, name in named))))

    def _add(self, target: Target) -> None:
        frames = [name for name in (target.base, target.tool, *target.within) if name]
        why = next((self.unusable[name] for name in frames if name in self.unusable), None)
        if target.kind == "joints":
            self.targets.append(replace(target, base=None, tool=None, within=()))
        elif why is not None:
            self.leave(target.place, target.name, why)
        else:
            self.targets.append(target)


def _gone_to(bare: Target, goings: list[Going], length: int) -> Target:
    """Return a target with the frames of the motions that go to it, those before ``length`` its places."""
    if not goings:
        return bare
    own = [one for one in goings if one.place < length]
    first = (own or goings)[0]
    places = tuple(one.place for one in own)
    return replace(
        bare, base=first.base, tool=first.tool, within=first.within, near=first.near, places=places,
        place=places[0] if places else bare.place, loose=all(one.loose for one in goings),
    )  # fmt: skip


def bare_span(text: str, span: Span) -> Span:
    """Return a span without the space around it."""
    piece = text[slice(*span)]
    start = span[0] + len(piece) - len(piece.lstrip())
    return start, max(start, span[1] - len(piece) + len(piece.rstrip()))
