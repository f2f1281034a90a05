"""A robot program as what can be corrected in it: targets, the spans of their numbers, and what is left as it is.

Texts are decoded as Latin-1, one character a byte, so that whatever stands between the numbers is written back as it was.

Numbers of a target that choose among the joints which reach its pose: status and turn (KUKA), quadrants (ABB).

Both are read from joint values as the controller shows them, so the machine file's joints must be the controller's
axes, with its zeros and directions.

Ways of writing a pose as numbers: Euler angles, quaternions, rotation vectors; and of writing one number.

Several sets of numbers mean the same rotation. The one next to the numbers that stood there before is taken, so that
a small correction changes them little.

The frames that a program's targets are told in, as poses: from the program, from the user, or the machine file's.
"""

from __future__ import annotations

import bisect
import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from truepose.arrays import Array, Mask
from truepose.errors import InputError
from truepose.models import lie
from truepose.models.units import convert

# -- Numbers of a target that choose among the joints which reach its pose: status and turn (KUKA), quadrants (ABB)

SLACK = math.radians(0.05)
"""rad: a joint so near a sign's or a quadrant's border counts as on either side: targets are rounded."""
_QUARTER = math.pi / 2


@dataclass(frozen=True)
class StatusTurn:
    """KUKA's S and T. A bit of T is set where its axis is below zero. Bits of S: the wrist is behind axis 1 (overhead); it is
    behind the lower arm (axis 3 below its stretched position); axis 5 is below zero."""

    def fits(self, numbers: tuple[float, ...], q: Array) -> Mask:
        """(m,) joints q (m, nq), rad, whose signs are those of the configuration."""
        turn = int(numbers[1])
        out = np.ones(len(q), dtype=bool)
        for k in range(6):
            out &= q[:, k] < SLACK if turn >> k & 1 else q[:, k] > -SLACK
        return out

    def decides(self, numbers: tuple[float, ...], shape: Mask) -> Mask:
        """(m,) shapes (m, 3) of the arm that are those of the configuration: it tells apart joints that all fit."""
        return _has_bits(shape, numbers[0], (0, 1, 2))

    def renewed(self, numbers: tuple[float, ...], q: Array) -> tuple[float, ...] | None:
        """The numbers at joints (nq,) a correction away; None where the robot would be in another configuration."""
        status, turn = int(numbers[0]), int(numbers[1])
        now = 0
        for k in range(6):
            was = bool(turn >> k & 1)
            now |= (q[k] < (1e-12 if was else -1e-12)) << k
        if (now ^ turn) & 16:  # axis 5 through zero: the wrist is singular there
            return None
        return (float(status), float(now | turn & ~63))


@dataclass(frozen=True)
class Quadrants:
    """ABB's cf1, cf4, cf6: the quarter turns that axes 1, 4 and 6 stand in, from zero, and cfx, which tells the rest.

    Bits of cfx: axis 5 is negative; the wrist's centre is behind the lower arm; it is behind axis 1.
    """

    def fits(self, numbers: tuple[float, ...], q: Array) -> Mask:
        """(m,) joints q (m, nq), rad, whose quadrants are those of the configuration."""
        out = np.ones(len(q), dtype=bool)
        for quadrant, k in zip(numbers, (0, 3, 5), strict=False):
            low = quadrant * _QUARTER
            out &= (q[:, k] > low - SLACK) & (q[:, k] < low + _QUARTER + SLACK)
        return out

    def decides(self, numbers: tuple[float, ...], shape: Mask) -> Mask:
        """(m,) as of ``StatusTurn``."""
        return _has_bits(shape, numbers[3], (2, 1, 0))

    def renewed(self, numbers: tuple[float, ...], q: Array) -> tuple[float, ...] | None:
        """The numbers at joints (nq,) a correction away."""
        now = []
        for quadrant, k in zip(numbers, (0, 3, 5), strict=False):
            low = quadrant * _QUARTER
            stays = low - 1e-12 <= q[k] <= low + _QUARTER + 1e-12
            now.append(quadrant if stays else float(math.floor(q[k] / _QUARTER)))
        return (*now, *numbers[3:])


