"""What many unseen directions mean together: a common factor, a common shift, points that move as one body.

A pattern is a change of parameters written down beforehand (all lengths by one factor; every ``leg*.a`` along
x); it holds when the unseen directions contain it, whatever frames do to undo it. Names only say which
parameters are coordinates of one point and which differ by a number.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.identification.identifiability.observability import Direction, Knowledge, unseen
from truepose.models.machine.machine import FRAME_OF, FRAMES, Machine
from truepose.models.machine.sensor import TOOL

HOLDS = 1e-5
"""A pattern holds when no more than this share of it is left outside the unseen directions."""
TAKES_PART = 1e-3
MOST_GROUPS = 4
"""Groups of points of which every union is tried; with more, one and two at a time."""
_DIGITS = re.compile(r"\d+")
_POINT = re.compile(r"^(?P<point>.+)\.(?P<axis>[xyz])$")


@dataclass(frozen=True)
class Pattern:
    """A change (n,) in mm at a lever that no reading sees, and what it is.

    kind: ``scale``, ``shift``, or ``body``; members: the parameters or groups that move, motion: ``along x`` or
    ``about x`` of a body; undone_by: parameters of frames that move against it.
    """

    kind: str
    change: Array
    members: tuple[str, ...]
    motion: str = ""
    undone_by: tuple[str, ...] = ()


@dataclass(frozen=True)
class Blind:
    """Directions that readings do not see, each led by one parameter, and patterns that explain many of them."""

    known: Knowledge
    directions: tuple[Direction, ...]
    patterns: tuple[Pattern, ...]

    @classmethod
    def of(cls, known: Knowledge, rows: Array, machine: Machine, p: Array) -> Blind:
        """Of unseen directions ``rows`` (k, n), in steps, at the parameters ``p`` (np,)."""
        values = {parameter.name: float(p[k]) for k, parameter in enumerate(machine.parameters)}
        return cls(known, unseen(known, rows), patterns(known, rows, values, point_frames(machine)))

    @property
    def remaining(self) -> tuple[Direction, ...]:
        """Directions that the patterns do not explain."""
        return remaining(self.known, self.directions, self.patterns)


def patterns(
    known: Knowledge, blind: Array, values: Mapping[str, float], frames: Mapping[str, str]
) -> tuple[Pattern, ...]:
    """Independent patterns inside the unseen directions ``blind`` (k, n), in steps.

    ``values``: every parameter of the machine, also those that are not free; ``frames``: see ``point_frames``.
    """
    space = known.physical(blind)
    found: list[Pattern] = []
    for pattern in itertools.chain(_scale(known), _bodies(known, values, frames), _shifts(known)):
        held = _inside(known, space, pattern)
        if held is not None and not _spanned([p.change for p in found], held.change):
            found.append(held)
    return tuple(found)


def remaining(
    known: Knowledge, directions: Sequence[Direction], found: Sequence[Pattern]
) -> tuple[Direction, ...]:
    """Directions that the patterns do not explain: those of the fewest parts that complete them."""
    taken = [pattern.change for pattern in found]
    out: list[Direction] = []
    for direction in sorted(directions, key=lambda d: len(d.parts)):
        row = np.array([direction.parts.get(name, 0.0) for name in known.names]) * known.lever
        # parts of a direction below two hundredths are not written down
        if len(out) + len(found) < len(directions) and not _spanned(taken, row, 0.1):
            taken.append(row)
            out.append(direction)
    order = list(directions)
    return tuple(sorted(out, key=order.index))


def _scale(known: Knowledge) -> Iterator[Pattern]:
    lengths = np.where([unit == "mm" for unit in known.units], known.value, 0.0)
    if np.count_nonzero(lengths) >= 3:
        yield Pattern("scale", lengths * known.lever, ())


def _shifts(known: Knowledge) -> Iterator[Pattern]:
    groups: dict[str, list[str]] = {}
    for name in known.names:
        groups.setdefault(_DIGITS.sub("#", name), []).append(name)
    for members in groups.values():
        if len(members) > 1:
            yield Pattern("shift", np.isin(known.names, members) * known.lever, tuple(members))


def point_frames(machine: Machine) -> dict[str, str]:
    """The body in whose frame each named point is written: ends of rods and limbs, joints, numbered targets."""
    mechanism = machine.mechanism
    out = {joint.name: joint.parent for joint in mechanism.joints}
    for joint in mechanism.joints:
        out |= {step.parameter[:-2]: joint.parent for step in joint.placement if step.kind.startswith("t")}
    for rod in mechanism.rods:
        ends = ((rod.point_a, rod.body_a), (rod.point_b, rod.body_b))
        out |= {point[0][:-2]: body for point, body in ends if point is not None}
    on_tool = [sensor for sensor in machine.sensors if sensor.view.tip == TOOL]
    targets = {p.name[:-2] for sensor in on_tool for p in sensor.parameters if _POINT.match(p.name)}
    return out | {name: mechanism.flange for name in targets if _DIGITS.search(name)}


def _bodies(known: Knowledge, values: Mapping[str, float], frames: Mapping[str, str]) -> Iterator[Pattern]:
    """Groups of points of one frame (``leg*.a``), and unions of groups, along and about each axis."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name in known.names:
        match = _POINT.match(name)
        if match and match["point"] in frames and match["point"] not in FRAMES:
            key = (frames[match["point"]], _DIGITS.sub("#", match["point"]))
            points = groups.setdefault(key, [])
            if match["point"] not in points:
                points.append(match["point"])
    for frame in dict.fromkeys(frame for frame, _ in groups):
        own = [points for (where, _), points in groups.items() if where == frame]
        for size in range(1, (len(own) if len(own) <= MOST_GROUPS else 2) + 1):
            for union in itertools.combinations(own, size):
                together = [point for group in union for point in group]
                if len(together) > 1:
                    yield from _motions(known, together, values)


