"""Forward selection: take what the evidence asks for most, look again at what was taken, until nothing changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

Accepted = dict[int, float]
"""Index of each accepted term to its spread or size."""
MAX_TERMS = 80


def select_forward(
    accepted: Mapping[int, float],
    add: Callable[[Accepted], Accepted],
    review: Callable[[Accepted, bool], Accepted],
) -> Accepted:
    """Search from the terms ``accepted``.

    ``add`` gives these and the best of the others, or the same where none is worth it; ``review`` drops and swaps among
    them, and hears whether something was added. The search ends at terms that it had before.
    """
    current = dict(accepted)
    seen: set[frozenset[int]] = set()
    while len(current) < MAX_TERMS and frozenset(current) not in seen:
        seen.add(frozenset(current))
        longer = add(current)
        current = review(longer, set(longer) != set(current))
    return current