Configuration = StatusTurn | Quadrants
"""What a target's configuration means for joints, and for how the arm stands with them (``shape``)."""


def _has_bits(shape: Mask, number: float, places: tuple[int, ...]) -> Mask:
    return np.asarray((shape == [bool(int(number) >> k & 1) for k in places]).all(axis=1))


# -- Ways of writing a pose as numbers: Euler angles, quaternions, rotation vectors; and of writing one number

_LOCKED = 1e-9
"""Cosine of the middle angle below which the other two only count together."""


@dataclass(frozen=True)
class Euler:
    """x y z in mm and A B C in deg, Rz(A) Ry(B) Rx(C): KUKA."""

    decimals: tuple[int, ...] = (4, 4, 4, 6, 6, 6)
    words: str = "x,y,z,a,b,c in mm and deg"

    def poses(self, numbers: Array) -> Array:
        turn = Rotation.from_euler("ZYX", numbers[:, 3:], degrees=True).as_matrix()
        return lie.pose_of(turn, numbers[:, :3])

    def numbers(self, poses: Array, near: Array) -> Array:
        angles = np.array([_euler(pose[:3, :3], old) for pose, old in zip(poses, near[:, 3:], strict=True)])
        return np.hstack([poses[:, :3, 3], angles.reshape(-1, 3)])


@dataclass(frozen=True)
class Quaternion:
    """x y z in mm and a quaternion, its scalar first: ABB. The norm of the numbers that stood there is kept."""

    decimals: tuple[int, ...] = (4, 4, 4, 8, 8, 8, 8)
    words: str = "x,y,z,q1,q2,q3,q4 in mm"

    def poses(self, numbers: Array) -> Array:
        turn = Rotation.from_quat(numbers[:, [4, 5, 6, 3]]).as_matrix()
        return lie.pose_of(turn, numbers[:, :3])

    def numbers(self, poses: Array, near: Array) -> Array:
        quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
        sign = np.where(np.sum(quaternion * near[:, 3:], axis=1) < 0, -1.0, 1.0)
        norm = np.linalg.norm(near[:, 3:], axis=1)
        return np.hstack([poses[:, :3, 3], (sign * norm)[:, None] * quaternion])


@dataclass(frozen=True)
class RotationVector:
    """x y z and a rotation vector, in units of their own: Universal Robots (m, rad), tables of points."""

    lengths: tuple[str, str, str]
    angles: tuple[str, str, str]
    decimals: tuple[int, ...]
    words: str

    def poses(self, numbers: Array) -> Array:
        place = np.column_stack([convert(numbers[:, k], u, "mm") for k, u in enumerate(self.lengths)])
        turn = np.column_stack([convert(numbers[:, 3 + k], u, "rad") for k, u in enumerate(self.angles)])
        return lie.pose_of(lie.exp_so3(turn), place)

    def numbers(self, poses: Array, near: Array) -> Array:
        turn = lie.log_so3(poses[:, :3, :3])
        old = np.column_stack([convert(near[:, 3 + k], u, "rad") for k, u in enumerate(self.angles)])
        turn = np.array([_whole_turns(a, b) for a, b in zip(turn, old, strict=True)]).reshape(-1, 3)
        return np.column_stack(
            [
                *(convert(poses[:, k, 3], "mm", u) for k, u in enumerate(self.lengths)),
                *(convert(turn[:, k], "rad", u) for k, u in enumerate(self.angles)),
            ]
        )


Form = Euler | Quaternion | RotationVector
"""How a pose is written. ``decimals`` (k,): at least so many are written of each number; ``words`` names the numbers.

``poses`` (n, 4, 4), mm, of numbers (n, k); ``numbers`` (n, k) of poses, of those that mean the same the ones next to ``near``.
"""


def numbers_of(form: Form, pose: Array) -> tuple[float, ...]:
    """Return the numbers of one pose (4, 4), mm."""
    return tuple(form.numbers(pose[None], np.zeros((1, len(form.decimals))))[0].tolist())


