"""What is said of each name, with amplitudes of the fit, of every candidate alone, and of what is left without a name.

That is a driver, a place and a form: a hypothesis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from truepose.arrays import Array
from truepose.identification.diagnosis.alarm import Alarm
from truepose.identification.diagnosis.line_words import line_words
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.result import (
    UNNAMED,
    Alternative,
    Finding,
    Form,
    Quantity,
    Remainder,
    Replication,
)
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.empirical import Empirical, orthonormal, powers, scaled, waves
from truepose.models.file.driver import APPROACH, OF_THE_ORDER, STEP, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of

NOTABLE = 3.0
"""Log Bayes factor below which there is nothing to speak of: of a candidate alone, and between explanations as good."""
_FROM_ORDER: Final = {
    APPROACH: "The side of arrival was taken from the order of the rows, as no `approach` column tells it.",
    STEP: "The last motions were taken from the order of the rows.",
}
"""What a finding rests on that nobody recorded."""
CYCLES = range(1, 9)
"""Cycles over a driver's range that a periodic form may have."""


def finding(
    machine: Machine,
    cat: Catalogue,
    after: Estimate,
    one: Named,
    flip: float | None,
    replication: Replication | None,
    inferred: Callable[[str], bool] = lambda _: False,
) -> Finding:
    """What is said of one name; its terms (harmonics) stand together. ``inferred``: whether nobody recorded a driver."""
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
        flip_lambda=flip,
        explanation=_explanation(machine, cat, after, one, inferred),
        experiment=main.effect.experiment,
        family=one.family,
        replication=replication,
        levels=one.levels,
        tested=one.tested,
    )


def _alternative(cat: Catalogue, member: Rival) -> Alternative:
    """Another explanation of a class."""
    (slug, place), probability, gain = member.cause, member.probability, member.gain
    if slug == Empirical.slug:
        return Alternative(UNNAMED, place, probability, gain)
    kind = next((c.kind for c in cat.candidates if c.at_place == (slug, place)), None)
    experiment = effects.get(slug, "class").experiment
    return Alternative(slug, place, probability, gain, experiment, member.tested, kind)


def _explanation(
    machine: Machine, cat: Catalogue, after: Estimate, one: Named, inferred: Callable[[str], bool]
) -> str:
    """What the effect is, what its fitted coefficients say, and what it takes from the order of the rows.

    Nothing where what leads could not be tested.
    """
    if one.nameless and not one.tested:
        return ""
    first = cat.candidates[one.candidates[0]]
    said = [first.effect.explain_term(machine, one.cause.place, first.settings_map)]
    for placed in (cat.candidates[i] for i in one.candidates):
        fitted = _fitted(after, placed)
        said.append(placed.effect.found(*({n: q[k] for n, q in fitted.items()} for k in (0, 1))))
        said.append(line_words(machine, placed, _lines(after)))
    kinds = {Driver.of(n).kind for i in one.candidates for n in cat.candidates[i].drivers if inferred(n)}
    return " ".join(
        text for text in (*said, *(_FROM_ORDER[kind] for kind in OF_THE_ORDER if kind in kinds)) if text
    )


def _lines(after: Estimate) -> list[float]:
    """Orders of single waves of all joints."""
    waves = (e.settings_map.get("order") for e in after.effects if e.kind == "position-periodic")
    return [order for order in waves if order is not None]


def _fitted(after: Estimate, placed: PlacedEffect) -> dict[str, tuple[float, float]]:
    """Value and 1-sigma of each coefficient."""
    names, std = list(after.prior.names), after.std
    at = {c.name: names.index(f"{placed.label}:{c.name}") for c in placed.coefficients}
    return {name: (float(after.p[k]), float(std[k])) for name, k in at.items()}


