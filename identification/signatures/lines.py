"""Lines: orders of joints that stand out of what a fit leaves, by a periodogram, and series above those of the catalogue.

A joint that errs by a sin(k q) + b cos(k q) moves the readings by its own derivative times that. The periodogram is half of
what chi2 falls by where one order is fitted by itself (Lomb 1976, Astrophys. Space Sci. 39:447; weights: Zechmeister and
Kurster 2009, Astron. Astrophys. 496:577), for all whole orders at once, as sums over bins of a turn. It proposes what could
pay its price, the prior; evidence judges.

Finer values of continuous settings around those of the likeliest set.

Some settings are points of a continuum (the lag of a warm part), of which the catalogue holds a few values. Where one of them
is part of the likeliest set, values on both sides of it become candidates too, and the posterior is drawn among all of them;
the next time half as far from the best one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.estimated import Estimate
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.signatures import Signatures
from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.transmission_error import HIGHEST_ORDER, SERIES, TransmissionError
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import HARMONIC

PARTS, CLOSE = 4, 0.02
"""Into how many parts the way to a neighbour is divided by new values, and the share of a value within which a neighbour is as
good."""


def refined(machine: Machine, cat: Catalogue, accepted: Iterable[int]) -> Catalogue:
    """The catalogue with values around those of accepted candidates; the very same one where nothing is to be added."""
    for index in [i for i in accepted if i not in cat.stated]:
        for name in cat.candidates[index].effect.continuous:
            added = _between(machine, cat, index, name)
            if added:
                cat = cat.with_more(added, [index])
    return cat


def _between(machine: Machine, cat: Catalogue, index: int, name: str) -> list[PlacedEffect]:
    """Candidates with values of a setting between a candidate's own and its neighbours on both sides."""
    here = cat.candidates[index]
    if name not in here.settings_map:
        return []
    own, rest = float(here.settings_map[name]), dict(here.settings_map) | {name: 0.0}
    values = [
        float(c.settings_map[name])
        for c in cat.candidates
        if c.at_place == here.at_place and name in c.settings_map
        if dict(c.settings_map) | {name: 0.0} == rest
    ]
    lower, higher = [v for v in values if v < own], [v for v in values if v > own]
    near = [max(lower, default=own), min(higher, default=own)]
    new = [
        float(f"{own + share * (other - own):.3g}")
        for other in near
        if abs(other - own) > CLOSE * max(abs(own), abs(other))
        for share in np.arange(1, PARTS) / PARTS
    ]
    labels = {c.label for c in cat.candidates}
    settings = [dict(here.settings_map) | {name: value} for value in dict.fromkeys(new)]
    made = [PlacedEffect.at(here.effect, machine, here.place, one) for one in settings]
    return [placed for placed in made if placed.label not in labels]


FINEST = 4096
"""Highest order that is looked for: 2^12, twenty cycles of a motor behind a gear of 200."""
BINS = 16
"""Of the shortest wave: rounding an angle to its bin takes less than 1 % of it."""
ALIAS = 0.8
"""Length of the mean of exp(i k q) over the rows, beside 1 at k = 0, from which on k is another order in disguise."""
PEAKS = 4
"""Lines of a joint that are proposed at one fit: what stands out beside them is seen when these are fitted."""
SURE = 3.0
"""Standard deviations by which all orders of a series must explain more than chance does, to be proposed."""
ROWS = 5
"""Rows for each order of a series: with fewer its orders are no more than a description of the rows."""


@dataclass(frozen=True)
class Spectrum:
    """gain (k + 1,) of each whole order of one joint in nats; 0 where it is none that these rows can tell."""

    gain: Array

    @property
    def finest(self) -> int:
        """Highest order that the spacing of the readings allows."""
        return len(self.gain) - 1

    def peaks(self, apart: float, least: float, known: set[int]) -> list[int]:
        """Orders above ``least``, the highest first, none within ``apart`` of a higher one or ``known``."""
        out: list[int] = []
        for k in np.argsort(-self.gain).tolist():
            if self.gain[k] < least or len(out) == PEAKS:
                break
            if k not in known and all(abs(k - other) > apart for other in out):
                out.append(k)
        return out


def spectrum(angle: Array, score: Array, weight: Array) -> Spectrum:
    """Of a joint's angles (n,) rad, its scores J'r (n,) and weights J'J (n,), with noise 1."""
    bins = BINS * FINEST
    place = np.floor(angle / (2.0 * np.pi) * bins).astype(np.intp) % bins
    by_score, by_weight = (np.fft.rfft(np.bincount(place, v, minlength=bins)) for v in (score, weight))
    finest = _finest(np.abs(np.fft.rfft(np.bincount(place, minlength=bins)))[: 2 * FINEST + 1] / len(angle))
    k = np.arange(finest + 1)
    whole, double = by_weight[0].real, by_weight[2 * k]
    cc, ss, cs = 0.5 * (whole + double.real), 0.5 * (whole - double.real), -0.5 * double.imag
    c, s = by_score[k].real, -by_score[k].imag
    det = np.maximum(cc * ss - cs**2, 1e-12 * whole**2)
    gain = 0.5 * (ss * c**2 - 2.0 * cs * c * s + cc * s**2) / det
    gain[0] = 0.0
    return Spectrum(np.asarray(gain))


