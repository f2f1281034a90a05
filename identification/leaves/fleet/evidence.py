"""What is kept of one diagnosed machine for the statistics of its fleet: a few kB that JSON can hold.

``kept`` stores evidence, not conclusions: of every effect at every place a Bayes factor that is free of the prior that the
diagnosis was made with, so that a fleet can be summed up under any prior, and never counts what a prior said twice.

What a recording says of every effect at every place, free of the prior it was weighed with: for a fleet's statistics.

``diagnose(..., examine=evidence)`` has it in ``Diagnosis.examined``.

The log Bayes factor of a cause is its posterior log odds less its prior ones. Prior odds depend on what else is there (how
rich the machine is, what is alike); they are averaged over the posterior's states, each without the cause:

    ln B = logit P - logit p,   p = sum over states of their share times P(cause | the rest of the state)

Sizes that nobody would notice here are no part of P, and none of p. Of all sizes together ln (u + (1 - u) B) remains, with u
their prior share: where nothing would be noticed, nothing is said.

Rivals share what they explain: where a slot of the posterior may hold one of several, each of them has a Bayes factor that is
large, but they are not all there. ``credit`` is a cause's share of its slots.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import expit, logit

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.posterior_summary import Inclusion
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.diagnosis.search import Found
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tolerance_classes import part_classes
from truepose.identification.posterior.spike_slab import Members
from truepose.identification.posterior.state import State, moments, slot_odds, typical

# -- What a recording says of every effect at every place, free of the prior it was weighed with: for a fleet's statistics

STATES, MOMENTS = 24, 6
"""States of the posterior that prior odds are averaged over, and those that sizes are taken from."""
SMALLEST, LARGEST = -12.0, 15.0
"""Log Bayes factors beyond which a chain of some hundred sweeps tells no more. Chosen."""
THERE = 0.02
"""Probability from which on sizes are told."""


@dataclass(frozen=True)
class Amount:
    """How large an effect is, given that it is there: mean and 1-sigma of the log of its rms coefficient in units of the
    largest expected one, and the same mean in its ``unit``, which is empty where coefficients have several."""

    log_mean: float
    log_std: float
    log_amount: float
    unit: str


@dataclass(frozen=True)
class PlaceEvidence:
    """What is said of an effect at a place (at any, where ``place`` is empty), and what of that the recording said.

    probability, prior: that it is there, after and before; log_bayes_factor: of it at the sizes that would be noticed against
    nothing, free of the prior; unseen: prior share of the other sizes; credit: its share among the explanations of what it
    would explain; sizes: how probable each size of the slab is.
    """

    effect: str
    place: tuple[str, ...]
    probability: float
    prior: float
    log_bayes_factor: float
    unseen: float
    credit: float = 1.0
    sizes: tuple[float, ...] = ()
    size: Amount | None = None


def evidence(found: Found, said: Inclusion) -> tuple[tuple[PlaceEvidence, ...], tuple[PlaceEvidence, ...]]:
    """Of each effect at each place, and of each effect at any of its places."""
    problem = found.problem
    causes, states = problem.causes, typical(found.posterior.states, STATES)
    raw = np.asarray(found.posterior.causes)
    own = np.array([said.places.get(c, p) for c, p in zip(causes, raw.tolist(), strict=True)])
    sizes, amounts = _sizes(found), _amounts(found)
    slugs = list(dict.fromkeys(c.effect for c in causes))
    slug = np.array([slugs.index(c.effect) for c in causes], dtype=np.intp)
    prior, any_prior = np.zeros((2, len(causes))), np.zeros((2, len(slugs)))
    for state, share in states:
        beside = _Beside(found, state)
        for k in range(len(causes)):
            prior[:, k] += share * expit(beside.without({k})[:, k])
        for j in range(len(slugs)):
            at = np.flatnonzero(slug == j)
            none = np.sum(np.logaddexp(0.0, beside.without(set(at.tolist()))[:, at]), axis=1)
            any_prior[:, j] -= share * np.expm1(-none)
    credit, any_credit = _credits(found, slug, own)
    present = _present(found, slug, len(slugs), own, raw)
    places = tuple(
        _told(*causes[k], (own[k], *prior[:, k]), credit[k], sizes[k], amounts.get(k))
        for k in range(len(causes))
    )
    anywhere = tuple(
        _told(name, (), (present[j], *any_prior[:, j]), any_credit[j], np.zeros(0), None)
        for j, name in enumerate(slugs)
    )
    return places, anywhere


def _told(
    effect: str, place: tuple[str, ...], chances: tuple[float, float, float], credit: float, sizes: Array,
    amount: Amount | None,
) -> PlaceEvidence:  # fmt: skip
    """``chances``: its probability, the prior one, and that at sizes which would be noticed."""
    probability, prior, noticed = chances
    least = 1e-12
    unseen = 1.0 - float(np.clip(noticed / max(prior, least), 0.0, 1.0))
    ends = np.clip([probability, noticed], least, 1.0 - least)
    factor = float(np.clip(logit(ends[0]) - logit(ends[1]), SMALLEST, LARGEST)) if noticed > least else 0.0
    there = probability > THERE and sizes.sum() > 0.0
    return PlaceEvidence(
        effect=effect,
        place=tuple(place),
        probability=float(probability),
        prior=float(prior),
        log_bayes_factor=factor,
        unseen=unseen,
        credit=float(credit),
        sizes=tuple((sizes / sizes.sum()).tolist()) if there else (),
        size=amount if there else None,
    )


def _credits(found: Found, slug: Index, own: Array) -> tuple[Array, Array]:
    """Share (n,) of each cause of what its slots may hold; and (e,) of each effect, its places weighed by how probable they
    are. What no slot held has no rivals."""
    beside = found.posterior.beside
    held = beside.sum(axis=1)
    some = np.where(held > 0.0, held, 1.0)
    alone = np.where(held > 0.0, np.diag(beside) / some, 1.0)
    alike = np.where(held > 0.0, np.sum(beside * (slug[:, None] == slug), axis=1) / some, 1.0)
    weight, count = np.maximum(own, 1e-12), int(slug.max(initial=-1)) + 1
    summed = np.bincount(slug, weights=weight * alike, minlength=count)
    return alone, summed / np.bincount(slug, weights=weight, minlength=count)


class _Beside:
    """Prior log odds (2, n) of causes beside the members of a state: at any size, and at sizes that would be noticed."""

    def __init__(self, found: Found, state: State) -> None:
        self._problem, self._members = found.problem, state.members
        self._cause = found.problem.spike_slab.terms.cause
        self._known = dict[Members, Array]()

    def without(self, causes: set[int]) -> Array:
        """Beside the members that are of no such cause."""
        rest = tuple(m for m in self._members if int(self._cause[m[0]]) not in causes)
        if rest not in self._known:
            self._known[rest] = self._odds(rest)
        return self._known[rest]

    def _odds(self, rest: Members) -> Array:
        spike_slab = self._problem.spike_slab
        by_size = spike_slab.terms.log_prior(rest) + slot_odds(self._problem.richness, len(rest))
        out = np.full((2, len(self._problem.causes)), -np.inf)
        noticed = np.where(spike_slab.noticeable, by_size, -np.inf)
        for odds, sizes in zip(out, (by_size, noticed), strict=True):
            np.logaddexp.at(odds, self._cause, np.logaddexp.reduce(sizes, axis=0))
        return out


def _present(found: Found, slug: Index, count: int, own: Array, raw: Array) -> Array:
    """(count,) probability of each effect anywhere, less what is only like it: as its likeliest place has it."""
    cause, out = found.problem.spike_slab.terms.cause, np.zeros(count)
    for state, share in found.posterior.states:
        out[np.unique(slug[cause[[t for t, _ in state.members]]])] += share
    for j in range(count):
        at = np.flatnonzero(slug == j)
        best = at[np.argmax(raw[at])]
        out[j] = max(out[j] * min(own[best] / max(raw[best], 1e-300), 1.0), own[at].max())
    return np.minimum(out, 1.0)


def _sizes(found: Found) -> Array:
    """(n, s) probability of each cause at each size."""
    spike_slab = found.problem.spike_slab
    out = np.zeros((len(found.problem.causes), len(spike_slab.sizes.values)))
    for state, share in found.posterior.states:
        for term, size in state.members:
            out[spike_slab.terms.cause[term], size] += share
    return out


def _amounts(found: Found) -> Mapping[int, Amount]:
    """Size of each cause that is in one of some typical states: a mixture of what these say."""
    drawn: dict[int, list[tuple[float, Amount]]] = {}
    for state, share in typical(found.posterior.states, MOMENTS):
        for cause, size in _of_state(found, state):
            drawn.setdefault(cause, []).append((share, size))
    return {cause: _averaged(every) for cause, every in drawn.items()}


def _averaged(every: list[tuple[float, Amount]]) -> Amount:
    weight = np.array([share for share, _ in every])
    weight /= weight.sum()
    mean, std, amount = np.array([(one.log_mean, one.log_std, one.log_amount) for _, one in every]).T
    centre = float(weight @ mean)
    spread = float(np.sqrt(weight @ (std**2 + (mean - centre) ** 2)))
    return Amount(centre, spread, float(weight @ amount), every[0][1].unit)


def _of_state(found: Found, state: State) -> Iterator[tuple[int, Amount]]:
    """Yield each cause of a state with its size."""
    problem, spike_slab, candidates = found.problem, found.problem.spike_slab, found.catalogue.candidates
    if not state.members:
        return
    known = moments(spike_slab, state)
    terms = [t for t, _ in state.members for _ in spike_slab.terms.columns[t]]
    coefficients = [
        c
        for t, _ in state.members
        for c in candidates[problem.candidates[t]].coefficients[: len(spike_slab.terms.columns[t])]
    ]
    owner, first = spike_slab.terms.cause[terms], len(known.at) - len(terms)
    for cause in np.unique(owner):
        at = np.flatnonzero(owner == cause)
        mean, variance = known.mean[first + at], np.diag(known.covariance)[first + at]
        square = np.maximum(mean**2, 1e-300)
        std = np.sqrt(square @ variance) / square.sum()
        units = {coefficients[k].unit for k in at}
        scale = np.array([coefficients[k].scale for k in at])
        rms = 0.5 * np.log(np.mean(square + variance))
        amount = 0.5 * np.log(np.mean((square + variance) * scale**2))
        unit = units.pop() if len(units) == 1 else ""
        yield int(cause), Amount(float(rms), float(min(std, 3.0)), float(amount), unit)


# -- What is kept of one diagnosed machine for the statistics of its fleet: a few kB that JSON can hold

KEPT = "truepose/kept/1"
DETERMINED = 3.0
"""1-sigma of what the readings alone say of a constant, in its tolerances, beyond which they say nothing of it."""
FINEST = 1e-3
"""Smallest 1-sigma of a constant that is kept, in tolerances: no fit of a model is better than that."""


def kept(diagnosis: Diagnosis) -> dict[str, Any]:
    """What the fleet's statistics need of a machine that was diagnosed with ``examine=evidence``.

    Returns a dict of texts, numbers, lists and dicts: ``machine``, ``mechanism`` (its type), ``verdict``; ``places``: by effect
    and place ``[probability, prior, log Bayes factor, unseen, credit]`` (``unseen``: prior share of sizes that the recording
    would not show; ``credit``: its share among rivals), and where it may be there a dict besides: ``sizes``, how probable each
    size of the slab is, ``size``, [mean, std] of the log of its rms coefficient in expected largest sizes, and ``amount``, the
    same mean in ``unit``; ``anywhere``: by effect the same five numbers, of any of its places; ``parameters``: by name what
    the readings alone say, [deviation, std] in tolerances, and its class of parts.
    """
    machine = diagnosis.nominal
    return {
        "schema": KEPT,
        "machine": machine.name,
        "mechanism": machine.mechanism_type,
        "verdict": diagnosis.verdict,
        "places": _by_effect(diagnosis.examined[0]),
        "anywhere": {one.effect: _place(one) for one in diagnosis.examined[1]},
        "parameters": _parameters(diagnosis.after),
    }


def _by_effect(every: Sequence[PlaceEvidence]) -> dict[str, dict[str, list[Any]]]:
    out: dict[str, dict[str, list[Any]]] = {}
    for one in every:
        out.setdefault(one.effect, {})["+".join(one.place)] = _place(one)
    return out


def _place(one: PlaceEvidence) -> list[Any]:
    """Rounded to what matters: a hundredth of a nat, four digits of a probability."""
    p, prior, unseen, credit = map(_short, (one.probability, one.prior, one.unseen, one.credit))
    out: list[Any] = [p, prior, round(one.log_bayes_factor, 2), unseen, credit]
    more: dict[str, Any] = {}
    if one.sizes:
        more["sizes"] = [round(p, 3) for p in one.sizes]
    if one.size is not None:
        more["size"] = [round(one.size.log_mean, 3), round(one.size.log_std, 3)]
        more |= {"amount": round(one.size.log_amount, 3), "unit": one.size.unit} if one.size.unit else {}
    return [*out, more] if more else out


def _short(value: float) -> float:
    return float(f"{value:.4g}") if abs(value) >= 1e-6 else 0.0


def _parameters(fit: Estimate) -> dict[str, list[float | str]]:
    """By name: deviation and its 1-sigma, in tolerances, as the readings alone say it, and the class of parts.

    A fit is N(m, v) from a prior N(0, w) and the readings' N(x, e): 1 / e = 1 / v - 1 / w, x = m e / v (variances).
    """
    free = [k for k in fit.prior.free if k < len(fit.nominal.parameters)]
    tolerance = {k: fit.nominal.parameters[k].tolerance for k in free}
    at = [k for k in free if 0.0 < tolerance[k] < np.inf]
    if not at:
        return {}
    scale = np.array([tolerance[k] for k in at])
    v = (fit.std[at] / scale) ** 2
    w = (fit.prior.sigma[at] * fit.noise / scale) ** 2
    told = 1.0 / np.maximum(v, FINEST**2) - 1.0 / w  # w is infinite without a prior
    names = [fit.prior.names[k] for k in at]
    classes = part_classes(names, [fit.prior.parts[k] for k in at])
    out: dict[str, list[float | str]] = {}
    for k, name in enumerate(names):
        if told[k] < DETERMINED**-2:
            continue
        x = fit.in_tolerances[at[k]] / max(v[k], FINEST**2) / told[k]
        kind = " ".join(part for part in (classes[k].kind, classes[k].parts) if part)
        out[name] = [_short(float(x)), _short(float(told[k] ** -0.5)), kind]
    return out
