"""Like effects at all their places under one common size: every joint gives way, every gear has its waves.

Effects of one kin are a family, too: joints, links and mounts that all give way under the weight.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

from truepose.models.effects.base import PlacedEffect

FEWEST = 3
"""Places from which on effects can be a family."""
LARGEST = 160
"""Coefficients beyond which a family would fit anything."""
SINGLE = frozenset({"wrong-constant", "target-offset", "frame-shift", "mount-drift"})
"""Effects whose places have nothing in common."""
Family = tuple[int, ...]


def families(candidates: Sequence[PlacedEffect], indices: Sequence[int]) -> tuple[Family, ...]:
    """Candidates (among ``indices``) of one effect with one setting, or of one kin, at single places, three or more."""
    groups: dict[tuple[str, str], Family] = {}
    for i in indices:
        placed = candidates[i]
        if len(placed.place) == 1 and placed.effect.slug not in SINGLE:
            key = placed.effect.slug, placed.effect.told(placed.settings_map)
            groups[key] = (*groups.get(key, ()), i)
    found = list(groups.values())
    return tuple(
        members
        for members in found
        if len(members) >= FEWEST and sum(len(candidates[i].coefficients) for i in members) <= LARGEST
    )


def _kindred(candidates: Sequence[PlacedEffect], groups: Sequence[Family]) -> list[Family]:
    """All of one kin together, with each choice of their settings that bend no formula."""
    kin: dict[str, dict[str, list[Family]]] = {}
    for members in groups:
        first = candidates[members[0]]
        if first.effect.kin and not first.bent:
            kin.setdefault(first.effect.kin, {}).setdefault(first.effect.slug, []).append(members)
    return [
        tuple(i for members in choice for i in members)
        for own in kin.values()
        if len(own) > 1
        for choice in product(*own.values())
    ]
