"""What is said of each name, with amplitudes of the fit, of every candidate alone, and of what is left without a name.

That is a driver, a place and a form: a hypothesis.

What a line is: whole cycles of a motor behind a gear, the lines of an encoder, or cycles of the joint that have no name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from scipy.stats import binom

from truepose.arrays import Array
from truepose.identification.diagnosis import result
from truepose.identification.diagnosis.naming import Supported
from truepose.identification.diagnosis.open_question import question, with_tool
from truepose.identification.diagnosis.posterior_summary import Named, Rival
from truepose.identification.diagnosis.proof import flip_inflation
from truepose.identification.diagnosis.search import Found
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.empirical import Empirical
from truepose.models.effects.polynomials import orthonormal, powers, scaled, waves
from truepose.models.effects.transmission_error import HIGHEST_ORDER
from truepose.models.file.driver import APPROACH, OF_THE_ORDER, STEP, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.mechanism import element_of
from truepose.threads import in_order

SLOWEST, FASTEST = 30.0, 320.0
"""Ratios of gears that are looked for where the file states none: those of strain wave gears."""
WITHIN = 1.0
"""Orders by which a whole multiple may be missed: lines are told to an order, and the arc of a joint is often shorter than a
turn."""
CHANCE = 0.05
"""How often, at most, lines that share nothing are said to share a ratio."""


def line_words(machine: Machine, placed: PlacedEffect, lines: Sequence[float]) -> str:
    """Of one term: cycles a joint turn, and what they are; empty where it is no line. ``lines``: all orders of the fit."""
    order = placed.settings_map.get("order", 0.0)
    if order <= HIGHEST_ORDER:
        return ""
    joint = placed.place[0]
    ratio = abs(machine.mechanism.actuator(joint).gear_ratio or 0.0)
    power = round(np.log2(order)) if _power(order) else 0
    said = f"A line at {order:g} cycles a turn of {joint}"
    if ratio and _multiple(order, ratio):
        return f"{said}: {round(order / ratio)} a turn of its motor."
    if power:
        return f"{said}: 2^{power}, as the lines of an encoder or their halves."
    common = 0.0 if ratio else common_ratio(lines)
    if common and _multiple(order, common):
        return f"{said}: {round(order / common)} of {common:g}, a ratio that several lines share, as of a motor's gear."
    return f"{said}."


def common_ratio(lines: Sequence[float]) -> float:
    """The ratio of which more lines are whole multiples than chance allows; 0 where there is none.

    The chance of a ratio is binomial, times the number of ratios tried (Bonferroni): of two lines it is never small enough.
    """
    fast = [k for k in lines if k > HIGHEST_ORDER and not _power(k)]
    tried = np.arange(SLOWEST, FASTEST + 0.25, 0.5)
    hits = np.array([sum(_multiple(k, r) for k in fast) for r in tried])
    share = (2.0 * WITHIN + 1.0) / tried  # of whole numbers that are next to a multiple
    chance = len(tried) * np.asarray(binom.sf(hits - 1, len(fast), share))
    best = np.flatnonzero(chance == chance.min())[-1]
    return float(tried[best]) if chance[best] < CHANCE else 0.0


def _power(order: float) -> bool:
    """Whether it is a power of two."""
    return bool(abs(order - 2.0 ** round(np.log2(order))) <= WITHIN)


def _multiple(order: float, ratio: float) -> bool:
    times = round(order / ratio)
    return times >= 1 and abs(order - times * ratio) <= WITHIN


_FROM_ORDER: Final = {
    APPROACH: "The side of arrival was taken from the order of the rows, as no `approach` column tells it.",
    STEP: "The last motions were taken from the order of the rows.",
}
"""What a finding rests on that nobody recorded."""
CYCLES = range(1, 9)
"""Cycles over a driver's range that a periodic form may have."""


def findings_of(
    found: Found, supported: Supported, likeliest: Estimate, after: Estimate
) -> tuple[result.Finding, ...]:
    """Return the findings; what is more probable than not has the size that the deployed fit has, where it has any."""
    cat, names = found.catalogue, supported.summary.names
    recording, deployed = found.signatures.recording, {e.label for e in after.effects}
    out = []
    flips = in_order(partial(flip_inflation, found), names)
    for one, half, flip in zip(names, supported.replications, flips, strict=True):
        labels = {cat.candidates[i].label for i in one.candidates}
        fit = after if one.probability >= result.NAMED and labels <= deployed else likeliest
        said = finding(found.signatures.machine, cat, fit, one, flip, half, recording.inferred)
        law = cat.candidates[one.candidates[0]]
        law = law.with_values([value for value, _ in _fitted(fit, law).values()])
        out.append(replace(said, question=question(cat, one, law, recording.drivers)))
    return with_tool(out, [[cat.candidates[i].label for i in one.candidates] for one in names], likeliest)


def remainder_of(
    found: Found,
    verdict: str,
    nameless: Sequence[int],
    after: Estimate,
    structure: result.Alarm,
    gain: Mapping[str, float],
) -> result.Remainder | None:
    """Return what has no name: the form that carries most of it; else what the structure tests say of the residuals."""
    if nameless:
        return replace(remainder_of_form(found.catalogue, nameless[0], after), gain=gain)
    if verdict == "unknown" or structure.raised:
        return remainder_of_residuals(after, found.signatures.recording, structure)
    return None


