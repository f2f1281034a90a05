"""Whether what is named has the form of its name, or is only like it.

What the catalogue does not know often resembles something that it knows. Such a thing is the name's signal, modulated by a
joint or driver far more than a formula is ever wrong. Both are weighed for every name, beside all others of the likeliest set.
Where a formula has terms that bend it, what these carry is an error of form that was found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification import prior
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import design_with_forms
from truepose.identification.posterior.marginal import marginal
from truepose.identification.prior import FORM_ERROR, OFF_FORM, POOR
from truepose.identification.signatures.forms import PAIR
from truepose.models.parameters import element_of

Array = NDArray[np.float64]
Index = NDArray[np.intp]
FINER = (0, -2, -4, -8)
"""Steps of the noise at which all is weighed: with more freedom it can only be smaller."""


@dataclass(frozen=True)
class Likeness:
    """Probability that something like a name is the thing itself, and whether its form could be tested at all."""

    itself: float
    tested: bool


def forms_hold(found: Found, nameless: float, names: Sequence[Sequence[int]]) -> list[Likeness]:
    """Whether each name (its candidates), if something like it is there, is the thing itself.

    ``nameless``: that something without a name is there anyway; what resembles a name is then likelier a part of it. A name
    larger than its physics usually is costs what its prior says: something else knows no usual size.
    """
    if not names:
        return []
    odds = (1.0 - nameless) * prior.ONLY_ALIKE + nameless * prior.PART_OF_IT
    every = _gains(found, [_modulated(found, name) for name in names])
    return [
        Likeness(
            held_probability(gains, odds * prior.beyond_usual(_size(found, name)), _bent(found, name)),
            bool(len(gains)),
        )
        for gains, name in zip(every, names, strict=True)
    ]


def _size(found: Found, name: Sequence[int]) -> float:
    """Fitted size of a name's straight terms: root mean square of their coefficients, each in its largest usual size."""
    lin, cat = found.linearisation, found.catalogue
    own = [i for i in name if not cat.candidates[i].bent] or list(name)
    amplitudes = lin.departure[lin.free + np.array(lin.indices(own), dtype=np.intp)]
    return float(np.sqrt(np.mean(amplitudes**2)))


def _bent(found: Found, name: Sequence[int]) -> float:
    """Share of a name's fitted signal that its formula does not follow, only terms that bend it; 0 without any."""
    lin, cat = found.linearisation, found.catalogue
    if not any(cat.candidates[i].bent for i in name):
        return 0.0
    cause = cat.cause(name[0])
    straight = [i for i, c in enumerate(cat.candidates) if cat.cause(i) == cause and not c.bent]
    own, base = (lin.free + np.array(lin.indices(some), dtype=np.intp) for some in (name, straight))
    amplitude = lin.departure[own]
    whole = float(amplitude @ lin.gram[np.ix_(own, own)] @ amplitude)
    across = lin.gram[np.ix_(base, own)] @ amplitude
    followed = float(across @ np.linalg.lstsq(lin.gram[np.ix_(base, base)], across, rcond=None)[0])
    return float(np.sqrt(max(1.0 - followed / whole, 0.0))) if whole > 0.0 else 0.0


def _modulated(found: Found, name: Sequence[int]) -> list[Index]:
    """Columns of F of a name's signals by each source; its own joint says how it works, not that it is another thing."""
    lin, cat = found.linearisation, found.catalogue
    own = {element_of(part) for i in name for part in cat.candidates[i].place}
    signals = [k for k, own in enumerate(lin.bent) if set(own) & set(name)]
    each = PAIR * len(lin.sources)
    return [
        np.array([k * each + PAIR * s + i for k in signals for i in range(PAIR)], dtype=np.intp)
        for s, source in enumerate(lin.sources)
        if signals and source not in own
    ]


def _gains(found: Found, wanted: Sequence[Sequence[Index]]) -> list[Array]:
    """(sources, shares) for each name: log Bayes factors of its modulated signal beside the likeliest set."""
    problem, lin = found.problem, found.linearisation
    columns, sizes = problem.spike_slab.columns(found.mode.members)
    design = design_with_forms(lin, found.catalogue, problem)
    forms = np.arange(design.width - lin.forms, design.width)
    part = design.restricted(np.concatenate([columns, forms]).astype(np.intp))
    first, scale = len(columns), np.array(OFF_FORM) * np.sqrt(len(lin.sources)) / FORM_ERROR
    plain, best = -np.inf, [np.full((len(own), len(OFF_FORM)), -np.inf) for own in wanted]
    for step in (step for step in FINER if min(found.mode.point.noise) + step >= 0):
        point = found.mode.point.louder(step)
        root = marginal(part, problem.spike_slab.unknowns, problem.spike_slab.terms, point)
        there = root.including(np.arange(first), sizes)
        plain = max(plain, there.log_evidence)
        for gains, own in zip(best, wanted, strict=True):
            new = [[there.gain(first + at, np.full(len(at), size)) for size in scale] for at in own]
            if new:
                gains[:] = np.maximum(gains, there.log_evidence + np.array(new))
    return [gains - plain for gains in best]


def held_probability(gains: Array, odds: float, bent: float = 0.0) -> float:
    """From prior odds of the rival and log Bayes factors (sources, shares), sources all as likely; without any, untested.

    ``bent``: the share of the signal that bends the formula; it is a source of its own, already in the set.
    """
    if not len(gains):
        return 1.0 / (1.0 + odds)
    if bent > 0.0:
        shares = np.array([FORM_ERROR, *OFF_FORM])
        likely = -0.5 * (bent / shares) ** 2 - np.log(shares)
        gains = np.vstack([gains, likely[1:] - likely[0]])
    by_share = np.logaddexp.reduce(gains, axis=0) - np.log(len(gains))
    itself = np.logaddexp(np.log(1.0 - POOR), np.log(POOR) + by_share[0])
    other = np.logaddexp.reduce(by_share[1:]) - np.log(len(by_share) - 1)
    return float(1.0 / (1.0 + odds * np.exp(np.clip(other - itself, -700.0, 700.0))))
