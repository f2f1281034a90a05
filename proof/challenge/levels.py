"""What a diagnosis said at three levels: something is at this place, this drives it there, it is this law.

A place is right when it shares a part with the truth's, or with that of an effect that the data cannot tell from it; a
driver when it is also that effect's own. A law is right when it is the very truth, or as good.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from challenge.drivers import agree, driver_of, of_effect
from challenge.findings import FORM, Found, Judge, Levels, Reply
from challenge.solutions import Truth
from challenge.statements import SURE, Statement, name_said
from truepose.models.effects.common import OF_ROWS

KNOWN = 0.5
"""Probability from which on a place with its driver counts as known."""


@dataclass(frozen=True)
class AtLevels:
    """Places, drivers and laws with their probabilities, and whether they were right.

    told: whether the diagnosis tells levels at all; known: for each true effect whether its place and driver were said
    with at least 0.9; withheld: the verdict is unknown though a place and driver are more probable than not.
    """

    told: bool = False
    places: tuple[Statement, ...] = ()
    drivers: tuple[Statement, ...] = ()
    laws: tuple[Statement, ...] = ()
    known: tuple[bool, ...] = ()
    withheld: bool = False

    @property
    def wrong_law(self) -> bool:
        """Whether a law was said with at least 0.9 that is neither the truth nor as good."""
        return any(law.probability >= SURE and not law.right for law in self.laws)


def judged(judge: Judge, reply: Reply, counted: Sequence[Found]) -> AtLevels:
    """The findings that count, against the truths."""
    told = [(f, f.levels) for f in counted if f.levels is not None]
    truths = judge.truths
    places = [(levels.place, any(_at(judge, f, t) for t in truths)) for f, levels in told]
    drivers = [(levels.driver, any(_driven(judge, f, levels, t) for t in truths)) for f, levels in told]
    laws = [name_said(judge, f.name) for f in counted if f.name.effect != FORM]
    sure = [(f, levels) for f, levels in told if levels.driver >= SURE]
    return AtLevels(
        told=reply.leveled,
        places=tuple(Statement(p, right, right) for p, right in places),
        drivers=tuple(Statement(p, right, right) for p, right in drivers),
        laws=tuple(Statement(x.probability, x.fair, x.fair) for x in laws),
        known=tuple(any(_driven(judge, f, levels, t) for f, levels in sure) for t in truths),
        withheld=reply.verdict == "unknown"
        and any(f.levels is not None and f.levels.driver >= KNOWN for f in reply.located),
    )


def _at(judge: Judge, found: Found, truth: Truth) -> bool:
    """Whether a finding is at a part of the truth, or of what is as good."""
    if truth.effect in OF_ROWS:
        return found.name.effect in OF_ROWS
    own = judge.parts(found.name.effect, found.name.place)
    return any(own & parts for parts, _ in _answers(judge, truth))


def _driven(judge: Judge, found: Found, levels: Levels, truth: Truth) -> bool:
    """The same, and the driver is that one's."""
    if truth.effect in OF_ROWS:
        return found.name.effect in OF_ROWS and agree(levels.kind, driver_of(truth))
    own = judge.parts(found.name.effect, found.name.place)
    return any(own & parts and agree(levels.kind, driver) for parts, driver in _answers(judge, truth))


def _answers(judge: Judge, truth: Truth) -> Iterator[tuple[frozenset[str], str | None]]:
    """Parts and driver of the truth, and of everything that the data cannot tell from it."""
    yield judge.parts(truth.effect, truth.place), driver_of(truth)
    for effect, place in truth.equivalents:
        yield judge.parts(effect, place), of_effect(effect)


__all__ = ["AtLevels", "judged"]
