"""Like effects at all their places under one common size: every joint gives way, every gear has its waves."""

from __future__ import annotations

from collections.abc import Sequence

from truepose.models.effects.base import PlacedEffect

FEWEST = 3
"""Places from which on an effect can be a family."""
LARGEST = 160
"""Coefficients beyond which a family would fit anything."""
SINGLE = frozenset({"wrong-constant", "target-offset", "frame-shift", "mount-drift"})
"""Effects whose places have nothing in common."""


def families(candidates: Sequence[PlacedEffect], indices: Sequence[int]) -> tuple[tuple[int, ...], ...]:
    """Candidates (among ``indices``) of one effect with one setting, at single places, three or more."""
    groups: dict[tuple[str, str], list[int]] = {}
    for i in indices:
        placed = candidates[i]
        if len(placed.place) == 1 and placed.effect.slug not in SINGLE:
            groups.setdefault((placed.effect.slug, placed.effect.told(placed.settings_map)), []).append(i)
    return tuple(
        tuple(members)
        for members in groups.values()
        if len(members) >= FEWEST and sum(len(candidates[i].coefficients) for i in members) <= LARGEST
    )