def _euler(rotation: Array, old: Array) -> Array:
    """(3,) A B C in deg of a rotation (3, 3), next to ``old`` (3,)."""
    cosine = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    if cosine < _LOCKED:  # A and C count together: A stays
        a = np.radians(old[0])
        rest = Rotation.from_euler("Z", -a).as_matrix() @ rotation
        b, c = np.arctan2(-rest[2, 0], rest[0, 0]), np.arctan2(-rest[1, 2], rest[1, 1])
    else:
        a = np.arctan2(rotation[1, 0], rotation[0, 0])
        b = np.arctan2(-rotation[2, 0], cosine)
        c = np.arctan2(rotation[2, 1], rotation[2, 2])
    one = np.degrees([a, b, c])
    both = [one, np.array([one[0] + 180.0, 180.0 - one[1], one[2] + 180.0])]
    near = [angles + 360.0 * np.round((old - angles) / 360.0) for angles in both]
    return min(near, key=lambda angles: float(np.sum((angles - old) ** 2)))


def _whole_turns(vector: Array, old: Array) -> Array:
    """The rotation vector (3,) by whole turns next to ``old`` (3,), rad."""
    angle = float(np.linalg.norm(vector))
    size = float(np.linalg.norm(old))
    if angle < 1e-12:
        axis = old / size if size > np.pi else np.zeros(3)
    else:
        axis = vector / angle
    about = float(axis @ old)
    turns = np.round((about - angle) / (2 * np.pi)) + np.array([-1, 0, 1])
    near = [(angle + 2 * np.pi * k) * axis for k in turns]
    return min([vector, *near], key=lambda v: float(np.sum((v - old) ** 2)))


def written(value: float, before: str, decimals: int) -> str:
    """A number in the style of the text ``before`` it: no fewer decimals, its plus sign; the same text where it rounds
    to the same."""
    mantissa, _, exponent = before.lower().partition("e")
    there = len(mantissa.partition(".")[2]) - int(exponent or 0)
    places = max(decimals, there)
    if round(value, places) == round(float(before), places):
        return before
    out = f"{value:.{places}f}"
    if "." in out:  # zeros that tell nothing, but for as many as stood there
        least = len(out.partition(".")[0]) + 1 + max(there, 1)
        out = out[:least] + out[least:].rstrip("0")
    if float(out) == 0.0:
        out = out.lstrip("-")
    return f"+{out}" if before.startswith("+") and not out.startswith("-") else out


# -- A robot program as what can be corrected in it: targets, the spans of their numbers, and what is left as it is

Kind = Literal["pose", "joints"]
Span = tuple[int, int]
NUMBER = r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?"
WHOLE_NUMBER = re.compile(NUMBER)
_BRACKET = re.compile(r"[][(){}]")
LARGEST = 1e9
"""mm, deg: a coordinate beyond is none."""
BASE_ITSELF = ""
"""Name of the frame that is the robot's base itself; as a tool's name, of the flange."""


@dataclass(frozen=True)
class Number:
    """A number of a text: ``text[start:end]``."""

    start: int
    end: int
    text: str

    @property
    def value(self) -> float:
        return float(self.text)


@dataclass(frozen=True)
class Copies:
    """Where motions name a target whose own numbers have to stay: each gets a literal of its own there.

    ``literal`` is its text, in which the target's numbers and those of its configuration are; ``names`` are the spans of the
    program's text that it takes the place of.
    """

    literal: str
    names: tuple[Span, ...]


@dataclass(frozen=True)
class Target:
    """A place that a program sends the robot to, in one way: several motions go there with the same frames.

    ``numbers`` are those of its pose in the order of the program's ``Form``, or of its joints; ``configuration`` are those that
    choose among solutions. ``base`` and ``tool`` name the frames it is told in: None is what the user says, ``BASE_ITSELF``
    none; ``within`` are frames inside the base, the outermost first. ``place`` is where in the text the program first goes
    there, ``places`` all; ``near`` are joints next to which it goes, as written. ``loose``: the controller does not look at
    the configuration there, so that no joints need to have it. ``copies``: where it is written instead of its own place.
    """

    line: int
    name: str
    kind: Kind
    numbers: tuple[Number, ...]
    configuration: tuple[Number, ...] = ()
    base: str | None = None
    tool: str | None = None
    place: int = 0
    near: tuple[float, ...] | None = None
    loose: bool = False
    within: tuple[str, ...] = ()
    places: tuple[int, ...] = ()
    copies: Copies | None = None


