"""Whether what is named has the form of its name, or is only like it.

What the catalogue does not know often resembles something that it knows. Such a thing is the name's signal, modulated by a
joint or driver far more than a formula is ever wrong. Both are weighed for every name, beside all others of the likeliest set.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis import prior
from truepose.identification.diagnosis.forms import ERROR
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.weighed import design_with_forms
from truepose.identification.posterior.marginal import marginal

Array = NDArray[np.float64]
Index = NDArray[np.intp]
SHARES = (0.25, 0.5, 1.0)
"""How far the signal of something that is only alike is modulated by one source, as shares of it."""
FINER = (0, -2, -4, -8)
"""Steps of the noise at which both are weighed: with more freedom it can only be smaller."""
PAIR = 2
"""Modulations of a source: its first two polynomials."""


def forms_hold(found: Found, nameless: float, names: Sequence[Sequence[int]]) -> list[float]:
    """Probability that each name (its candidates), if something like it is there, is the thing itself.

    ``nameless``: that something without a name is there anyway; what resembles a name is then likelier a part of it.
    """
    if not names:
        return []
    bent, width = found.linearisation.bent, found.linearisation.forms
    modulations = width // max(len(bent), 1)
    columns, sizes = found.weighed.weighing.columns(found.mode.members)
    design = design_with_forms(found.linearisation, found.catalogue, found.weighed)
    forms = np.arange(design.width - width, design.width)
    part = design.restricted(np.concatenate([columns, forms]).astype(np.intp))
    inside, first = np.arange(len(columns)), len(columns)
    sources = range(modulations // PAIR)
    wanted = [
        [
            np.array([first + k * modulations + PAIR * source + i for k in own for i in range(PAIR)])
            for source in sources
        ]
        for own in ([k for k, i in enumerate(bent) if i in name] for name in names)
    ]
    scale = np.array(SHARES) * np.sqrt(len(sources)) / ERROR
    best = np.full((len(names), len(sources), len(scale)), -np.inf)
    plain = -np.inf
    for step in FINER:
        noise = [k + step for k in found.mode.point[:-2]]
        if min(noise) < 0:
            continue
        root = marginal(
            part,
            found.weighed.weighing.unknowns,
            found.weighed.weighing.terms,
            (*noise, *found.mode.point[-2:]),
        )
        there = root.including(inside, sizes)
        plain = max(plain, there.log_evidence)
        for n, own in enumerate(wanted):
            for s, at in enumerate(own):
                if len(at):
                    gains = [there.gain(at, np.full(len(at), size)) for size in scale]
                    best[n, s] = np.maximum(best[n, s], there.log_evidence + np.array(gains))
    odds = (1.0 - nameless) * prior.ONLY_ALIKE + nameless * prior.PART_OF_IT
    return [_held(best[n] - plain, odds) for n in range(len(names))]


def _held(gains: Array, odds: float) -> float:
    """From prior odds of the rival and its log Bayes factors (sources, sizes), all as likely; without any, untested."""
    tested = gains[np.isfinite(gains)]
    log_odds = np.log(odds)
    if len(tested):
        log_odds += np.logaddexp.reduce(tested) - np.log(len(tested))
    return float(1.0 / (1.0 + np.exp(np.clip(log_odds, -700.0, 700.0))))
