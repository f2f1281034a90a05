"""What is named: causes of the likeliest set, each with the class of explanations that may stand in its slot.

Findings, what leads, sets, inclusion and the verdict read the summary that is made here. Nothing that is told is worked out
anywhere else, so no number is told twice with two values.

Whether the data support what the posterior names: a fit that determines it, and both halves of the rows.

The posterior weighs a linearised problem. A name also needs the nonlinear fit of the named set: its coefficients are seen by
the readings, and they differ from zero by more than three sigma. A law that one half of the rows alone would not name is
not replicated, and its probability is at most ``UNREPLICATED``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.posterior_summary import (
    LEADING,
    LISTED,
    SHOWN,
    SURE,
    Inclusion,
    Named,
    Rival,
    Sums,
    driver_of,
    parts_of,
)
from truepose.identification.diagnosis.result import NAMED, Replication
from truepose.identification.diagnosis.search import Found, chosen
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.state import supports
from truepose.identification.signatures.untestable import Untestable
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import DriverKind
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import EffectAtPlace

CERTAIN = 0.95
"""Probability from which on a name is said without its look-alikes."""
FAMILY = 3
"""Places of one effect from which on they are told as a family."""


def named(found: Found, sums: Sums) -> tuple[Named, ...]:
    """Causes of the mode, the best supported first; then what has a place and a driver only.

    Not all of them are more probable than not (``Named.said``).
    """
    problem = found.problem
    causes = dict.fromkeys(int(problem.spike_slab.terms.cause[term]) for term, _ in found.mode.members)
    own = [k for k in causes if any(found.catalogue.named(i) for i in _terms_of(found, k))]
    laws = [_law(found, sums, k, own) for k in own]
    gains = _gains(found, [n.candidates for n in laws])
    of_effect = Counter(n.cause.effect for n in laws if n.said)
    told = list[Named]()
    for n, gain in zip(laws, gains, strict=True):
        family = n.cause.effect if n.said and of_effect[n.cause.effect] >= FAMILY else ""
        equivalents = tuple(replace(m, gain=m.gain + gain) for m in n.equivalents)
        form = sums.form(n.cause, n.levels.kind)
        told.append(replace(n, gain=gain, family=family, equivalents=equivalents, form=form))
    told.sort(key=lambda n: -n.gain)
    return (*told, *_nameless(found, sums, told))


def _terms_of(found: Found, number: int) -> list[int]:
    """Candidates of the mode that a cause has."""
    terms = found.problem.spike_slab.terms
    return [found.problem.candidates[t] for t, _ in found.mode.members if int(terms.cause[t]) == number]


def _law(found: Found, sums: Sums, number: int, named_ones: Collection[int]) -> Named:
    """Return a cause of the mode with what else may be in its slot.

    Where something that cannot be named is the likelier, there is no law to say, and its driver is the likeliest one there.
    """
    causes, candidates = found.problem.causes, _terms_of(found, number)
    cause, probability, parts = causes[number], sums.law(number), {*sums.parts(causes[number])}
    rivals = _rivals(found, sums, number, named_ones)
    laws = [causes.index(m.cause) for m in rivals if m.cause.effect != Empirical.slug]
    here = [k for k in laws if not parts.isdisjoint(sums.parts(causes[k]))]
    certainty = max(sums.any_law([number, *laws]), probability)
    kind = found.catalogue.candidates[candidates[0]].kind
    levels = sums.levels(cause, kind, probability)
    nameless = Rival(
        EffectAtPlace(Empirical.slug, cause.place), levels.driver - sums.any_law([number, *here]), 0.0
    )
    untested = max((m.probability for m in rivals if not m.tested), default=0.0)
    if max(nameless.probability, untested) <= probability:
        rivals += [nameless] if nameless.probability > SHOWN else []
        return Named(cause, tuple(candidates), probability, certainty, _ranked(rivals), levels=levels)
    levels = sums.levels(cause, sums.likeliest_driver(cause, kind), 0.0)
    said, tested = _ranked([*rivals, Rival(cause, probability, 0.0)]), untested <= nameless.probability
    return Named(nameless.cause, tuple(candidates), 0.0, certainty, said, levels=levels, tested=tested)


def _rivals(found: Found, sums: Sums, number: int, named_ones: Collection[int]) -> list[Rival]:
    """Return other laws that may be in a cause's slot, and what has no name elsewhere; ``named_ones`` stand for themselves."""
    causes, row, parts = (
        found.problem.causes,
        found.posterior.beside[number],
        {*sums.parts(found.problem.causes[number])},
    )
    out = list[Rival]()
    for k in [k for k in np.argsort(-row) if k not in named_ones and row[k] > SHOWN][:LISTED]:
        if causes[k].effect != Empirical.slug or parts.isdisjoint(sums.parts(causes[k])):
            gain = float(np.log(row[k] / max(row[number], 1e-9)))
            out.append(Rival(causes[k], sums.law(k), gain, sums.tested(k)))
    return out


def _ranked(rivals: Iterable[Rival]) -> tuple[Rival, ...]:
    return tuple(sorted(rivals, key=lambda m: -m.probability))