@dataclass(frozen=True)
class Left:
    """What is not corrected, or not as it would have to be: its line, what stands there, and why."""

    line: int
    what: str
    why: str


@dataclass(frozen=True)
class Program:
    """Targets of a text in its order. ``frames`` are the work objects, bases and tools whose numbers it states itself."""

    text: str
    targets: tuple[Target, ...]
    left: tuple[Left, ...]
    form: Form
    joint_units: Mapping[str, str]
    """Units of joints in the text, by their unit inside (rad, mm)."""
    frames: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    configuration: Configuration | None = None
    again: Callable[[str], Program] | None = field(default=None, compare=False)
    """Reads another text of the same kind, beside the same file."""


class Lines:
    """Lines of positions in a text, from 1."""

    def __init__(self, text: str) -> None:
        self._ends = [m.end() for m in re.finditer(r"\r\n|\n|\r", text)]

    def of(self, position: int) -> int:
        """The line that a position stands in."""
        return bisect.bisect_right(self._ends, position) + 1


def masked(text: str, comment: str, quote: str = r'"[^"\r\n]*"') -> str:
    """The text with comments and strings as spaces, every other character in its place."""
    return re.sub(f"{quote}|{comment}", lambda m: " " * len(m.group()), text)


def numbers_in(text: str, start: int, end: int) -> list[Number]:
    """The numbers between two positions."""
    found = WHOLE_NUMBER.finditer(text, start, end)
    return [Number(m.start(), m.end(), m.group()) for m in found]


def parts(text: str, start: int, end: int, mark: str = ",") -> list[tuple[int, int]]:
    """Spans between two positions, parted by ``mark`` outside of all brackets."""
    out, depth, begin = [], 0, start
    for k in range(start, end):
        if text[k] in "([{":
            depth += 1
        elif text[k] in ")]}":
            depth -= 1
        elif text[k] == mark and depth == 0:
            out.append((begin, k))
            begin = k + 1
    return [*out, (begin, end)]


def closing(text: str, opening: int) -> int | None:
    """Where the bracket that opens at a position closes; None where it does not."""
    return _closings(text).get(opening)


@functools.lru_cache(maxsize=2)
def _closings(text: str) -> Mapping[int, int]:
    """Where each bracket closes: all of a text in one pass, as a text may open many that never do."""
    out, opened = dict[int, int](), list[int]()
    for m in _BRACKET.finditer(text):
        if m.group() in "([{":
            opened.append(m.start())
        elif opened:
            out[opened.pop()] = m.start()
    return out


def shown(text: str, most: int = 60) -> str:
    """A piece of a program in one line of a message."""
    words = " ".join(text.encode("latin-1", "replace").decode("utf-8", "replace").split())
    return words if len(words) <= most else words[: most - 3] + "..."


def replaced(text: str, edits: Iterable[tuple[int, int, str]]) -> str:
    """The text with what is to stand at spans of it."""
    out, at = [], 0
    for start, end, new in sorted(edits):
        out += [text[at:start], new]
        at = end
    return "".join([*out, text[at:]])


def in_order(left: Sequence[Left]) -> tuple[Left, ...]:
    """By line, each once."""
    return tuple(sorted(dict.fromkeys(left), key=lambda one: one.line))


# -- The frames that a program's targets are told in, as poses


