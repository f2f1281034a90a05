"""What a diagnosis said, as the scorer reads diagnosis.json, and when that is the same as what is true."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from challenge.solutions import Names, Solution, Truth
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.mechanism import element_of

VERDICTS = ("adequate", "missing-physics", "unknown")
FORM = "empirical"
"""Slug of a finding whose place and driver are known, and no law."""
NAMELESS = (FORM, *OF_ROWS)
"""Slugs of what is no name: forms of a remainder, rows."""
COUPLING = "axis-coupling"
UNNAMED = "unknown"
"""Slug of what is only like the name that a finding has."""


@dataclass(frozen=True)
class Said:
    """One explanation with its probability."""

    effect: str
    place: tuple[str, ...]
    probability: float


@dataclass(frozen=True)
class Levels:
    """How probable it is that something is at the place of a finding, and that this kind of driver drives it there."""

    place: float
    kind: str
    driver: float


@dataclass(frozen=True)
class Found:
    """A finding: what it names, the explanations it cannot tell from that, how sure the whole class is; what is known of
    its place and driver (None: the file does not say)."""

    name: Said
    equivalents: tuple[Said, ...]
    certainty: float
    log_bayes_factor: float
    levels: Levels | None = None

    @property
    def members(self) -> tuple[Said, ...]:
        """The whole class, the named one first."""
        return (self.name, *self.equivalents)

    @property
    def rows(self) -> frozenset[int]:
        """Numbers of the rows that a finding on rows names."""
        return frozenset(int(part) for part in self.name.place if part.isdecimal())


@dataclass(frozen=True)
class Reply:
    """A diagnosis: verdict, findings with the best supported first, constants by name (mm, rad).

    remainder: whether something without a name is said to be there; inclusion: every effect at every place with its
    probability, where the diagnosis lists them; leveled: whether it tells places and drivers apart from names."""

    verdict: str
    concealed: bool
    findings: tuple[Found, ...]
    parameters: Mapping[str, float]
    remainder: bool = False
    inclusion: tuple[Said, ...] = ()
    leveled: bool = False

    @property
    def physics(self) -> tuple[Found, ...]:
        """Findings that decide the verdict: not those on single rows."""
        return tuple(f for f in self.findings if f.name.effect not in OF_ROWS)

    @property
    def named(self) -> tuple[Found, ...]:
        """Those of them that name a law."""
        return tuple(f for f in self.physics if f.name.effect != FORM)

    @property
    def located(self) -> tuple[Found, ...]:
        """Those of them that tell what is known of their place and driver, named or not."""
        return tuple(f for f in self.physics if f.levels is not None)

    @property
    def of_rows(self) -> tuple[Found, ...]:
        """The others: rows that were set aside."""
        return tuple(f for f in self.findings if f.name.effect in OF_ROWS)


def read_reply(path: Path) -> Reply | None:
    """The diagnosis of a file; None when there is none or it is not one."""
    try:
        return _reply(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _reply(document: Mapping[str, Any]) -> Reply | None:
    if document["verdict"] not in VERDICTS:
        return None
    found = [_found(entry) for entry in document["findings"]]
    values = {name: float(entry["value"]) for name, entry in document["parameters"].items()}
    ordered = sorted(found, key=lambda f: -f.log_bayes_factor)
    listed = [_said(entry) for entry in document.get("inclusion") or ()]
    return Reply(
        verdict=document["verdict"],
        concealed=bool(document["concealed"]),
        findings=tuple(ordered),
        parameters=values,
        remainder=document.get("remainder") is not None,
        inclusion=tuple(said for said in listed if said.effect not in NAMELESS),
        leveled="leading" in document or any(f.levels is not None for f in found),
    )


def _found(entry: Mapping[str, Any]) -> Found:
    name = _said(entry)
    certainty = float(entry.get("certainty", entry["probability"]))
    others = tuple(_said(other) for other in entry.get("equivalents", ()))
    return Found(name, others, certainty, float(entry["log_bayes_factor"]), _levels(entry.get("levels")))


def _levels(entry: Mapping[str, Any] | None) -> Levels | None:
    if entry is None:
        return None
    driver = entry["driver"]
    return Levels(float(entry["place"]), str(driver["kind"]), float(driver["probability"]))


def _said(entry: Mapping[str, Any]) -> Said:
    return Said(entry["effect"], tuple(entry["place"]), float(entry["probability"]))


class Judge:
    """Whether names mean the true effects of a case, or what its data cannot tell from them."""

    def __init__(self, solution: Solution) -> None:
        self._aliases = solution.aliases
        self.truths: Sequence[Truth] = solution.truths

    def place(self, place: Iterable[str]) -> frozenset[str]:
        """A place with one name for each part: a leg is its reading, in a parameter's name too."""
        own = ((element_of(name), name) for name in place)
        return frozenset(self._aliases.get(part, part) + name[len(part) :] for part, name in own)

    def true(self, said: Said | Names, truth: Truth) -> bool:
        """Whether this names the very truth."""
        effect, place = (said.effect, said.place) if isinstance(said, Said) else said
        if effect != truth.effect or not truth.effect:
            return False
        return effect in OF_ROWS or self.place(place) == self.place(truth.place)

    def right(self, said: Said, truth: Truth) -> bool:
        """Whether this names the truth or what is as good."""
        same = [(effect, self.place(place)) for effect, place in truth.equivalents]
        return self.true(said, truth) or (said.effect, self.place(said.place)) in same

    def names(self, said: Said) -> bool:
        """Whether this names a truth, or the same effect at several places of which each is true."""
        if any(self.true(said, truth) for truth in self.truths):
            return True
        single = [Said(said.effect, (part,), said.probability) for part in said.place]
        return len(single) > 1 and all(any(self.true(one, t) for t in self.truths) for one in single)

    def unnamed(self, said: Said) -> bool:
        """Whether this says without a name what has none, at the part where it is."""
        return said.effect == UNNAMED and any(
            not truth.effect and self.right_place(said, truth) for truth in self.truths
        )

    def as_good(self, said: Said) -> bool:
        """Whether this names what the data cannot tell from a truth."""
        return any(self.right(said, truth) for truth in self.truths)

    def right_effect(self, said: Said, truth: Truth) -> bool:
        """The same, wherever it is."""
        return said.effect in {truth.effect, *(effect for effect, _ in truth.equivalents)} - {""}

    def right_place(self, said: Said, truth: Truth) -> bool:
        """The parts where the truth is, or what is as good, whatever the effect; a constant stands for its part.

        Rows are not compared: an outlier's place is the recording.
        """
        if truth.effect in OF_ROWS:
            return said.effect in OF_ROWS
        places = [truth.place, *(place for _, place in truth.equivalents)]
        return self._parts(said.place) in [self._parts(p) for p in places]

    def _parts(self, place: Iterable[str]) -> frozenset[str]:
        return frozenset(map(element_of, self.place(place)))

    def parts(self, effect: str, place: Sequence[str]) -> frozenset[str]:
        """The parts that an effect is at; of coupled axes the one that is driven, which comes first."""
        return self._parts(place[:1] if effect == COUPLING else place)

    def wider(self, said: Said, truth: Truth) -> bool:
        """Whether this names the truth at its places and at others."""
        return said.effect == truth.effect and self.place(said.place) > self.place(truth.place)

    def part(self, said: Said, truth: Truth) -> bool:
        """Whether this names the truth at some of its several places."""
        return said.effect == truth.effect and self.place(said.place) < self.place(truth.place)

    def covers(self, found: Found, truth: Truth) -> bool:
        """Whether a finding's class holds the truth, or what is as good, at its places, at some of them, or at more."""
        tests = (self.right, self.part, self.wider)
        return any(test(said, truth) for said in found.members for test in tests)


__all__ = ["FORM", "Found", "Judge", "Levels", "Reply", "Said", "read_reply"]
