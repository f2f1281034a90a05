"""What is put into a case, stratum by stratum: kinds and places at random, sizes in detection limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from challenge import schedule
from challenge.setup import Setup, Setups
from challenge.simulator.base import Imperfection, Kind
from challenge.sizing import Sized, detection_limit, draw_factor, sized
from truepose.errors import TrueposeError
from truepose.models.effects.base import effects
from truepose.models.effects.common import OF_ROWS

Array = NDArray[np.float64]
SMALLEST, CLEAR, LARGEST = 1.0, 3.0, 20.0
"""Sizes in detection limits: singles and pairs from the first, all other effects alone from the second, none of them
beyond the third."""
VAST = 40.0
"""The largest effect of a pair, and of a real-like machine."""
ROUNDS = 4


class UndrawnError(TrueposeError):
    """A machine has nothing to offer to a stratum."""


@dataclass(frozen=True)
class Draft:
    """What a case contains, and where. ``families``: the kind that each part was drawn with at all its places, else ""."""

    setup: Setup
    kinds: tuple[Kind, ...]
    parts: tuple[Sized, ...]
    families: tuple[str, ...] = ()

    @property
    def imperfections(self) -> tuple[Imperfection, ...]:
        """As the simulator takes them."""
        return tuple(part.imperfection for part in self.parts)


Accept = Callable[[Draft], bool]


def draft(stratum: str, setups: Setups, rng: np.random.Generator, hidden: Accept) -> Draft:
    """What a case of a stratum (neither null nor real-like) contains. ``hidden`` says whether the ordinary fit of a draft
    looks good.

    Raises UndrawnError when this machine has nothing that fits.
    """
    kinds = setups.machine.kinds()
    known = nameable(kinds)
    if stratum == schedule.SINGLE:
        found = _single(setups, [k for k in kinds if k.in_library], rng, SMALLEST)
    elif stratum == schedule.CONCEALED:
        found = _concealed(setups, known, rng, hidden)
    elif stratum == schedule.LOOK_ALIKE:
        found = _single(setups, _with_look_alikes(setups, known), rng, CLEAR)
    elif stratum == schedule.TWO:
        found = _two(setups, known, rng)
    else:
        found = _single(setups, [k for k in kinds if not k.in_library], rng, CLEAR)
    if found is None:
        raise UndrawnError(f"{setups.machine.name}: nothing to draw for the stratum {stratum!r}")
    return found


def nameable(kinds: Sequence[Kind]) -> list[Kind]:
    """Kinds of the library that act on the machine, not on single rows."""
    return [k for k in kinds if k.in_library and k.slug not in OF_ROWS]


def usual(setup: Setup, kind: Kind, place: tuple[str, ...], rng: np.random.Generator) -> Imperfection:
    """A kind at a place, with a drawn shape, at its typical size."""
    return Imperfection(kind.name, place, kind.typical, dict(setup.machine.shape(kind.name, place, rng)))


def _shuffled(kinds: Sequence[Kind], rng: np.random.Generator) -> Iterator[Kind]:
    """Every kind in turn, in random order, a few times over: another place and shape may do."""
    for _ in range(ROUNDS):
        yield from (kinds[k] for k in rng.permutation(len(kinds)))


def _sized(
    setup: Setup, kind: Kind, rng: np.random.Generator, low: float, high: float = LARGEST
) -> tuple[Sized, Imperfection] | None:
    """A kind of a drawn size, and the same at its detection limit."""
    thing = usual(setup, kind, kind.places[int(rng.integers(len(kind.places)))], rng)
    limit = detection_limit(setup.bench, setup.change, thing)
    factor = None if limit is None else draw_factor(rng, low, high, limit, kind.typical)
    if limit is None or factor is None:
        return None
    smallest = thing.scaled(limit / kind.typical)
    return sized(setup.bench, setup.change, smallest.scaled(factor), limit), smallest


def _single(setups: Setups, kinds: Sequence[Kind], rng: np.random.Generator, low: float) -> Draft | None:
    for kind in _shuffled(kinds, rng):
        setup = setups.of([kind])
        part = _sized(setup, kind, rng, low)
        if part is not None:
            return Draft(setup, (kind,), (part[0],))
    return None


def _concealed(
    setups: Setups, kinds: Sequence[Kind], rng: np.random.Generator, hidden: Accept
) -> Draft | None:
    """As large as the ordinary fit hides; kinds that geometry swallows are tried first."""
    first = [k for k in kinds if k.conceals]
    for kind in (*_shuffled(first, rng), *_shuffled(kinds, rng)):
        setup = setups.of([kind])
        found = _sized(setup, kind, rng, CLEAR)
        if found is None:
            continue
        part, smallest = found
        for factor in (part.factor, np.sqrt(CLEAR * part.factor), CLEAR):
            smaller = sized(setup.bench, setup.change, smallest.scaled(float(factor)), part.limit)
            out = Draft(setup, (kind,), (smaller,))
            if hidden(out):
                return out
    return None


def _with_look_alikes(setups: Setups, kinds: Sequence[Kind]) -> list[Kind]:
    """Kinds whose effect resembles another that could be tested on this machine with what is recorded."""
    catalogued = setups.of(()).known
    testable = {c.effect.slug for c in catalogued.catalogue.candidates} if catalogued else set()
    known = set(effects)
    return [
        k
        for k in kinds
        if k.slug in known and testable & set(effects.get(k.slug, "kind").look_alikes) - {k.slug}
    ]


def _two(setups: Setups, kinds: Sequence[Kind], rng: np.random.Generator) -> Draft | None:
    """Two effects at different places, each of any size: one may be at its limit and the other vast."""
    for kind in _shuffled(kinds, rng):
        others = [k for k in kinds if k.slug != kind.slug]
        if not others:
            return None
        other = others[int(rng.integers(len(others)))]
        setup = setups.of([kind, other])
        pair = [_sized(setup, k, rng, SMALLEST, VAST) for k in (kind, other)]
        if pair[0] is None or pair[1] is None:
            continue
        a, b = pair[0][0], pair[1][0]
        if not set(a.imperfection.place) & set(b.imperfection.place):
            return Draft(setup, (kind, other), (a, b))
    return None


__all__ = ["Draft", "UndrawnError", "draft", "nameable", "usual"]
