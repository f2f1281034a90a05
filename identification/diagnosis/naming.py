"""Which accepted terms are given names: those whose class is certain, each by the likeliest cause of its class."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis import classes, doubt
from truepose.identification.diagnosis.candidates import Catalogue, Cause
from truepose.identification.diagnosis.classes import Named
from truepose.identification.diagnosis.effect_selection import (
    MANY_TERMS,
    Selection,
    refitted,
    restricted,
    spread_of,
)
from truepose.identification.diagnosis.result import Remainder

Mask = NDArray[np.bool_]


def name_terms(found: Selection, exclude: Mask, rival: Remainder | None) -> tuple[Selection, list[Named]]:
    """Terms of the catalogue whose class is certain, fitted without the others; their classes.

    A name beside something unnamed (``rival``) on the same part is likely half of it, and is not given. Where
    another cause of a class is likelier at all its settings together than the term that was accepted, it takes the
    term's place. ``exclude`` (n,) are the rows left out.
    """
    cat, machine = found.catalogue, found.signatures.machine
    kept = [
        i
        for i in found.accepted
        if i in cat.stated or (cat.named(i) and not doubt.same_part(machine, cat.candidates[i].place, rival))
    ]
    selection = restricted(found, exclude, kept)
    named = _classes(selection)
    while uncertain := [n.index for n in named if n.certainty < classes.CERTAIN]:
        certain = [i for i in selection.accepted if i not in uncertain]
        selection = restricted(selection, exclude, certain)
        named = _classes(selection)
    exchanged = _exchanged(selection, exclude, named)
    renamed = _classes(exchanged) if exchanged is not selection else named
    # from the new fit the old cause may look likelier again
    settled = all(n.certainty >= classes.CERTAIN and likelier(cat, n) is None for n in renamed)
    return (exchanged, renamed) if settled else (selection, named)


def _classes(selection: Selection) -> list[Named]:
    """Every accepted term with its class."""
    fit, cat = selection.fit, selection.catalogue
    excess = max(fit.chi2 - (fit.n_observations - fit.effective_parameters), 0.0)
    unexplained = 0.5 * excess / max(fit.chi2_per_dof, 1.0)
    return [
        classes.name_term(selection.linearisation, cat, selection.grid, selection.accepted, i, unexplained)
        for i in selection.accepted
        if i not in cat.stated
    ]


def _exchanged(selection: Selection, exclude: Mask, named: Sequence[Named]) -> Selection:
    """The selection with likelier causes in place of terms, fitted anew; the same where there is none that fits.

    Among many terms the others share in what one explains, and its place is not changed.
    """
    cat = selection.catalogue
    causes = [cat.cause(n.index) for n in named]
    better = {
        n.index: other
        for n, cause in zip(named, causes, strict=True)
        if causes.count(cause) == 1 and (other := likelier(cat, n)) not in {None, *selection.accepted}
    }
    if not better or len(selection.accepted) > MANY_TERMS:
        return selection
    accepted: dict[int, float] = {}
    for i, spread in selection.accepted.items():
        other = better.get(i)
        accepted |= {i: spread} if other is None else {other: spread_of(cat, other, spread)}
    exchanged = refitted(selection, exclude, accepted)
    return exchanged if set(exchanged.accepted) == set(accepted) else selection


def likelier(cat: Catalogue, named: Named) -> int | None:
    """The likeliest setting of the cause that has the most of a class, where that is not the term's own cause."""
    share: dict[Cause, float] = {cat.cause(named.index): named.probability}
    for member in named.equivalents:
        cause = cat.cause(member.index)
        share[cause] = share.get(cause, 0.0) + member.probability
    best = max(share, key=lambda cause: share[cause])
    if best == cat.cause(named.index):
        return None
    own: Mapping[int, float] = {
        m.index: m.probability for m in named.equivalents if cat.cause(m.index) == best
    }
    return max(own, key=lambda i: own[i])