def _finest(window: Array) -> int:
    """Half of the order at which the rows look like order 0 again: readings a step apart repeat after a turn over the step."""
    again = np.flatnonzero(window[1:] > ALIAS) + 1
    near = np.flatnonzero(window[1:] < 0.5)  # low orders hardly turn over a short arc: they are no alias
    beyond = again[again > near[0] + 1] if len(near) else again[:0]
    return min(FINEST, int(beyond[0]) // 2 if len(beyond) else FINEST)


def proposed(signatures: Signatures, fit: Estimate, cat: Catalogue) -> Catalogue:
    """The catalogue with the orders and series that a fit leaves; the very same one where there are none."""
    known = {c.label for c in cat.candidates}
    for joint, found, span in _spectra(signatures, fit):
        apart = 2.0 * np.pi / span
        held = _orders_at(fit, joint)
        price = -_log_one(cat, joint) - np.log(_share(found.finest, {"order": float(HIGHEST_ORDER)}))
        lines = [{"order": float(k)} for k in found.peaks(apart, price, set(range(HIGHEST_ORDER + 1)) | held)]
        series = list(_series(found, held, int(np.sum(fit.used))))
        whole = signatures.recording.whole  # settings are the same for all that have some of its rows
        arc = whole.moved[~whole.validation, signatures.machine.mechanism.readings.index(joint)]
        seen = {joint: (float(arc.min()), float(arc.max()))}
        effect = TransmissionError()
        settings = [(s, TransmissionError().within((joint,), s, seen)) for s in (*lines, *series)]
        made = [PlacedEffect.at(effect, signatures.machine, (joint,), own) for _, own in settings]
        share = [_share(found.finest, s) for s, _ in settings]
        new = [(m, w) for m, w in zip(made, share, strict=True) if m.label not in known]
        if new:  # at the end, with priors in terms of that of the joint's orders
            one = _log_one(cat, joint)
            log_prior = (*cat.log_prior, *(one + float(np.log(w)) for _, w in new))
            cat = replace(cat, candidates=(*cat.candidates, *(m for m, _ in new)), log_prior=log_prior)
    return cat


def _spectra(signatures: Signatures, fit: Estimate) -> Iterator[tuple[str, Spectrum, float]]:
    """Each turning joint with what the fit leaves of it, and the arc (rad) that it was seen over."""
    machine, q = signatures.machine, signatures.recording.moved
    actuators = [a for a in machine.mechanism.actuators if a.unit == "rad"]
    score, weight, rows = signatures.scores(fit, [a.displacement for a in actuators])
    for k, actuator in enumerate(actuators):
        angle = q[rows, machine.mechanism.readings.index(actuator.reading)]
        if len(rows) >= 2 * ROWS and np.ptp(angle) > 0.0 and np.any(weight[:, k] > 0.0):
            yield actuator.reading, spectrum(angle, score[:, k], weight[:, k]), float(np.ptp(angle))


def _orders_at(fit: Estimate, joint: str) -> set[int]:
    """Orders of a joint that the fit has."""
    out: set[int] = set()
    own = (e.settings_map for e in fit.effects if e.place == (joint,) and e.kind == "position-periodic")
    for s in own:
        if "orders" in s:
            out |= set(range(round(s.get("first", 1.0)), round(s["orders"]) + 1))
        out |= {round(s["order"])} if "order" in s else set()
    return out


def _series(found: Spectrum, held: set[int], rows: int) -> Iterator[Mapping[str, float]]:
    """Series of as many orders as the catalogue's, above it, that hold more than chance together."""
    step = round(SERIES)
    first, last = step + 1, 2 * step
    while last <= min(found.finest, rows // ROWS, HARMONIC.high):
        own = found.gain[first : last + 1] - 1.0
        if first not in held and float(np.sum(own)) > SURE * np.sqrt(len(own)):
            yield {"first": float(first), "orders": float(last)}
        first, last = first + step, last + step


def _share(finest: int, settings: Mapping[str, float]) -> float:
    """Weight beside an order of the catalogue (1): all finer ones together weigh as much as a series does, finer ones less."""
    effect = TransmissionError()
    if "orders" in settings:
        return effect.weight(settings)
    whole = effect.weight({"orders": SERIES}) / np.log(max(finest / HIGHEST_ORDER, math.e))
    return float(whole / settings["order"])


def _log_one(cat: Catalogue, joint: str) -> float:
    """Log prior of an order of weight 1 at a joint."""
    own = next(i for i, c in enumerate(cat.candidates) if c.at_place == (TransmissionError.slug, (joint,)))
    placed = cat.candidates[own]
    return cat.log_prior[own] - float(np.log(placed.effect.weight(placed.settings_map)))
