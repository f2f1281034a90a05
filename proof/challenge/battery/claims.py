"""What a diagnosis claims at places of a machine, and whether a half's claims stand in the whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from challenge.battery.parts import of_whole
from challenge.drivers import agree
from challenge.findings import FORM
from challenge.statements import SURE
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.mechanism import element_of

Json = Mapping[str, Any]
LOST = 0.5
"""Probability below which what a half was sure of is not so in the whole."""


@dataclass(frozen=True)
class Claim:
    """An effect at a place, or (without one) a kind of driver there, with its probability."""

    place: tuple[str, ...]
    what: str
    probability: float
    law: bool

    def same(self, other: Claim) -> bool:
        """Return whether another claim says the same: the same name, or a driver that agrees at a part of the place.

        A constant is at its element.
        """
        if self.law != other.law:
            return False
        if self.law:
            return (self.what, self.place) == (other.what, other.place)
        parts, others = (set(map(element_of, claim.place)) for claim in (self, other))
        return bool(parts & others) and agree(self.what, other.what)


def claims(document: Json) -> tuple[Claim, ...]:
    """Of the findings on the machine itself (not on rows): names with their laws, drivers."""
    return tuple(_of_findings(document["findings"]))


def everything(document: Json) -> tuple[Claim, ...]:
    """The same, and all that is less probable: what leads, other explanations, the whole list of effects."""
    listed = [*document["inclusion"], *(e for f in document["findings"] for e in f["equivalents"])]
    names = [Claim(tuple(one["place"]), one["effect"], float(one["probability"]), law=True) for one in listed]
    return (*claims(document), *_of_findings(document["leading"]), *names)


def _of_findings(findings: Sequence[Json]) -> Iterator[Claim]:
    for one in (f for f in findings if f["effect"] not in OF_ROWS):
        place, driver = tuple(one["place"]), one["levels"]["driver"]
        yield Claim(place, driver["kind"], float(driver["probability"]), law=False)
        if one["effect"] != FORM:
            yield Claim(place, one["effect"], float(one["probability"]), law=True)


def sure(document: Json, *, law: bool) -> tuple[Claim, ...]:
    """What is claimed with 0.9 or more."""
    return tuple(c for c in claims(document) if c.law == law and c.probability >= SURE)


def replicated(documents: Mapping[str, Json], *, law: bool) -> tuple[bool, ...]:
    """For every sure claim of a half whether the whole (without one: the other half) gives it 0.5 or more."""
    out = []
    for case, document in documents.items():
        whole, other = of_whole(case)
        against = documents.get(whole, documents.get(other or ""))
        if other is not None and against is not None:
            known = everything(against)
            for claim in sure(document, law=law):
                best = max((c.probability for c in known if c.same(claim)), default=0.0)
                out.append(best >= LOST)
    return tuple(out)


__all__ = ["Claim", "claims", "everything", "replicated", "sure"]
