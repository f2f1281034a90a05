"""Series over the arcs that were seen: there, waves of many orders do no more than a few combinations of them.

A joint that turned by a third of a turn cannot tell 60 orders (120 coefficients) apart. With S (n, c) what each coefficient
does to the joint in each row, and W the rows' information about a shift of it, S'WS = V L V'. The coefficients are
N(0, q^2) each, so those of orthonormal directions are, too: what V turns them to, without directions of no information, is
the same problem with fewer columns. Coefficients follow as V times those of the directions; along the others they stay at
nothing, as their prior has them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from truepose.arrays import Array
from truepose.identification.prior import LONG
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical

Layout = Sequence[tuple[list[str], slice]]
"""Of each candidate: the ports that it moves, and where its shifts (ports times coefficients) stand."""
Turns = Mapping[str, Array]
"""Directions (c, r) that are seen of candidates with c coefficients, by label."""


def series_ports(candidates: Sequence[PlacedEffect], layout: Layout) -> dict[int, str]:
    """The port of each candidate of many coefficients, all of one port and without bounds; forms without a name are not among
    them, for a remainder is made of their coefficients."""
    return {
        k: names[0]
        for k, (placed, (names, _)) in enumerate(zip(candidates, layout, strict=True))
        if len(names) == 1
        and len(placed.coefficients) > LONG
        and placed.effect.slug != Empirical.slug
        and not np.any(np.isfinite([[c.lower, c.upper] for c in placed.coefficients]))
    }


def turned(
    shifts: Array, layout: Layout, turns: Sequence[Array | None]
) -> tuple[Array, list[tuple[list[str], slice]]]:
    """Shifts (n, s) by the directions of each candidate (None: by its coefficients), and where they stand."""
    out, places, at = list[Array](), list[tuple[list[str], slice]](), 0
    for (names, where), turn in zip(layout, turns, strict=True):
        own = shifts[:, where] if turn is None else shifts[:, where] @ turn
        places.append((names, slice(at, at := at + own.shape[1])))
        out.append(own)
    return (np.concatenate(out, axis=1) if out else shifts), places