def _twins(cat: Catalogue, one: Named) -> list[Alternative]:
    """Effects whose signature is the same function: nothing measured this way can tell them apart."""
    likely: dict[str, float] = {}
    for placed in (cat.candidates[i] for i in one.candidates):
        for slug, ratio in placed.effect.twins(placed.settings_map).items():
            likely.setdefault(slug, ratio)
    total = 1.0 + sum(likely.values())
    place, share, gain = one.cause.place, one.probability / total, one.gain
    return [
        Alternative(slug, place, share * ratio, gain, effects.get(slug, "twin").experiment)
        for slug, ratio in likely.items()
    ]


def _parameters(cat: Catalogue, after: Estimate, candidates: Sequence[int]) -> dict[str, Quantity]:
    out = dict[str, Quantity]()
    for placed in (cat.candidates[i] for i in candidates):
        apart = placed.settings if len(candidates) > 1 else ()
        tail, fitted = "".join(f"[{name}={value:g}]" for name, value in apart), _fitted(after, placed)
        out |= {f"{c.name}{tail}": Quantity(*fitted[c.name], c.unit) for c in placed.coefficients}
    return out


def ranked_alternatives(cat: Catalogue, gain: Array) -> tuple[Alternative, ...]:
    """Every candidate, best first, weighed alone against the model without effects: log Bayes factors (c,)."""
    odds = np.append(gain + np.array(cat.log_prior), 0.0)
    share = np.exp(odds - np.logaddexp.reduce(odds))
    order = [i for i in np.argsort(-odds[:-1]).tolist() if cat.named(i) and np.isfinite(gain[i])]
    return tuple(
        Alternative(*cat.cause(i), float(share[i]), float(gain[i]), cat.candidates[i].effect.experiment)
        for i in order
    )


def evidence_map(cat: Catalogue, gain: Array) -> dict[str, float]:
    """Largest log Bayes factor at each single place; constants count for the part they belong to."""
    out: dict[str, float] = {}
    for i in (i for i in range(len(gain)) if cat.named(i) and np.isfinite(gain[i])):
        place = cat.candidates[i].place
        if len(place) == 1:
            part = element_of(place[0])
            out[part] = max(out.get(part, -np.inf), float(gain[i]))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def remainder_of_residuals(fit: Estimate, recording: Recording, structure: Alarm) -> Remainder:
    """Driver and form of the strongest dependence found by the structure tests."""
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    driver, told = structure.about, Driver.of(structure.about)
    values = recording.columns().get(driver)
    place = (driver,) if driver in recording.joints else ()
    if told.thermal or told.kind == APPROACH:
        place = (told.place,)
    kind, cycles = ("order", 0) if values is None else best_shape(fit.residual[fit.used], values[fit.used])
    return Remainder(place, driver, Form(kind, structure.share, cycles), size)


def remainder_of_form(cat: Catalogue, index: int, fit: Estimate) -> Remainder:
    """A form without a name: where, and what it is a function of."""
    placed = cat.candidates[index]
    assert isinstance(placed.effect, Empirical)
    driver, kind = placed.effect.describe(placed.settings_map)
    return Remainder(placed.place, driver, Form(kind), float(np.sqrt(max(fit.chi2_per_dof, 0.0))))


def best_shape(residual: np.ndarray, values: np.ndarray) -> tuple[str, int]:
    """Best of a few simple shapes of the residuals against the driver: its kind, and how many cycles."""
    if len(np.unique(values)) <= 3:
        return "steps", 0
    t = scaled(values, float(values.min()), float(values.max()))
    shapes = {("linear", 0): powers(t, 1), ("quadratic", 0): powers(t, 2)}
    shapes |= {("periodic", cycles): waves(t, cycles) for cycles in CYCLES}
    best, score = ("linear", 0), -np.inf
    for shape, functions in shapes.items():
        explained = float(np.sum((orthonormal(functions).T @ residual) ** 2))
        gain = explained - 2.0 * len(functions) * residual.shape[1]
        if gain > score:
            best, score = shape, gain
    return best
