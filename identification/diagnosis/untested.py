"""What could not be tested keeps its share: a deflection where the machine file states no gravity.

Without ``gravity:`` no effect of weight is a candidate, and what it does to the readings leaves its evidence to whatever
resembles it most, often a wave of the same joint. So each name is compared with what a compliance of each joint would
make if gravity pulled along the base's -z: a share R^2 of the name's signal, all geometry free in its tolerances. Had it been
tested, it would have lost (1 - R^2) E / (2 (1 + f^2 E)) nats against the name: E is the sum of squares of that signal in the
noise, f the error of form (a tenth) that every formula has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.levels import Levels, parts_of
from truepose.identification.diagnosis.naming import SHOWN, Member, Named
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.weighed import Cause
from truepose.identification.signatures.forms import ERROR
from truepose.identification.signatures.linearisation import Linearisation, Signatures
from truepose.identification.signatures.untestable import GRAVITY
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.machine import Machine

Array = NDArray[np.float64]
COMPLIANCE = "joint-compliance"


def beside_untested(found: Found, names: Sequence[Named]) -> tuple[Named, ...]:
    """Names with the share that deflections have which nobody could test; as they are where gravity is stated."""
    machine = found.signatures.machine
    if machine.gravity is not None or not any(not n.nameless for n in names):
        return tuple(names)
    there = replace(machine, gravity=GRAVITY)
    unseen = _deflections(there, found)
    if not unseen:
        return tuple(names)
    signatures = Signatures(there, found.signatures.recording, (*found.fit.effects, *unseen))
    lin = signatures.linearise(found.fit)
    left = _left_by_geometry(lin, _noise(found))
    return tuple(n if n.nameless else _shared(found, n, lin, left, unseen) for n in names)


def _deflections(machine: Machine, found: Found) -> list[PlacedEffect]:
    """A compliance of every joint, at every load that may be meant."""
    effect, recording = effects.get(COMPLIANCE, "untested")(), found.signatures.recording
    places = [tuple(place) for place in effect.places(machine) if effect.screened(machine, tuple(place))]
    made = [
        PlacedEffect.at(effect, machine, place, settings)
        for place in places
        for settings in effect.settings(machine, place, recording)
    ]
    return [placed for placed in made if not placed.bent]


def _noise(found: Found) -> float:
    unknowns = found.weighed.weighing.unknowns
    return float(unknowns.noise[0].values[found.mode.point[0]])


def _left_by_geometry(lin: Linearisation, noise: float) -> Array:
    """(w, w) Gram matrix of the columns of G in units of the noise, geometry free in its tolerances."""
    n, width = lin.free, lin.columns[-1].stop
    gram = lin.gram / noise**2
    own, across = gram[:n, :n] + np.diag(lin.weight**2), gram[:n, n : n + width]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(own), 1e-300))
    half = np.linalg.lstsq(own * scale[:, None] * scale, across * scale[:, None], rcond=1e-12)[0]
    return np.asarray(gram[n : n + width, n : n + width] - (across * scale[:, None]).T @ half)


def _shared(
    found: Found, name: Named, lin: Linearisation, left: Array, unseen: Sequence[PlacedEffect]
) -> Named:
    """A name beside each joint's compliance: less probable by how well that would explain the same signal."""
    labels = {placed.label: k for k, placed in enumerate(lin.candidates)}
    own = [labels[found.catalogue.candidates[i].label] for i in name.candidates]
    at, signal = np.array(lin.indices(own), dtype=np.intp), np.zeros(len(left))
    signal[at] = lin.departure[lin.free + at]
    energy = float(signal @ left @ signal)
    odds: dict[tuple[str, ...], float] = {}
    for placed in unseen:
        (column,) = lin.indices([labels[placed.label]])
        length = float(left[column, column])
        alike = float(left[column] @ signal) ** 2 / max(energy * length, 1e-300) if length > 0.0 else 0.0
        worth = np.exp(-0.5 * (1.0 - min(alike, 1.0)) * energy / (1.0 + ERROR**2 * energy))
        odds[placed.place] = max(odds.get(placed.place, 0.0), float(worth))
    rarer = _prior_ratio(found, name, len(odds), unseen[0].effect.commonness)
    return _with_rivals(found, name, {place: rarer * worth for place, worth in odds.items()})


def _prior_ratio(found: Found, name: Named, joints: int, commonness: float) -> float:
    """Prior odds of a compliance of one of so many joints against the name at its place."""
    alike = {c.place for c in found.catalogue.candidates if c.effect.slug == name.cause.effect}
    own = found.catalogue.candidates[name.candidates[0]].effect.commonness
    return commonness / joints * max(len(alike), 1) / own


def _with_rivals(found: Found, name: Named, odds: dict[tuple[str, ...], float]) -> Named:
    machine, total = found.signatures.machine, sum(odds.values())
    kept, parts = 1.0 / (1.0 + total), set(parts_of(machine, name.cause.effect, name.cause.place))
    here = sum(worth for place, worth in odds.items() if parts & set(parts_of(machine, COMPLIANCE, place)))
    rivals = [
        Member(Cause(COMPLIANCE, place), name.probability * worth * kept, name.gain, tested=False)
        for place, worth in odds.items()
        if name.probability * worth * kept > SHOWN
    ]
    levels = Levels(name.levels.place * (1.0 + here) * kept, name.levels.kind, name.levels.driver * kept)
    alike = tuple(replace(m, probability=m.probability * kept) for m in name.equivalents)
    ranked = sorted((*alike, *rivals), key=lambda m: -m.probability)
    return replace(name, probability=name.probability * kept, equivalents=tuple(ranked), levels=levels)


__all__ = ["beside_untested"]
