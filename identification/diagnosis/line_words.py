"""What a line is: whole cycles of a motor behind a gear, the lines of an encoder, or cycles of the joint that have no name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.stats import binom

from truepose.models.effects.base import PlacedEffect
from truepose.models.effects.transmission_error import HIGHEST_ORDER
from truepose.models.machine.machine import Machine

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


__all__ = ["common_ratio", "line_words"]
