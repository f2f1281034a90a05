"""What the posterior leaves open of a finding: the two likeliest explanations, in the words of ``plan --discriminate``.

A law is stated with its fitted size, an unnamed form with the sources, degree and ranges in which the posterior has it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.diagnosis.naming import CERTAIN
from truepose.identification.diagnosis.posterior_summary import Named, driver_of
from truepose.identification.diagnosis.result import Finding, OpenQuestion
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.tool_pose import tool_moves
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.effect_text import effect_text
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.empirical import Empirical
from truepose.models.file.driver import HELD, PAYLOAD, Driver
from truepose.models.machine.placed import EffectAtPlace


def question(
    cat: Catalogue, one: Named, law: PlacedEffect, drivers: Mapping[str, Array]
) -> OpenQuestion | None:
    """Return the two likeliest explanations of a name that rows may tell apart; None where it is certain, or there is one.

    ``law``: the first term of the name with its fitted size.
    """
    unnamed = EffectAtPlace(Empirical.slug, one.cause.place)
    first = {c.at_place: c for c in reversed(cat.candidates) if c.effect.slug != Empirical.slug}
    known: dict[EffectAtPlace, PlacedEffect | None] = {**first, law.at_place: law, unnamed: one.form}
    causes = [m.cause for m in one.equivalents if m.tested and m.cause.effect not in law.twins]
    parts = (part for cause in (one.cause, *causes) if (part := known.get(cause)) is not None)
    pair = [part for part in parts if _can_tell(part, one)][:2]
    if one.probability >= CERTAIN or len(pair) < 2 or pair[0] is not known[one.cause]:
        return None
    pair.sort(key=lambda part: part is one.form)
    texts = [effect_text(part) if part in (law, one.form) else str(part.at_place) for part in pair]
    return OpenQuestion((texts[0], texts[1]), pair[0].effect.experiment, _levels(pair, drivers))


def _can_tell(part: PlacedEffect, one: Named) -> bool:
    """Whether rows may tell an explanation: a form of the side of arrival is play by another name, and beside a form without a
    name counts what has its driver."""
    if part is one.form:
        return part.kind != "arrival"
    return not one.nameless or driver_of(part.kind) == driver_of(one.levels.kind)


def _levels(parts: Sequence[PlacedEffect], drivers: Mapping[str, Array]) -> dict[str, tuple[float, ...]]:
    """Return the lowest, a middle and the highest level of each column that effects read, that can be held and was varied."""
    read = [Driver.of(name).now.served_by(drivers) for part in parts for name in part.drivers]
    read += [PAYLOAD for part in parts if part.needs_load]
    out = dict[str, tuple[float, ...]]()
    for name in dict.fromkeys(read):
        seen = np.unique(drivers.get(name, np.zeros(0)))
        if Driver.of(name).kind in HELD and len(seen) > 1:
            out[name] = (float(seen[0]), *map(float, seen[len(seen) // 2 : -1][:1]), float(seen[-1]))
    return out


def with_tool(said: Sequence[Finding], labels: Sequence[Sequence[str]], fit: Estimate) -> tuple[Finding, ...]:
    """Return findings whose open questions say how far the tool is moved, where there are several to choose from."""
    if sum(one.question is not None for one in said) < 2:
        return tuple(said)
    pairs = zip(said, tool_moves(fit, np.flatnonzero(fit.used), labels), strict=True)
    return tuple(replace(one, question=one.question and replace(one.question, tool=mm)) for one, mm in pairs)
