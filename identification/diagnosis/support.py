"""Whether the data support what the posterior names: a fit that determines it, and both halves of the rows.

The posterior weighs a linearised problem. A name also needs the nonlinear fit of the named set: its coefficients are seen by
the readings, and they differ from zero by more than three sigma. A law that one half of the rows alone would not name is
not replicated, and its probability is at most ``UNREPLICATED``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.naming import Summary
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.result import Replication
from truepose.identification.diagnosis.search import Found
from truepose.identification.fit.estimate import Estimate
from truepose.identification.signatures.untestable import Untestable
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.placed import EffectAtPlace

Replications = Callable[[Sequence[Named]], tuple[Replication | None, ...]]
"""What the halves of the rows say of names."""
CHANCE = 0.0027
"""Probability that noise alone is as far from zero: three sigma of one coefficient."""
UNREPLICATED = 0.5
"""Most that a law is believed that one half of the rows would not name. Of 64 results that a second sample did not show by
itself, 32 stood in both together (Open Science Collaboration 2015, Science 349:aac4716: 36 and 68 of 100)."""
WEIGHTS = ("mass", "centre")
"""Classes of constants that say how heavy a part is, and where."""
UNSEEN = 0.9
"""Share of its prior 1-sigma that a coefficient keeps where readings say nothing of it."""


@dataclass(frozen=True)
class Supported:
    """The summary with what the data support, the replication of each of its names, and what no reading sees."""

    summary: Summary
    replications: tuple[Replication | None, ...]
    unseen: tuple[Untestable, ...]


def keep_supported(summary: Summary, found: Found, fit: Estimate, halves: Replications) -> Supported:
    """Leave names to ``leading`` that the ``fit`` of the named set does not determine, and cap laws that are not replicated."""
    kept, unseen, open_ = list[Named](), list[Untestable](), list[Named]()
    for one in summary.names:
        statistic, share = _determination(found, fit, one)
        if statistic >= 1.0:
            kept.append(one)
        elif share >= UNSEEN:
            where = "+".join(one.cause.place)
            unseen.append(
                Untestable(one.cause.effect, f"{where}: no reading tells it apart from the geometry")
            )
        else:
            open_.append(one)
    replicated = halves(kept)
    names = tuple(cap_law(one, half) for one, half in zip(kept, replicated, strict=True))
    law = {n.cause: n.probability for n in names if not n.nameless}
    hidden = {n.cause: 0.0 for n in summary.names if n not in kept and n not in open_ and not n.nameless}
    inclusion = replace(summary.inclusion, places={**summary.inclusion.places, **law, **hidden})
    leading = (*open_, *summary.leading)
    return Supported(Summary(names, leading, inclusion), replicated, tuple(unseen))


def _determination(found: Found, fit: Estimate, one: Named) -> tuple[float, float]:
    """Return how far a name's coefficients are from zero, in parts of what chance allows, and the share of their prior 1-sigma
    that they keep."""
    labels = {found.catalogue.candidates[i].label for i in one.candidates}
    at = [k for k, name in enumerate(fit.prior.names) if name.rpartition(":")[0] in labels]
    free = np.flatnonzero(np.isin(fit.prior.free, at))
    if not free.size:
        return np.inf, 0.0  # held at a bound: nothing to judge
    index = fit.prior.free[free]
    sigma, covariance = fit.prior.sigma[index], _with_known_weights(fit, free)
    scale = np.sqrt(np.diag(covariance))
    value = fit.p[index] / scale
    statistic = float(value @ np.linalg.pinv(covariance / scale[:, None] / scale, hermitian=True) @ value)
    kept = np.minimum((scale / (sigma * fit.noise)) ** 2, 1.0)
    known = max(float(np.sum(1.0 - kept)), 1.0)  # of a long series the readings determine a few coefficients
    return statistic / float(chi2.isf(CHANCE, known)), float(np.sqrt(np.min(kept)))


def _with_known_weights(fit: Estimate, free: Index) -> Array:
    """Return the covariance of some free entries as if all masses were known: what yields is seen although its load is not."""
    weights = np.flatnonzero(np.isin(np.array(fit.prior.parts)[fit.prior.free], WEIGHTS))
    covariance, n = fit.covariance_among(np.concatenate([free, weights])), len(free)
    own, across = covariance[:n, :n], covariance[:n, n:]
    scale = np.sqrt(np.maximum(np.diag(covariance)[n:], 1e-300))
    inverse = np.linalg.pinv(covariance[n:, n:] / scale[:, None] / scale, hermitian=True)
    return np.asarray(own - (across / scale) @ inverse @ (across / scale).T)


def cap_law(one: Named, half: Replication | None) -> Named:
    """Return the name with the probability of its law that both halves of the rows allow."""
    if one.nameless or half is None or half.replicated or one.probability <= UNREPLICATED:
        return one
    rest = Rival(EffectAtPlace(Empirical.slug, one.cause.place), one.probability - UNREPLICATED, one.gain)
    others = [m for m in one.equivalents if m.cause != rest.cause]
    same = sum(m.probability for m in one.equivalents if m.cause == rest.cause)
    ranked = sorted(
        (*others, replace(rest, probability=rest.probability + same)), key=lambda m: -m.probability
    )
    return replace(one, probability=UNREPLICATED, equivalents=tuple(ranked))


__all__ = ["UNREPLICATED", "Supported", "cap_law", "keep_supported"]
