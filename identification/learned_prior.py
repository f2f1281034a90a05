"""The prior that a fleet leaves for machines to come: a file, and what it changes of ``truepose.identification.prior``.

The file says how many times likelier than before an effect is at a place, and how its sizes are shared out; nothing else of
the prior moves. Frequencies and counts stand beside for the reader.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final, Literal, Self

import numpy as np
from pydantic import Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.prior import SIZES
from truepose.models.file.fields import FilePart, input_error
from truepose.models.file.yaml_document import read_document
from truepose.models.machine.effect import effects
from truepose.models.machine.placed import EffectAtPlace
from truepose.wording import joined

SCHEMA: Final = "truepose/prior/1"
ROUNDING = 0.01
"""How far written shares may be from adding up to one."""
MOST = 1e6
"""Most that odds may be multiplied or divided by."""
Odds = Annotated[float, Field(ge=1.0 / MOST, le=MOST)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
SizeShare = Annotated[float, Field(gt=0.0, le=1.0)]
Count = Annotated[int, Field(ge=0)]


class PlacePrior(FilePart):
    """An effect at one place."""

    machines: Count
    """Machines in which it was weighed there."""
    found: Annotated[float, Field(ge=0.0)]
    """Sum of its probabilities in them."""
    frequency: Share
    """Share of machines that have it there, as the fleet says."""
    usual: Share
    """The same as it was expected without the fleet."""
    odds: Odds
    """How many times likelier than without this file it is there: what ``diagnose`` takes."""


class EffectPrior(FilePart):
    """An effect at all its places."""

    machines: Count
    """Machines in which it was weighed."""
    odds: Odds
    """How many times likelier than without this file it is at a place that is not listed."""
    sizes: tuple[SizeShare, ...]
    """Share of each size in ``sizes`` of the file."""
    places: dict[str, dict[str, PlacePrior]] = Field(default_factory=dict)
    """By type of mechanism, then by place."""

    @model_validator(mode="after")
    def _shares(self) -> Self:
        if len(self.sizes) != len(SIZES.values) or abs(sum(self.sizes) - 1.0) > ROUNDING:
            expected = f"expected {len(SIZES.values)} shares that add up to 1"
            raise PydanticCustomError(
                "shares", "{expected}", {"expected": expected, "field": "sizes", "found": self.sizes}
            )
        return self


class ToleranceNote(FilePart):
    """A class of parts in the fleet; for the reader, who may correct machine files by it."""

    deviations: Count
    ratio: Annotated[float, Field(gt=0.0)]
    low: Annotated[float, Field(gt=0.0)]
    high: Annotated[float, Field(gt=0.0)]


class LearnedPrior(FilePart):
    """What a prior file holds."""

    schema_: Literal["truepose/prior/1"] = Field(SCHEMA, alias="schema")
    machines: Count = 0
    """How many machines all of it was learned from."""
    mechanisms: dict[str, Count] = Field(default_factory=dict)
    """How many of them are of which type of mechanism."""
    sizes: tuple[float, ...] = Field(tuple(float(f"{size:.4g}") for size in SIZES.values))
    """Sizes that effects may have, in units of their largest expected one."""
    effects: dict[str, EffectPrior] = Field(default_factory=dict)
    tolerances: dict[str, ToleranceNote] = Field(default_factory=dict)
    """True spread over the stated tolerance, by class of parts, with 90 % intervals. ``diagnose`` does not read it."""

    @model_validator(mode="after")
    def _own_sizes(self) -> Self:
        if len(self.sizes) != len(SIZES.values) or not np.allclose(self.sizes, SIZES.values, rtol=0.01):
            expected = "expected " + " ".join(f"{size:.4g}" for size in SIZES.values)
            raise PydanticCustomError(
                "sizes", "{expected}", {"expected": expected, "field": "sizes", "found": self.sizes}
            )
        return self


@dataclass(frozen=True)
class FleetPrior:
    """A learned prior as it is for machines of one type of ``mechanism``."""

    learned: LearnedPrior
    mechanism: str

    def log_odds(self, cause: EffectAtPlace) -> float:
        """Log of how many times likelier than without the fleet an effect is at a place."""
        effect = self.learned.effects.get(cause.effect)
        if effect is None:
            return 0.0
        place = effect.places.get(self.mechanism, {}).get("+".join(cause.place))
        return float(np.log(effect.odds if place is None else place.odds))

    def log_sizes(self, effect: str) -> Array | None:
        """(s,) log prior of an effect's sizes; None where the fleet says nothing of them."""
        found = self.learned.effects.get(effect)
        if found is None:
            return None
        shares = np.array(found.sizes)
        return np.asarray(np.log(shares / shares.sum()))

    def notes(self, places: Iterable[EffectAtPlace]) -> tuple[str, ...]:
        """Where the fleet is of another kind than the machine, whose effects and places these are."""
        learned, kinds = self.learned, self.learned.mechanisms
        known = set(places)
        here = sum(
            EffectAtPlace(slug, tuple(place.split("+"))) in known
            for slug, effect in learned.effects.items()
            for place in effect.places.get(self.mechanism, {})
        )
        said = f"the prior was learned from {learned.machines} machines ({_told(kinds)})"
        if learned.effects and not here:
            said += (
                f", and this one is a {self.mechanism or 'mechanism without a type'} of other places: frequencies at"
                " places say nothing here, those of effects do"
            )
        unknown = sorted(learned.effects.keys() - set(effects))
        missing = f"the prior names effects that the catalogue has not: {joined(unknown)}; load their plug-in"
        return (said, missing) if unknown else (said,)


def _told(kinds: Mapping[str, int]) -> str:
    return joined([f"{count} {kind}" for kind, count in kinds.items()]) or "none"


def read_prior(path: Path | str) -> LearnedPrior:
    """Read and check a prior file. Raises InputError naming file, field, what was found and what was expected."""
    raw = read_document(path)
    if raw.get("schema") != SCHEMA:
        raise InputError(f"{path}: schema: found {raw.get('schema')!r}, expected {SCHEMA!r}")
    try:
        return LearnedPrior.model_validate(raw)
    except ValidationError as exc:
        raise input_error(exc, path) from None
