"""Kills at random moments of a command, and what is there afterwards: the old result or the new one, and no litter."""

from __future__ import annotations

import signal
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .cases import Case, Seen, state
from .room import Ended, everything, make_room, result, run

END, WEIGHT = 0.1, 0.3
"""Last share of a command's time, in which it publishes, and how many kills more it gets."""
LATE = 1.05
"""Kills come up to so many times the usual duration."""
TRIES = 3


@dataclass(frozen=True)
class Row:
    """What was found of a command. Seconds: of the command, of the longest next run, of the longest end after the signal.

    litter: names that were too many after the next run or, of signals that can be heard, at once; untrue: ends that were
    told in another way than in one true line.
    """

    name: str
    lasts: float
    kills: int
    states: Counter[str]
    litter: tuple[str, ...]
    untrue: tuple[str, ...]
    slowest: float

    @property
    def right(self) -> bool:
        """Whether nothing was found."""
        return not (self.states["mixed"] or self.litter or self.untrue)


@dataclass(frozen=True)
class _Known:
    """Old and new result, the names in a room after both, and how long the command takes."""

    before: Path | None
    old: Seen
    new: Seen
    names: frozenset[str]
    lasts: float


def study(
    case: Case, inputs: Path, folder: Path, *, kills: int, seed: int, number: int = signal.SIGKILL
) -> Row:
    """Send a signal at so many moments, and look."""
    known = _known(case, inputs, folder)
    rng = np.random.default_rng(seed)
    states, untrue, litter, slowest = Counter[str](), list[str](), list[str](), 0.0
    for k in range(kills):
        room = folder / f"kill{k}"
        make_room(room, inputs, known.before)
        late = rng.random() < WEIGHT
        moment = rng.uniform((1 - END) if late else 0.0, LATE) * known.lasts
        ended = run(case, 2, room, after=float(moment), number=number)
        found = state(result(room), known.old, known.new)
        states[found] += 1
        if number == signal.SIGKILL:
            spare, lasted = _next(case, room, known)
            slowest = max(slowest, lasted)
        else:
            spare = everything(room) - known.names
            slowest = max(slowest, ended.after)
            untrue += _untrue(case, ended, found, number)
        litter += sorted(spare)
    return Row(case.name, known.lasts, kills, states, tuple(litter), tuple(untrue), slowest)


def _known(case: Case, inputs: Path, folder: Path) -> _Known:
    before = None
    if case.before:
        before = folder / "before"
        make_room(before, inputs, None)
        _done(case, 1, before)
    lasting = []
    for k in range(TRIES):
        after = folder / f"after{k}"
        make_room(after, inputs, before)
        lasting.append(_done(case, 2, after))
    old = result(before) if before else {}
    new = result(after)
    same = [name for name in new if old.get(name) == new[name]]
    if not new or (old and len(same) == len(new)):
        raise ValueError(f"{case.name}: its old and new result cannot be told apart")
    return _Known(before, old, new, frozenset(everything(after)), float(np.median(lasting)))


def _done(case: Case, n: int, room: Path) -> float:
    ended = run(case, n, room)
    if ended.code != case.code:
        raise RuntimeError(f"{case.name}: exit code {ended.code}, {ended.said}")
    return ended.lasted


def _next(case: Case, room: Path, known: _Known) -> tuple[set[str], float]:
    """Names that are too many after the next run, and how long that took; it must end in the new result.

    Where nothing is too many before, it need not run: what is there is the old or the new result, and nothing else.
    """
    if everything(room) <= known.names and state(result(room), known.old, known.new) != "mixed":
        return set(), 0.0
    lasted = _done(case, 2, room)
    if dict(result(room)) != dict(known.new):
        return {"another result"}, lasted
    return everything(room) - known.names, lasted


def _untrue(case: Case, ended: Ended, found: str, number: int) -> list[str]:
    """What was said wrongly of an end: one line, 130 or 143, and which result is there."""
    if ended.code == case.code:
        return []  # it was done before
    if (ended.code, found) == (-number, "new") and "error:" not in ended.said:
        return []  # it was done, and only its process was left to be ended
    lines = [line for line in ended.said.splitlines() if line.startswith("error: stopped")]
    others = [
        line
        for line in ended.said.splitlines()
        if line.startswith(("Traceback", "Exception ignored", "error:"))
    ]
    if ended.code != 128 + number or len(lines) != 1 or others != lines:
        return [f"exit code {ended.code}: {ended.said[-2000:]}"]
    nothing = "nothing was written" in lines[0]
    if (nothing and found == "new") or ("written before" in lines[0] and found == "old"):
        return [f"{found}: {lines[0]}"]
    return []


__all__ = ["Row", "study"]
