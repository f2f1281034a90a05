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
from collections.abc import Callable, Collection, Sequence
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
    Presence,
    Rival,
    driver_of,
    inclusion,
    parts_of,
)
from truepose.identification.diagnosis.result import NAMED, Replication
from truepose.identification.diagnosis.rivals import beside_untested, forms_hold, without_untested
from truepose.identification.diagnosis.search import Found, chosen
from truepose.identification.fit.estimated import Estimate
from truepose.identification.posterior.state import slot_odds, supports
from truepose.identification.signatures.untestable import Untestable
from truepose.models.effects.empirical import Empirical
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import EffectAtPlace

CERTAIN = 0.95
"""Probability from which on a name is said without its look-alikes."""
FAMILY = 3
"""Places of one effect from which on they are told as a family."""


def named(found: Found, said: Inclusion) -> tuple[Named, ...]:
    """Causes of the mode, the best supported first; then what has a place and a driver only.

    Not all of them are more probable than not (``Named.said``).
    """
    problem = found.problem
    causes = dict.fromkeys(int(problem.spike_slab.terms.cause[term]) for term, _ in found.mode.members)
    single = [_single(found, k) for k in causes if problem.causes[k].effect != Empirical.slug]
    presence = Presence(found.signatures.machine, found.catalogue, problem, found.posterior)
    names, candidates = list[Named](), found.catalogue.candidates
    for n in _supported(found, said, single):
        levels = presence.levels(*n.cause, candidates[n.candidates[0]].kind, n.probability)
        names.append(replace(n, levels=levels))
    own = {n.cause for n in names if n.said}
    told = sorted((told_once(n, said, own) for n in names), key=lambda n: -n.gain)
    of_effect = Counter(cause.effect for cause in own)
    together = [
        replace(n, family=n.cause.effect) if n.said and of_effect[n.cause.effect] >= FAMILY else n
        for n in told
    ]
    return (*together, *_nameless(found, presence, together))


def _nameless(found: Found, presence: Presence, names: Sequence[Named]) -> list[Named]:
    """Forms of the mode whose place and driver are known and that no name speaks of, the largest first."""
    cat, machine = found.catalogue, found.signatures.machine
    spoken = {key for n in names if n.said for key in _speaks_of(machine, n)}
    groups: dict[tuple[tuple[str, ...], str], list[int]] = {}
    for i in chosen(found.problem, found.mode):
        placed = cat.candidates[i]
        if not cat.named(i) and (placed.place[0], driver_of(placed.kind)) not in spoken:
            groups.setdefault((placed.place, driver_of(placed.kind)), []).append(i)
    if not groups:
        return []
    gains = supports(found.problem.spike_slab, found.mode, [_places(found, own) for own in groups.values()])
    out = []
    for ((place, _), own), gain in zip(groups.items(), gains, strict=True):
        levels = presence.levels(Empirical.slug, place, cat.candidates[own[0]].kind, 0.0)
        if levels.driver >= NAMED:
            cause = EffectAtPlace(Empirical.slug, place)
            out.append(Named(cause, tuple(own), 0.0, 0.0, (), gain, levels=levels))
    return sorted(out, key=lambda n: -n.gain)


def as_named(said: Inclusion, names: Sequence[Named]) -> Inclusion:
    """Each cause with the probability that its name has: less than there is by what is only like it."""
    own = {n.cause: n.probability for n in names if not n.nameless}
    ranked = sorted({**said.places, **own}.items(), key=lambda item: -item[1])
    return replace(said, places=dict(ranked))


def _supported(found: Found, said: Inclusion, names: Sequence[Named]) -> list[Named]:
    """With the log Bayes factor of each name and of its class, and with what is only like it or a part of something else."""
    if not names:
        return []
    alone = supports(found.problem.spike_slab, found.mode, [_places(found, n.candidates) for n in names])
    gains = [max(gain, _least(found, n)) for gain, n in zip(alone, names, strict=True)]
    held = forms_hold(found, said.nameless, [n.candidates for n in names])
    every = zip(names, gains, held, strict=True)
    return [replace(_beside_alike(n, gain, itself), tested=tested) for n, gain, (itself, tested) in every]


