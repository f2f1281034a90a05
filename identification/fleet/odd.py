"""Which machines are unlike their fleet, and why: each is judged by the others.

Three things are looked at: effects that are there where others have none, or missing where others have them; sizes of effects;
deviations of constants. Each has a tail probability in another machine of the fleet (a prediction, so that few machines make
nothing odd); a machine is odd when the smallest is so small that no more than one machine in twenty has such a one anywhere.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from truepose.identification.fleet.summary import Summary
from truepose.identification.prior import URN

Array = NDArray[np.float64]
ODD = 0.05
"""Probability that nothing odd is called odd, and below which something is a reason at all. Chosen."""
SURE = 0.9
"""Probability from which on an effect is there, and below one less of which it is not."""
OTHERS = 4.0
"""Others that sizes and constants are compared with, at least."""


@dataclass(frozen=True)
class Reason:
    """Something odd. kind: ``present``, ``absent``, ``size`` or ``parameter``; name: ``effect@place`` or a constant's name;
    share: probability of anything as far out in another machine of the fleet; text: in words."""

    kind: str
    name: str
    share: float
    text: str


@dataclass(frozen=True)
class Oddness:
    """score: minus log10 of the smallest share, counted for all that was looked at (above 1.3, 5 %, a machine is ``odd``);
    reasons: rarest first."""

    score: float
    odd: bool
    reasons: tuple[Reason, ...]


def oddness(kept: Mapping[str, Any], summary: Summary) -> Oddness:
    """Of a machine that is part of the summary, from what is kept of it."""
    own = Summary.of(kept)
    others, kind = _without(summary, own), str(kept["mechanism"])
    looked = [*_effects(kept, others, kind), *_sizes(own, others), *_constants(kept, others, kind)]
    found = sorted((one for one in looked if one.share < ODD), key=lambda one: (one.share, one.name))
    least = min([1.0, *(len(looked) * one.share for one in found)])
    return Oddness(float(-np.log10(max(least, 1e-300))) + 0.0, least < ODD, tuple(found))


def _without(summary: Summary, own: Summary) -> Mapping[str, Array]:
    """Sums of the others, where this machine has something to compare: exact, for sums are whole numbers."""
    among = Summary(0, {key: summary.sums[key] for key in own.sums if key in summary.sums})
    return {
        "|".join((kind, *rest)): sums for kind in _KINDS for rest, sums in (among - own).among(kind).items()
    }


_KINDS = ("place", "size", "constant")


def _effects(kept: Mapping[str, Any], others: Mapping[str, Array], kind: str) -> Iterator[Reason]:
    """What is surely there, or surely not although it would have been seen; the frequency of others beside today's prior."""
    for effect, places in kept["places"].items():
        for place, one in places.items():
            sums = others.get(f"place|{kind}|{effect}|{place}")
            if sums is None:
                continue
            n, found = round(sums[0]), float(sums[2])
            usual = 1.0 / (1.0 + np.exp(-sums[1] / n))
            share = (found + URN * usual) / (n + URN)
            said, unseen = float(one[0]), float(one[3])
            if said >= SURE:
                text = f"{effect} at {place}, which {_count(found, n)} others have"
                yield Reason("present", f"{effect}@{place}", share, text)
            elif said <= 1.0 - SURE and unseen < 1.0 - SURE:
                text = f"no {effect} at {place}, which {_count(found, n)} others have"
                yield Reason("absent", f"{effect}@{place}", 1.0 - share, text)


def _count(found: float, n: int) -> str:
    return f"{found:.0f} of {n}"


def _sizes(own: Summary, others: Mapping[str, Array]) -> Iterator[Reason]:
    """Sizes of effects that are surely there, by those of others that have them."""
    for (kind, effect, place, unit), mine in own.among("size").items():
        sums = others.get(f"size|{kind}|{effect}|{place}|{unit}")
        if sums is None or mine[0] < SURE or sums[0] < OTHERS:
            continue
        mean = float(sums[1] / sums[0])
        log, spread = float(mine[1] / mine[0]), float(sums[2] / sums[0]) - mean**2
        share, _ = _tail(log - mean, spread, float(sums[0]))
        times = float(np.exp(log - mean))
        text = f"{effect} at {place} is {times:.2g} times the median of {sums[0]:.0f} others"
        yield Reason("size", f"{effect}@{place}", share, text)


def _constants(kept: Mapping[str, Any], others: Mapping[str, Array], kind: str) -> Iterator[Reason]:
    """Deviations from the drawing, by those of others."""
    for name, (x, _, _) in kept["parameters"].items():
        sums = others.get(f"constant|{kind}|{name}")
        if sums is None or sums[0] < OTHERS:
            continue
        n, mean = float(sums[0]), float(sums[1] / sums[0])
        share, far = _tail(x - mean, float(sums[2] / n) - mean**2, n)
        text = f"{name} is {x:+.1f} tolerances off its drawing, {far:.1f} times the spread of {n:.0f} others from their mean"
        yield Reason("parameter", name, share, text)


def _tail(away: float, variance: float, n: float) -> tuple[float, float]:
    """Two-sided probability of a next value as far from the mean of n as this (normal, both moments estimated), and how many
    1-sigmas of theirs it is away. variance: of theirs about their mean, over n."""
    sigma = np.sqrt(max(variance, 1e-12) * n / (n - 1.0))
    far = abs(away) / sigma
    return float(2.0 * student.sf(far / np.sqrt(1.0 + 1.0 / n), n - 1.0)), float(far)


__all__ = ["Oddness", "Reason", "oddness"]