def finding(
    machine: Machine,
    cat: Catalogue,
    after: Estimate,
    one: Named,
    flip: float | None,
    replication: result.Replication | None,
    inferred: Callable[[str], bool] = lambda _: False,
) -> result.Finding:
    """What is said of one name; its terms (harmonics) stand together. ``inferred``: whether nobody recorded a driver."""
    main = cat.candidates[one.candidates[0]]
    twins = [] if one.nameless else _twins(cat, one)
    shared = sum(t.probability for t in twins)
    rivals = sorted((*twins, *(_alternative(cat, m) for m in one.equivalents)), key=lambda o: -o.probability)
    return result.Finding(
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


def _alternative(cat: Catalogue, member: Rival) -> result.Alternative:
    """Another explanation of a class."""
    (slug, place), probability, gain = member.cause, member.probability, member.gain
    if slug == Empirical.slug:
        return result.Alternative(result.UNNAMED, place, probability, gain)
    kind = next((c.kind for c in cat.candidates if c.at_place == (slug, place)), None)
    experiment = effects.get(slug, "class").experiment
    return result.Alternative(slug, place, probability, gain, experiment, member.tested, kind)


def _explanation(
    machine: Machine, cat: Catalogue, after: Estimate, one: Named, inferred: Callable[[str], bool]
) -> str:
    """What the effect is, what its fitted coefficients say, and what it takes from the order of the rows.

    Nothing where what leads could not be tested.
    """
    if one.nameless and not one.tested:
        return ""
    first = cat.candidates[one.candidates[0]]
    waves = [e.settings_map for e in after.effects if e.kind == "position-periodic"]  # of all joints
    orders = [wave["order"] for wave in waves if "order" in wave]
    said = [first.effect.explain(machine, one.cause.place, first.settings_map)]
    for placed in (cat.candidates[i] for i in one.candidates):
        fitted = _fitted(after, placed)
        said.append(placed.effect.found(*({n: q[k] for n, q in fitted.items()} for k in (0, 1))))
        said.append(line_words(machine, placed, orders))
    kinds = {Driver.of(n).kind for i in one.candidates for n in cat.candidates[i].drivers if inferred(n)}
    said += [_FROM_ORDER[kind] for kind in OF_THE_ORDER if kind in kinds]
    return " ".join(text for text in said if text)


def _fitted(after: Estimate, placed: PlacedEffect) -> dict[str, tuple[float, float]]:
    """Value and 1-sigma of each coefficient."""
    names, std = list(after.prior.names), after.std
    at = {c.name: names.index(f"{placed.label}:{c.name}") for c in placed.coefficients}
    return {name: (float(after.p[k]), float(std[k])) for name, k in at.items()}


def _twins(cat: Catalogue, one: Named) -> list[result.Alternative]:
    """Effects whose signature is the same function: nothing measured this way can tell them apart."""
    likely: dict[str, float] = {}
    for placed in (cat.candidates[i] for i in one.candidates):
        for slug, ratio in placed.twins.items():
            likely.setdefault(slug, ratio)
    share, out = one.probability / (1.0 + sum(likely.values())), list[result.Alternative]()
    for slug, ratio in likely.items():
        experiment = effects.get(slug, "twin").experiment
        out.append(result.Alternative(slug, one.cause.place, share * ratio, one.gain, experiment))
    return out


def _parameters(cat: Catalogue, after: Estimate, candidates: Sequence[int]) -> dict[str, result.Quantity]:
    out = dict[str, result.Quantity]()
    for placed in (cat.candidates[i] for i in candidates):
        apart = placed.settings if len(candidates) > 1 else ()
        tail, fitted = "".join(f"[{name}={value:g}]" for name, value in apart), _fitted(after, placed)
        out |= {f"{c.name}{tail}": result.Quantity(*fitted[c.name], c.unit) for c in placed.coefficients}
    return out


def ranked_alternatives(cat: Catalogue, gain: Array) -> tuple[result.Alternative, ...]:
    """Every candidate, best first, weighed alone against the model without effects: log Bayes factors (c,)."""
    odds = np.append(gain + np.array(cat.log_prior), 0.0)
    share = np.exp(odds - np.logaddexp.reduce(odds))
    order = [i for i in np.argsort(-odds[:-1]).tolist() if cat.named(i) and np.isfinite(gain[i])]
    each = ((i, float(share[i]), float(gain[i]), cat.candidates[i].effect) for i in order)
    return tuple(result.Alternative(*cat.cause(i), p, g, effect.experiment) for i, p, g, effect in each)


def evidence_map(cat: Catalogue, gain: Array) -> dict[str, float]:
    """Largest log Bayes factor at each single place; constants count for the part they belong to."""
    out: dict[str, float] = {}
    for i in (i for i in range(len(gain)) if cat.named(i) and np.isfinite(gain[i])):
        place = cat.candidates[i].place
        if len(place) == 1:
            part = element_of(place[0])
            out[part] = max(out.get(part, -np.inf), float(gain[i]))
    return dict(sorted(out.items(), key=lambda item: -item[1]))


def remainder_of_residuals(fit: Estimate, recording: Recording, structure: result.Alarm) -> result.Remainder:
    """Driver and form of the strongest dependence found by the structure tests."""
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    driver, told = structure.about, Driver.of(structure.about)
    values = recording.columns().get(driver)
    place = (driver,) if driver in recording.joints else ()
    if told.thermal or told.kind == APPROACH:
        place = (told.place,)
    kind, cycles = ("order", 0) if values is None else best_shape(fit.residual[fit.used], values[fit.used])
    return result.Remainder(place, driver, result.Form(kind, structure.share, cycles), size)


def remainder_of_form(cat: Catalogue, index: int, fit: Estimate) -> result.Remainder:
    """A form without a name: where, and what it is a function of."""
    placed = cat.candidates[index]
    assert isinstance(placed.effect, Empirical)
    driver, kind = placed.effect.describe(placed.settings_map)
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    return result.Remainder(placed.place, driver, result.Form(kind), size)


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
