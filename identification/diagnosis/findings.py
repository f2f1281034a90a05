"""From what is named to findings, with amplitudes of the fit; and every candidate weighed alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.naming import Named, Rival
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Finding,
    Lead,
    Quantity,
    Replication,
)
from truepose.identification.fit.estimate import Estimate
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effects.base import effects
from truepose.models.effects.empirical import Empirical
from truepose.models.machine import Machine
from truepose.models.parameters import element_of

Array = NDArray[np.float64]


def ranked_alternatives(cat: Catalogue, gain: Array) -> tuple[Alternative, ...]:
    """Every candidate, best first, weighed alone against the model without effects: log Bayes factors (c,)."""
    odds = np.append(gain + np.array(cat.log_prior), 0.0)
    share = np.exp(odds - np.logaddexp.reduce(odds))
    order = [int(i) for i in np.argsort(-odds[:-1]) if cat.named(int(i)) and np.isfinite(gain[i])]
    return tuple(_candidate(cat, i, float(share[i]), float(gain[i])) for i in order)


def _candidate(cat: Catalogue, index: int, probability: float, gain: float) -> Alternative:
    placed = cat.candidates[index]
    return Alternative(placed.effect.slug, placed.place, probability, gain, placed.effect.experiment)


def evidence_map(cat: Catalogue, gain: Array) -> dict[str, float]:
    """Largest log Bayes factor at each single place; constants count for the part they belong to."""
    out: dict[str, float] = {}
    for i in (i for i in range(len(gain)) if cat.named(i) and np.isfinite(gain[i])):
        place = cat.candidates[i].place
        if len(place) == 1:
            part = element_of(place[0])
            out[part] = max(out.get(part, -np.inf), float(gain[i]))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def finding(
    machine: Machine,
    cat: Catalogue,
    after: Estimate,
    one: Named,
    flip: float | None,
    replication: Replication | None,
) -> Finding:
    """What is said of one name; its terms (harmonics) stand together."""
    main = cat.candidates[one.candidates[0]]
    twins = [] if one.nameless else _twins(cat, one)
    shared = sum(t.probability for t in twins)
    rivals = sorted((*twins, *(_alternative(cat, m) for m in one.equivalents)), key=lambda o: -o.probability)
    return Finding(
        effect=one.cause.effect,
        place=one.cause.place,
        probability=one.probability - shared,
        certainty=one.certainty,
        log_bayes_factor=one.gain,
        equivalents=tuple(rivals),
        parameters=_parameters(cat, after, one.candidates),
        settings=tuple(cat.candidates[i].settings_map for i in one.candidates),
        prior_dependent=flip is not None,
        flip_lambda=flip,
        explanation=_explanation(machine, cat, after, one),
        experiment=main.effect.experiment,
        family=one.family,
        replication=replication,
        levels=one.levels,
        tested=one.tested,
    )


def lead(one: Named) -> Lead:
    """What leads below the level at which it would be a finding."""
    return Lead(one.cause.effect, one.cause.place, one.levels, one.probability)


def _alternative(cat: Catalogue, member: Rival) -> Alternative:
    """Another explanation of a class."""
    slug = member.cause.effect
    if slug == Empirical.slug:
        return Alternative(UNNAMED, member.cause.place, member.probability, member.gain)
    experiment = effects.get(slug, "class").experiment
    kind = next((c.kind for c in cat.candidates if c.at_place == (slug, member.cause.place)), None)
    return Alternative(
        slug, member.cause.place, member.probability, member.gain, experiment, member.tested, kind
    )


def _explanation(machine: Machine, cat: Catalogue, after: Estimate, one: Named) -> str:
    """What the effect is, and what its fitted coefficients say; nothing where what leads could not be tested."""
    if one.nameless and not one.tested:
        return ""
    said = [cat.candidates[one.candidates[0]].effect.explain(machine, one.cause.place)]
    names, std = list(after.prior.names), after.std
    for i in one.candidates:
        placed = cat.candidates[i]
        at = {c.name: names.index(f"{placed.label}:{c.name}") for c in placed.coefficients}
        values = {n: float(after.p[k]) for n, k in at.items()}
        said.append(placed.effect.found(values, {n: float(std[k]) for n, k in at.items()}))
    return " ".join(text for text in said if text)


def _twins(cat: Catalogue, one: Named) -> list[Alternative]:
    """Effects whose signature is the same function: nothing measured this way can tell them apart."""
    likely: dict[str, float] = {}
    for placed in (cat.candidates[i] for i in one.candidates):
        for slug, ratio in placed.effect.twins(placed.settings_map).items():
            likely.setdefault(slug, ratio)
    total = 1.0 + sum(likely.values())
    return [
        Alternative(
            slug,
            one.cause.place,
            one.probability * ratio / total,
            one.gain,
            effects.get(slug, "twin").experiment,
        )
        for slug, ratio in likely.items()
    ]


def _parameters(cat: Catalogue, after: Estimate, candidates: Sequence[int]) -> dict[str, Quantity]:
    out = {}
    names, std = list(after.prior.names), after.std
    for i in candidates:
        placed = cat.candidates[i]
        tail = (
            "".join(f"[{name}={value:g}]" for name, value in placed.settings) if len(candidates) > 1 else ""
        )
        for c in placed.coefficients:
            at = names.index(f"{placed.label}:{c.name}")
            out[f"{c.name}{tail}"] = Quantity(float(after.p[at]), float(std[at]), c.unit)
    return out