@dataclass(frozen=True)
class Cell:
    """What the user says of frames, each as numbers in the program's own way of writing a pose.

    ``base`` and ``tool`` are those of targets for which the program says none; None is the robot's base, and the machine file's
    tool. ``frames`` are work objects, bases, features and tools that the program names, by name.
    """

    base: str | None = None
    tool: str | None = None
    frames: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Told:
    """Frames of a target: ``base`` (4, 4) in the robot's base; ``tool`` (4, 4) on the flange, None for the machine file's.

    ``assumed`` says which of a program's names was taken for what, where its numbers are not known.
    """

    base: Array
    tool: Array | None
    assumed: str | None = None


class Frames:
    """The frames of one program. Raises InputError for numbers that are no pose."""

    def __init__(self, program: Program, cell: Cell) -> None:
        self._program = program
        stated = {
            name.lower(): np.array(numbers) for name, numbers in program.frames.items() if is_rigid(numbers)
        }
        given = {name.lower(): self._numbers(f"--frame {name}", v) for name, v in cell.frames.items()}
        named = {one.lower() for t in program.targets for one in (t.base, t.tool, *t.within) if one}
        odd = [name for name in cell.frames if name.lower() not in set(map(shown_name, named))]
        if odd and named:
            known = ", ".join(sorted(set(map(shown_name, named))))
            raise InputError(
                f"--frame: found the name {odd[0]!r}, expected one that targets are told in: {known}"
            )
        self._known = stated | {name: given[shown_name(name)] for name in named if shown_name(name) in given}
        self._base = None if cell.base is None else self._pose(self._numbers("--base", cell.base))
        self._tool = None if cell.tool is None else self._pose(self._numbers("--tool", cell.tool))
        self._unknown_tools = {
            t.tool.lower() for t in program.targets if t.tool and t.tool.lower() not in self._known
        }

    def of(self, target: Target) -> Told | str:
        """Frames of a target, or why they are not known."""
        if target.kind == "joints":
            return Told(np.eye(4), None)
        base = np.eye(4) if self._base is None or target.base is not None else self._base
        for name in (target.base, *target.within):
            if name:
                numbers = self._known.get(name.lower())
                if numbers is None:
                    return self._missing("told in", name)
                base = base @ self._pose(numbers)
        tool = self._tool_of(target)
        return tool if isinstance(tool, str) else Told(base, *tool)

    def _tool_of(self, target: Target) -> tuple[Array | None, str | None] | str:
        if target.tool is None:
            return self._tool, None
        if target.tool == BASE_ITSELF:
            return np.eye(4), None
        numbers = self._known.get(target.tool.lower())
        if numbers is not None:
            return self._pose(numbers), None
        if len(self._unknown_tools) > 1:
            return self._missing("for the tool", target.tool)
        return self._tool, target.tool if self._tool is None else None

    def _missing(self, how: str, name: str) -> str:
        shown = shown_name(name)
        return (
            f"{how} {shown}, whose numbers are not known here: --frame '{shown}={self._program.form.words}'"
        )

    def _numbers(self, where: str, text: str) -> Array:
        count = len(self._program.form.decimals)
        try:
            out = np.array([float(word) for word in text.split(",")])
        except ValueError:
            out = np.zeros(0)
        if len(out) != count or not (np.abs(out) <= LARGEST).all():
            raise InputError(f"{where}: found {text!r}, expected {count} numbers {self._program.form.words}")
        if count == 7 and abs(float(np.sum(out[3:] ** 2)) - 1.0) > 0.01:
            raise InputError(
                f"{where}: found {text!r}, expected a quaternion of length 1 in the last four numbers"
            )
        return out

    def _pose(self, numbers: Array) -> Array:
        out: Array = self._program.form.poses(numbers[None, :])[0]
        return out


def is_rigid(numbers: Sequence[float]) -> bool:
    """Whether the numbers of a frame are a pose; of one that a program states with others the numbers are not known."""
    return max(map(abs, numbers)) <= LARGEST and (
        len(numbers) != 7 or abs(sum(v**2 for v in numbers[3:]) - 1.0) <= 0.01
    )


def shown_name(name: str) -> str:
    """A frame's name as a person knows it: without the place in the text that tells several apart."""
    return name.partition("@")[0]