def _nameless(found: Found, sums: Sums, names: Sequence[Named]) -> list[Named]:
    """What the mode holds without a name, its place and driver known, where no name speaks of these; the largest first.

    What could not be tested is told as the law that it would be.
    """
    cat, machine, out = found.catalogue, found.signatures.machine, list[Named]()
    spoken = {key for n in names if n.said for key in _speaks_of(machine, n)}
    groups: dict[tuple[EffectAtPlace, DriverKind], list[int]] = {}
    for i in chosen(found.problem, found.mode):
        placed = cat.candidates[i]
        for kind in placed.effect.driver_kinds(machine, placed.place, placed.settings_map):
            keys = {(part, driver_of(kind)) for part in sums.parts(placed.at_place)}
            if not cat.named(i) and not keys <= spoken:
                groups.setdefault((EffectAtPlace(Empirical.slug, placed.place), kind), []).append(i)
    gains = _gains(found, list(groups.values()))
    for ((cause, kind), own), gain in zip(groups.items(), gains, strict=True):
        untested = {cat.cause(i) for i in own if cat.has_law(i)}
        laws = [Rival(one, sums.law(found.problem.causes.index(one)), gain, tested=False) for one in untested]
        levels = sums.levels(cause, kind, 0.0)
        out.append(Named(cause, tuple(own), 0.0, 0.0, _ranked(laws), gain, levels=levels, tested=not laws))
    return sorted((n for n in out if n.levels.driver >= NAMED), key=lambda n: -n.gain)


def _gains(found: Found, wanted: Sequence[Collection[int]]) -> list[float]:
    """Log Bayes factor of the mode against it without some of its candidates, for each of ``wanted``."""
    if not wanted:
        return []
    return supports(found.problem.spike_slab, found.mode, [_places(found, own) for own in wanted])


def _places(found: Found, wanted: Collection[int]) -> Index:
    """Places of the columns of some candidates among the columns of the mode's members."""
    held, columns = chosen(found.problem, found.mode), found.linearisation.columns
    owner = [i for i in held for _ in range(columns[i].start, columns[i].stop)]
    return np.flatnonzero(np.isin(owner, list(wanted)))


@dataclass(frozen=True)
class Summary:
    """names: what is more probable than not, at the level at which it is known, the best supported first; leading: what is
    less probable, but leads; inclusion: every effect at every place with the probability of its law, and the sets."""

    names: tuple[Named, ...]
    leading: tuple[Named, ...]
    inclusion: Inclusion

    @property
    def laws(self) -> tuple[Named, ...]:
        """Findings with a name."""
        return tuple(n for n in self.names if not n.nameless)

    @property
    def firm(self) -> tuple[int, ...]:
        """Candidates of names that are more probable than not."""
        return tuple(i for n in self.laws if n.probability > NAMED for i in n.candidates)

    def sure(self, probability: float = 0.0) -> tuple[int, ...]:
        """Return candidates that act at their place by their driver for sure: laws as probable as that, and what has none."""
        sure = [
            n for n in self.names if n.levels.driver >= SURE and (n.nameless or n.probability >= probability)
        ]
        return tuple(i for n in sure for i in n.candidates)


def summarised(found: Found, fit: Estimate) -> Summary:
    """Of a posterior; terms that the likeliest ``fit`` does not hold (bounds left nothing of them) are not told."""
    sums = Sums(found.signatures.machine, found.catalogue, found.problem, found.posterior)
    held, kept = {effect.label for effect in fit.effects}, list[Named]()
    for n in named(found, sums):
        own = tuple(i for i in n.candidates if found.catalogue.candidates[i].label in held)
        kept += [replace(n, candidates=own)] if own else []
    names = _told(found, [n for n in kept if n.said])
    rest = [n for n in kept if n not in names and max(n.levels.driver, n.certainty) >= LEADING]
    return Summary(names, tuple(rest), sums.inclusion())


def _told(found: Found, names: Sequence[Named]) -> tuple[Named, ...]:
    """Each part and driver once: by the name that is surest there, and by others that are more probable than not."""
    spoken, out = set[tuple[str, str]](), list[Named]()
    for one in sorted(names, key=lambda n: -n.probability):
        keys = _speaks_of(found.signatures.machine, one)
        if one.certainty >= NAMED or not keys <= spoken:
            out.append(one)
            spoken |= keys
    return tuple(one for one in names if one in out)


def _speaks_of(machine: Machine, one: Named) -> set[tuple[str, str]]:
    """Parts, each with the driver that a name says of it."""
    return {(part, driver_of(one.levels.kind)) for part in parts_of(machine, *one.cause)}


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
            why = f"{'+'.join(one.cause.place)}: no reading tells it apart from the geometry"
            unseen.append(Untestable(one.cause.effect, why))
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
    cause = EffectAtPlace(Empirical.slug, one.cause.place)
    others = [m for m in one.equivalents if m.cause != cause]
    rest = one.probability - UNREPLICATED + sum(m.probability for m in one.equivalents if m.cause == cause)
    ranked = sorted((*others, Rival(cause, rest, one.gain)), key=lambda m: -m.probability)
    return replace(one, probability=UNREPLICATED, equivalents=tuple(ranked))
