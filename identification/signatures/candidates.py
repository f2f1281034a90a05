"""Every (effect, place, settings) that a recording could speak of, and what it cannot speak of."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.empirical_forms import empirical_forms, ranges
from truepose.models.driver import PAYLOAD, Driver
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.empirical import Empirical
from truepose.models.machine import Machine
from truepose.models.placed import EffectAtPlace

TOGETHER = 0.2
"""Prior share of a slug's places that join several parts, where parts alone are places too."""


@dataclass(frozen=True)
class Untestable:
    """An effect whose driver the recording lacks, and which."""

    effect: str
    why: str


@dataclass(frozen=True)
class Catalogue:
    """Candidates with the logarithm of their prior probability given that one effect is present.

    ``stated`` are those that the machine file has already: part of every model, and no finding.
    """

    candidates: tuple[PlacedEffect, ...]
    log_prior: tuple[float, ...]
    untestable: tuple[Untestable, ...]
    stated: tuple[int, ...] = ()

    def with_more(self, added: Sequence[PlacedEffect], beside: Sequence[int]) -> Catalogue:
        """With further candidates at the end, which share the prior of those ``beside`` (their indices)."""
        log_prior = list(self.log_prior)
        share = float(np.logaddexp.reduce([log_prior[i] for i in beside])) - float(
            np.log(len(added) + len(beside))
        )
        for i in beside:
            log_prior[i] = share
        return replace(
            self, candidates=(*self.candidates, *added), log_prior=(*log_prior, *[share] * len(added))
        )

    def cause(self, index: int) -> EffectAtPlace:
        """What a candidate blames, at whatever settings."""
        return self.candidates[index].at_place

    @cached_property
    def smooth(self) -> tuple[int, ...]:
        """Forms without a name that may make up a smooth remainder: those of the robot, whose sensors are as good as stated.

        What yields to load is one thing at one place, and no part of a remainder.
        """
        return tuple(
            i
            for i, placed in enumerate(self.candidates)
            if not self.named(i) and placed.kind != "sensor" and not placed.needs_load
        )

    def named(self, index: int) -> bool:
        """Whether a candidate is an effect of the catalogue."""
        return self.candidates[index].effect.slug != Empirical.slug


def catalogue(machine: Machine, recording: Recording) -> Catalogue:
    """All testable candidates; every slug is equally likely, and its places share (parts alone before several at once)."""
    found: list[PlacedEffect] = []
    missing: list[Untestable] = []
    kinds, seen = [effects.get(slug, "catalogue")() for slug in effects], ranges(recording)
    for effect in kinds:
        slug = effect.slug
        places = [tuple(place) for place in effect.places(machine) if effect.screened(machine, tuple(place))]
        if not places and effect.needs_load and not machine.loaded:
            missing.append(Untestable(slug, _unloaded(machine)))
        reasons: list[str] = []
        for place in places:
            variants = effect.settings(machine, place, recording)
            if not variants:
                usual = (
                    "the recording holds one session only" if recording.n_sessions < 2 else "nothing to vary"
                )
                reasons.append(effect.unvaried or usual)
            for settings in variants:
                placed = PlacedEffect.at(effect, machine, place, effect.within(place, settings, seen))
                reason = why_untestable(placed, recording)
                if reason is None:
                    found.append(placed)
                else:
                    reasons.append(f"{'+'.join(place)}: {reason}" if len(places) > 1 else reason)
        if reasons:
            missing.append(Untestable(slug, _summary(reasons)))
    found += empirical_forms(machine, recording)
    found += [placed for placed in machine.effects if placed.label not in {e.label for e in found}]
    labels = {e.label for e in machine.effects}
    stated = tuple(k for k, e in enumerate(found) if e.label in labels)
    return Catalogue(tuple(found), _log_prior(machine, found), tuple(missing), stated)


def why_untestable(placed: PlacedEffect, recording: Recording) -> str | None:
    """What the recording lacks for a candidate: a driver's column, or a driver that varies. None where nothing."""
    for name in placed.drivers:
        values = recording.driver(name)
        if values is None:
            return f"no {Driver.of(name).column} column"
        if name != PAYLOAD and not np.any(values[~recording.validation]):
            return f"{name} never differs from zero"
    return None


def _unloaded(machine: Machine) -> str:
    """Why no effect of weight can be tested, and the line that would change it."""
    if machine.gravity is None:
        return (
            "no `gravity:` in the machine file; add `gravity: [0, 0, -9.80665]` (m/s^2, in the base's frame)"
        )
    if not machine.masses:
        return "no `masses:` in the machine file; state what links and tool weigh"
    return "its own elastic legs carry the weight"


def _summary(reasons: list[str]) -> str:
    kinds = list(dict.fromkeys(reasons))
    return "; ".join(kinds[:4]) + (f"; and {len(kinds) - 4} more" if len(kinds) > 4 else "")


def _log_prior(machine: Machine, found: list[PlacedEffect]) -> tuple[float, ...]:
    """Slugs share by how common they are, places within a slug as ``_place_shares`` says, settings by their weight.

    An effect that is rare at a place counts for less there, and for no more elsewhere.
    """
    slugs = {e.effect.slug: e.effect.commonness for e in found}
    shares = {slug: _place_shares({e.place for e in found if e.effect.slug == slug}) for slug in slugs}
    weights = [e.effect.weight(e.settings_map) for e in found]
    total: dict[EffectAtPlace, float] = {}
    for e, weight in zip(found, weights, strict=True):
        total[e.at_place] = total.get(e.at_place, 0.0) + weight
    return tuple(
        float(np.log(weight * share * e.effect.likely(machine, e.place) / total[e.at_place]))
        for e, weight in zip(found, weights, strict=True)
        for share in (slugs[e.effect.slug] / sum(slugs.values()) * shares[e.effect.slug][e.place],)
    )


def _place_shares(places: Collection[tuple[str, ...]]) -> dict[tuple[str, ...], float]:
    """Equal, but one part alone is likelier than several at once where both are places."""
    fewest = min(len(place) for place in places)
    simple = [place for place in places if len(place) == fewest]
    joined = [place for place in places if len(place) > fewest]
    beside = TOGETHER if joined else 0.0
    return dict.fromkeys(simple, (1.0 - beside) / len(simple)) | dict.fromkeys(
        joined, beside / max(len(joined), 1)
    )
