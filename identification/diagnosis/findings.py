"""From accepted terms to findings: terms of one effect at one place (harmonics) are one finding."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.classes import Named
from truepose.identification.diagnosis.effect_selection import Ranking
from truepose.identification.diagnosis.result import Alternative, Finding, Quantity
from truepose.identification.fit.estimate import Estimate
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine import Machine
from truepose.models.parameters import element_of


def alternative(cat: Catalogue, index: int, probability: float, gain: float) -> Alternative:
    """A candidate as another explanation."""
    placed = cat.candidates[index]
    return Alternative(placed.effect.slug, placed.place, probability, gain, placed.effect.experiment)


def ranked_alternatives(cat: Catalogue, ranking: Ranking) -> tuple[Alternative, ...]:
    """Every screened candidate, best first, weighed alone against the model without effects."""
    odds = np.append(ranking.odds, 0.0)
    share = np.exp(odds - np.logaddexp.reduce(odds))
    order = [i for i in np.argsort(-ranking.odds) if cat.named(int(i))]
    return tuple(alternative(cat, int(i), float(share[i]), float(ranking.gain[i])) for i in order)


def evidence_map(cat: Catalogue, ranking: Ranking) -> dict[str, float]:
    """Largest log Bayes factor at each single place; constants count for the part they belong to."""
    out: dict[str, float] = {}
    for i, gain in zip(ranking.indices, ranking.gain, strict=True):
        place = cat.candidates[i].place
        if len(place) == 1 and cat.named(i):
            part = element_of(place[0])
            out[part] = max(out.get(part, -np.inf), float(gain))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def merge_findings(
    machine: Machine, cat: Catalogue, after: Estimate, named: Sequence[Named], flips: Sequence[float | None]
) -> tuple[Finding, ...]:
    """One finding per effect and place, surest first."""
    groups: dict[tuple[str, tuple[str, ...]], list[int]] = {}
    for k, item in enumerate(named):
        groups.setdefault(cat.cause(item.index), []).append(k)
    out = [
        _finding(machine, cat, after, [named[k] for k in ks], [flips[k] for k in ks])
        for ks in groups.values()
    ]
    return tuple(sorted(out, key=lambda f: -f.log_bayes_factor))


def _finding(
    machine: Machine, cat: Catalogue, after: Estimate, items: Sequence[Named], flips: Sequence[float | None]
) -> Finding:
    main = max(items, key=lambda item: item.gain)
    placed = cat.candidates[main.index]
    equivalents: dict[tuple[str, tuple[str, ...]], Alternative] = {}
    for item in items:
        for twin in _twins(cat, item):
            equivalents.setdefault((twin.effect, twin.place), twin)
        for member in item.equivalents:
            other = alternative(cat, member.index, member.probability, member.gain)
            key = (other.effect, other.place)
            if key == cat.cause(main.index):
                continue
            first = equivalents.get(key)
            equivalents[key] = other if first is None else _together(first, other)
    flip = None if any(f is None for f in flips) else max(f for f in flips if f is not None)
    certainty = max(item.certainty for item in items)
    probability = _own_probability(cat, main, items)
    # each term has rivals of its own: together they share what the finding is sure of
    kept = min(1.0, certainty / (probability + sum(o.probability for o in equivalents.values())))
    rivals = sorted(
        (replace(o, probability=kept * o.probability) for o in equivalents.values()),
        key=lambda o: -o.probability,
    )
    return Finding(
        effect=placed.effect.slug,
        place=placed.place,
        probability=kept * probability,
        certainty=certainty,
        log_bayes_factor=sum(item.gain for item in items),
        equivalents=tuple(rivals),
        parameters=_parameters(cat, after, items),
        settings=tuple(cat.candidates[i.index].settings_map for i in items),
        prior_dependent=flip is not None,
        flip_lambda=flip,
        explanation=_explanation(machine, cat, after, items, placed),
        experiment=placed.effect.experiment,
    )


def _own_probability(cat: Catalogue, main: Named, items: Sequence[Named]) -> float:
    """Probability of the effect at its place, at any settings, without its twins' share."""
    here = cat.candidates[main.index]

    def same(index: int) -> bool:
        return cat.cause(index) == (here.effect.slug, here.place)

    total = max(i.probability + sum(m.probability for m in i.equivalents if same(m.index)) for i in items)
    share = 1.0 - sum(t.probability for t in _twins(cat, main)) / max(main.probability, 1e-300)
    return min(1.0, total) * share


def _together(a: Alternative, b: Alternative) -> Alternative:
    """One explanation at two settings: probabilities add up."""
    best = max(a, b, key=lambda other: other.log_bayes_factor)
    return replace(best, probability=min(1.0, a.probability + b.probability))


def _explanation(
    machine: Machine, cat: Catalogue, after: Estimate, items: Sequence[Named], main: PlacedEffect
) -> str:
    """What the effect is, and what its fitted coefficients say."""
    said = [main.effect.explain(machine, main.place)]
    names, std = list(after.prior.names), after.std
    for item in items:
        placed = cat.candidates[item.index]
        at = {c.name: names.index(f"{placed.label}:{c.name}") for c in placed.coefficients}
        said.append(
            placed.effect.found(
                {n: float(after.p[k]) for n, k in at.items()}, {n: float(std[k]) for n, k in at.items()}
            )
        )
    return " ".join(text for text in said if text)


def _twins(cat: Catalogue, item: Named) -> list[Alternative]:
    """Effects whose signature is the same function: nothing measured this way can tell them apart."""
    placed = cat.candidates[item.index]
    likely = placed.effect.twins(placed.settings_map)
    total = 1.0 + sum(likely.values())
    return [
        Alternative(
            slug,
            placed.place,
            item.probability * ratio / total,
            item.gain,
            effects.get(slug, "twin").experiment,
        )
        for slug, ratio in likely.items()
    ]


def _parameters(cat: Catalogue, after: Estimate, items: Sequence[Named]) -> dict[str, Quantity]:
    out = {}
    names, std = list(after.prior.names), after.std
    for item in items:
        placed = cat.candidates[item.index]
        tail = "".join(f"[{name}={value:g}]" for name, value in placed.settings) if len(items) > 1 else ""
        doubts = item.doubt or (0.0,) * len(placed.coefficients)
        for c, doubt in zip(placed.coefficients, doubts, strict=True):
            at = names.index(f"{placed.label}:{c.name}")
            out[f"{c.name}{tail}"] = Quantity(float(after.p[at]), float(np.hypot(std[at], doubt)), c.unit)
    return out
