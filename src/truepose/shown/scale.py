"""Axes: where their ticks stand and how numbers are written on them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array

ROOM = 0.04
"""What is left free beyond the data, as a share of the range."""
LARGEST, SMALLEST = 1e300, 1e-290
"""Sizes within which an axis is drawn: beyond them a range or a step is no number any more."""
NARROWEST = 1e-11
"""A range that is a smaller share of its values is rounding: it is drawn as one value."""


@dataclass(frozen=True)
class Scale:
    """From values between ``low`` and ``high`` to pixels between ``start`` and ``end``."""

    low: float
    high: float
    start: float
    end: float

    def at(self, value: float) -> float:
        """Pixels of a value."""
        return self.start + (self.end - self.start) * (value - self.low) / (self.high - self.low)

    def all(self, values: Array) -> Array:
        """(n,) pixels of values."""
        return np.asarray(self.start + (self.end - self.start) * (values - self.low) / (self.high - self.low))


def ends(values: Iterable[Array], low: float | None, high: float | None) -> tuple[float, float]:
    """Ends of an axis that shows all finite values, unless they are given; never the same twice."""
    known = [v[np.abs(v) <= LARGEST] for v in values]
    joined = np.concatenate(known) if known else np.zeros(0)
    first, last = (float(joined.min()), float(joined.max())) if joined.size else (0.0, 1.0)
    low, high = (end if end is not None and abs(end) <= LARGEST else None for end in (low, high))
    room = ROOM * (last - first)
    first, last = first - room if low is None else low, last + room if high is None else high
    if not last - first > max(NARROWEST * max(abs(first), abs(last)), SMALLEST):
        middle = first if high is None or low is not None else high
        half = 0.5 * abs(middle) if abs(middle) > SMALLEST else 0.5
        first, last = middle - half, middle + half
    return first, last


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round numbers within the ends, one more than ``most`` at most, as they are written."""
    raw = (high - low) / max(most, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1.0, 2.0, 2.5, 5.0, 10.0) if s * power >= raw * (1 - 1e-9))
    first = math.ceil(low / step - 1e-9)
    values = [k * step for k in range(first, math.floor(high / step + 1e-9) + 1)]
    return [(value, written(value, step)) for value in values]


def written(value: float, step: float) -> str:
    """A tick's number with as many decimals as its step needs: no two neighbours look alike."""
    if value == 0.0:
        return "0"
    size, place = max(abs(value), step), math.floor(math.log10(step) + 1e-9)
    if (size >= 1e5 and step >= 1e3) or (size < 1e-2 and step < 1e-4):
        digits = max(math.floor(math.log10(size)) - place + 1, 2)
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}".replace("-", "\u2212")
    places = max(0, -place)
    text = f"{value:.{places + 1}f}"
    text = text[:-1] if text.endswith("0") else text
    return text.rstrip(".").replace("-", "\u2212")
