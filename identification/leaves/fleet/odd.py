"""Which machines are unlike their fleet, and why: each is judged by the others.

Three things are looked at: effects that are there where others have none, or missing where others have them; sizes of effects;
deviations of constants. Each has a tail probability in another machine of the fleet (a prediction, so that few machines make
nothing odd); a machine is odd when the smallest is so small that no more than one machine in twenty has such a one anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from scipy.special import expit, stdtr

from truepose.arrays import Array
from truepose.identification.leaves.fleet.pooled import (
    Pooled,
    constant_moments,
    effect_moments,
    others,
    rows_of,
    size_moments,
)
from truepose.identification.prior import URN

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


def oddness(pooled: Pooled) -> list[Oddness]:
    """Judge each machine by all others, in their order."""
    looked = pd.concat([_effects(pooled), _sizes(pooled), _constants(pooled)])
    number = np.bincount(looked["machine"].to_numpy(dtype=int), minlength=pooled.machines)
    reasons: list[list[Reason]] = [[] for _ in range(pooled.machines)]
    rare = looked[looked["share"] < ODD].sort_values(["share", "name"], kind="stable")
    for one in rows_of(rare):
        reasons[one.machine].append(Reason(one.kind, one.name, float(one.share), one.text))
    return [_oddness(*one) for one in zip(number.tolist(), reasons, strict=True)]


def _oddness(looked: int, reasons: list[Reason]) -> Oddness:
    least = min(1.0, looked * reasons[0].share) if reasons else 1.0
    return Oddness(float(-np.log10(max(least, 1e-300))) + 0.0, least < ODD, tuple(reasons))


def _effects(pooled: Pooled) -> pd.DataFrame:
    """Judge what is surely there, or surely not although it would have been seen, by how many others have it."""
    rows = pooled.places
    theirs = others(rows, ["mechanism", "effect", "place"], effect_moments(rows))
    is_present = rows["probability"] >= SURE
    is_absent = (rows["probability"] <= 1.0 - SURE) & (rows["unseen"] < 1.0 - SURE)
    judged = (theirs[:, 0] > 0.5) & (is_present | is_absent)
    rows, is_present, (n, odds, found) = rows[judged], is_present[judged], theirs[judged].T
    share = (found + URN * expit(odds / n)) / (n + URN)
    what = np.where(is_present, "", "no ")
    texts = [
        f"{no}{effect} at {place}, which {some:.0f} of {of:.0f} others have"
        for no, effect, place, some, of in zip(what, rows["effect"], rows["place"], found, n, strict=True)
    ]
    kind = np.where(is_present, "present", "absent")
    return _looked(rows, kind, _names(rows), np.where(is_present, share, 1.0 - share), texts)


def _sizes(pooled: Pooled) -> pd.DataFrame:
    """Judge sizes of effects that are surely there by those of others that have them."""
    rows = pooled.sizes
    own = size_moments(rows)
    theirs = others(rows, ["mechanism", "effect", "place", "unit"], own)
    judged = (rows["probability"] >= SURE) & (theirs[:, 0] >= OTHERS)
    rows = rows[judged]
    share, away, _ = _tail(rows["log_size"].to_numpy(), *theirs[judged, :3].T)
    texts = [
        f"{effect} at {place} is {np.exp(log):.2g} times the median of {n:.0f} others"
        for effect, place, log, n in zip(rows["effect"], rows["place"], away, theirs[judged, 0], strict=True)
    ]
    return _looked(rows, "size", _names(rows), share, texts)


def _constants(pooled: Pooled) -> pd.DataFrame:
    """Judge deviations from the drawing by those of others."""
    rows = pooled.constants
    theirs = others(rows, ["mechanism", "name"], constant_moments(rows))
    judged = theirs[:, 0] >= OTHERS
    rows, n = rows[judged], theirs[judged, 0]
    share, _, far = _tail(rows["deviation"].to_numpy(), *theirs[judged, :3].T)
    texts = [
        f"{name} is {x:+.1f} tolerances off its drawing, {spreads:.1f} times the spread of {count:.0f} others"
        " from their mean"
        for name, x, spreads, count in zip(rows["name"], rows["deviation"], far, n, strict=True)
    ]
    return _looked(rows, "parameter", rows["name"], share, texts)


def _names(rows: pd.DataFrame) -> pd.Series[str]:
    return rows["effect"] + "@" + rows["place"]


def _looked(rows: pd.DataFrame, kind: object, name: object, share: Array, text: list[str]) -> pd.DataFrame:
    """Return what was looked at, a row each."""
    return pd.DataFrame(
        {"machine": rows["machine"], "kind": kind, "name": name, "share": share, "text": text}
    )


def _tail(value: Array, n: Array, total: Array, squares: Array) -> tuple[Array, Array, Array]:
    """Return how a next value stands to n others, of which the sums of values and of squares are known.

    Its two-sided probability (normal, both moments estimated), how far it is from their mean, and in 1-sigmas of theirs.
    """
    mean = total / n
    variance = np.maximum(squares / n - mean**2, 1e-12) * n / (n - 1.0)
    far = np.abs(value - mean) / np.sqrt(variance)
    return np.asarray(2.0 * stdtr(n - 1.0, -far / np.sqrt(1.0 + 1.0 / n))), value - mean, far