def _least(found: Found, one: Named) -> float:
    """Log Bayes factor that a name has at least: from its prior odds beside the others to those that it was drawn with.

    What the likeliest state says of it may be less: other states hold it, too.
    """
    spike_slab, members = found.problem.spike_slab, found.mode.members
    own = [m for m in members if found.problem.candidates[m[0]] in one.candidates]
    if len(own) != 1:
        return -np.inf
    prior_odds = spike_slab.terms.log_prior_of(own) + slot_odds(found.problem.richness, len(members) - 1)
    sweeps = found.posterior.sweeps  # so many draws tell no more than one in so many
    drawn = (one.probability * sweeps + 1.0) / (sweeps + 2.0)
    return float(np.log(drawn / (1.0 - drawn)) - prior_odds)


def _beside_alike(one: Named, gain: float, held: float) -> Named:
    """A name with its log Bayes factor, where it is the thing itself with a probability ``held``."""
    members = [replace(m, probability=held * m.probability, gain=gain + m.gain) for m in one.equivalents]
    alike = (1.0 - held) * one.probability
    if alike > SHOWN:
        cause = EffectAtPlace(Empirical.slug, one.cause.place)
        members.append(Rival(cause, alike, gain + float(np.log((1.0 - held) / held))))
    own, whole = held * one.probability, held * one.certainty
    return replace(one, probability=own, certainty=whole, gain=gain, equivalents=tuple(members))


def told_once(one: Named, said: Inclusion, own: Collection[EffectAtPlace]) -> Named:
    """One probability for each cause: another explanation is as probable as it is at all, in this stead or beside it.

    ``own``: what is named for itself, and so no other explanation of anything.
    """
    others = [m for m in one.equivalents if m.cause not in own]
    twice = sum(m.probability for m in one.equivalents if m.cause in own)
    at_all = [0.0 if m.cause.effect == Empirical.slug else said.of(m.cause) for m in others]
    as_told = [replace(m, probability=max(m.probability, p)) for m, p in zip(others, at_all, strict=True)]
    ranked = tuple(sorted(as_told, key=lambda m: -m.probability))
    return replace(one, certainty=max(one.certainty - twice, one.probability), equivalents=ranked)


def _single(found: Found, number: int) -> Named:
    """A cause of the mode with what else may be in its slot."""
    problem, posterior = found.problem, found.posterior
    row, own = posterior.beside[number], float(posterior.causes[number])
    rivals = [k for k in np.argsort(-row) if k != number and row[k] > SHOWN][:LISTED]
    others = sum(min(row[k], 1.0) for k in rivals)
    # all that may be in the slot, what has no name included
    certainty = min(1.0, own + sum(row[k] for k in rivals if problem.causes[k].effect != Empirical.slug))
    kept = float(min(1.0, max(1.0 - own, 0.0) / others)) if others > 0.0 else 1.0
    each = ((problem.causes[k], float(min(row[k], 1.0))) for k in rivals)
    shown = tuple(Rival(cause, kept * p, float(np.log(p / max(row[number], 1e-9)))) for cause, p in each)
    terms = [t for t, _ in found.mode.members if int(problem.spike_slab.terms.cause[t]) == number]
    return Named(problem.causes[number], tuple(problem.candidates[t] for t in terms), own, certainty, shown)


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
        """Return candidates that act at their place by their driver for sure, of names as probable as that."""
        sure = [n for n in self.laws if n.levels.driver >= SURE and n.probability >= probability]
        return tuple(i for n in sure for i in n.candidates)


def summarised(found: Found, fit: Estimate) -> Summary:
    """Of a posterior; terms that the likeliest ``fit`` does not hold (bounds left nothing of them) are not told."""
    said = inclusion(found.problem, found.posterior)
    cat = found.catalogue
    held = {effect.label for effect in fit.effects}
    kept = list[Named]()
    for n in named(found, said):
        own = tuple(i for i in n.candidates if cat.candidates[i].label in held)
        kept += [replace(n, candidates=own)] if own else []
    every = beside_untested(found, kept)
    shown = without_untested(found, every)
    names = _told(found, [n for n in shown if n.said])
    rest = [n for n in shown if n not in names and max(n.levels.driver, n.certainty) >= LEADING]
    return Summary(names, tuple(rest), as_named(said, every))


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
