"""A machine as real ones are: 5 to 12 effects at once, families and singles, some vast and some barely there.

A family is one kind at all its places: its members share a common size and scatter about it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from challenge.setup import Setup, Setups
from challenge.simulator.base import Kind, Place
from challenge.sizing import LARGEST, Sized, detection_limit, sized
from challenge.strata import ROUNDS, SMALLEST, VAST, Draft, UndrawnError, nameable, usual

FEWEST, MOST = 5, 12
SINGLES = 2
"""Of them that belong to no family, at least."""
FAMILIES = (0.15, 0.55, 0.30)
"""How often there is none, one, two."""
FAMILY = (2, 8)
"""Fewest and most places of a family."""
SCATTER = 0.5
"""Standard deviation of the logarithm of a family's sizes."""
HEAD = 3.0
"""Limits of a family's largest member, at least."""
NO_FAMILY = ("wrong-constant", "axis-coupling")
"""Effects that are mistakes or hoses of their own, never all of them at once."""
OWN = 0.05
"""Share of an effect's signal that the ones before it must leave: less is the same function once more, as play and friction of
one joint are where every approach is alike."""
MOVING = 0.15
"""How often rows are read on the move, which effects of velocity need."""


@dataclass(frozen=True)
class _Member:
    kind: Kind
    place: Place
    family: str = ""

    @property
    def name(self) -> tuple[str, Place]:
        return self.kind.slug, self.place


def real_like(setups: Setups, rng: np.random.Generator) -> Draft:
    """Effects that all act at once. Raises UndrawnError when the machine cannot have so many."""
    for _ in range(ROUNDS):
        members = _members(setups.machine.kinds(), rng)
        setup = setups.of([m.kind for m in members])
        found = _sizes(setup, members, rng)
        if len(found.parts) >= FEWEST and _stands(found):
            return found
    raise UndrawnError(f"{setups.machine.name}: fewer than {FEWEST} effects at once that can be seen")


def _members(kinds: Sequence[Kind], rng: np.random.Generator) -> list[_Member]:
    """Families first, then singles up to a drawn number."""
    moving = rng.random() < MOVING
    known = [k for k in nameable(kinds) if moving or not _moves(k)]
    total = int(rng.integers(FEWEST, MOST + 1))
    whole = [k for k in known if FAMILY[0] <= len(k.places) <= FAMILY[1] and k.slug not in NO_FAMILY]
    out: list[_Member] = []
    count = int(rng.choice(len(FAMILIES), p=FAMILIES))
    for kind in [whole[k] for k in rng.permutation(len(whole))]:
        fits = len(out) + len(kind.places) <= total - SINGLES and kind.slug not in {m.kind.slug for m in out}
        if count and fits:
            out += [_Member(kind, place, kind.name) for place in kind.places]
            count -= 1
    for _ in range(100 * total):
        if len(out) >= total:
            break
        kind = known[int(rng.integers(len(known)))]
        one = _Member(kind, kind.places[int(rng.integers(len(kind.places)))])
        if one.name not in {m.name for m in out}:
            out.append(one)
    return out


def _moves(kind: Kind) -> bool:
    return any(need.startswith("velocity") for need in kind.needs)


def _sizes(setup: Setup, members: Sequence[_Member], rng: np.random.Generator) -> Draft:
    """Every member at a size; left out is what no sensible size lets be seen, and what others are already."""
    drawn = [(m, usual(setup, m.kind, m.place, rng)) for m in members]
    limits = [detection_limit(setup.bench, setup.change, thing) for _, thing in drawn]
    seen = [(m, thing, limit) for (m, thing), limit in zip(drawn, limits, strict=True) if limit is not None]
    sizes = dict[str, Callable[[], float]]()
    kept, parts = list[_Member](), list[Sized]()
    for member, thing, limit in seen:
        if member.family and member.family not in sizes:
            own = [lim for m, _, lim in seen if m.family == member.family]
            sizes[member.family] = _common(min(own), rng)
        draw = sizes[member.family] if member.family else _alone(limit, rng)
        size = min(draw(), LARGEST * member.kind.typical)
        part = sized(setup.bench, setup.change, thing.scaled(size / member.kind.typical), limit)
        if setup.bench.snr(part.change, [other.change for other in parts]) > OWN * part.snr:
            kept.append(member)
            parts.append(part)
    return Draft(setup, tuple(m.kind for m in kept), tuple(parts), tuple(m.family for m in kept))


def _alone(limit: float, rng: np.random.Generator) -> Callable[[], float]:
    return lambda: limit * float(np.exp(rng.uniform(np.log(SMALLEST), np.log(VAST))))


def _common(limit: float, rng: np.random.Generator) -> Callable[[], float]:
    """Sizes about a common one; ``limit`` is that of the member which is seen best."""
    middle = limit * float(np.exp(rng.uniform(np.log(HEAD), np.log(VAST))))
    return lambda: middle * float(np.exp(SCATTER * rng.standard_normal()))


def _stands(found: Draft) -> bool:
    """Whether the machine has an equilibrium with everything at once."""
    try:
        found.setup.exact(found.imperfections)
    except ValueError:
        return False
    return True


__all__ = ["real_like"]