def _motions(known: Knowledge, points: Sequence[str], values: Mapping[str, float]) -> Iterator[Pattern]:
    """Translations and turns; a coordinate that is exactly known forbids what would move it."""
    at = {name: k for k, name in enumerate(known.names)}
    names = [f"{point}.{axis}" for point in points for axis in "xyz"]
    place = np.array([values.get(name, 0.0) for name in names]).reshape(-1, 3)
    free = np.array([name in at for name in names])
    for k, axis in enumerate("xyz"):
        unit = np.eye(3)[k]
        for motion, moved in (("along", np.tile(unit, (len(points), 1))), ("about", np.cross(unit, place))):
            shift = moved.ravel()
            if np.linalg.norm(shift[~free]) > HOLDS * np.linalg.norm(shift) or not shift.any():
                continue
            change = np.zeros(len(known.names))
            change[[at[name] for name in np.array(names)[free]]] = shift[free]
            yield Pattern("body", change * known.lever, tuple(points), f"{motion} {axis}")


def _inside(known: Knowledge, space: Array, pattern: Pattern) -> Pattern | None:
    """The pattern with what frames do beside it, when that is an unseen direction."""
    shown = 1.0 - np.sum(space**2, axis=0) > HOLDS  # what no reading sees alone needs no company
    if not len(space) or not np.any(
        shown & (np.abs(pattern.change) > HOLDS * np.max(np.abs(pattern.change)))
    ):
        return None
    own = np.array([name not in FRAME_OF for name in known.names])
    fixed = own if pattern.kind == "body" else np.ones(len(own), dtype=bool)
    share, *_ = np.linalg.lstsq(space[:, fixed].T, pattern.change[fixed], rcond=None)
    whole = share @ space
    if np.linalg.norm((whole - pattern.change)[fixed]) > HOLDS * np.linalg.norm(pattern.change):
        return None
    beside = np.abs(whole) > TAKES_PART * np.max(np.abs(whole))
    undone = tuple(
        name for name, moves, mine in zip(known.names, beside, own, strict=True) if moves and not mine
    )
    return Pattern(
        pattern.kind, whole, pattern.members, pattern.motion, undone if pattern.kind == "body" else ()
    )


def _spanned(rows: Sequence[Array], new: Array, share: float = 1e-3) -> bool:
    """Whether ``new`` is a combination of ``rows``, but for a share of its length."""
    if not rows:
        return False
    basis = np.array(rows)
    away = new - np.linalg.lstsq(basis.T, new, rcond=None)[0] @ basis
    return bool(np.linalg.norm(away) < share * np.linalg.norm(new))
