"""A periodic function of a joint as a Fourier series, over the arc that was seen."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from truepose.models.effects.base import Coefficient, Place, Settings, Site

FADE = 0.035
"""Angle in which a series of many orders fades beyond what was seen, rad: it knows nothing of the next few degrees."""
SEEN = ("from", "to")
"""Settings of a series: the ends of the arc over which it was fitted, rad."""


def series_coefficients(
    unit: str, scale: float, orders: int, decay: float, largest: float, first: int = 1
) -> tuple[Coefficient, ...]:
    """A periodic function as a Fourier series whose amplitudes are expected to fall as order^-decay from ``largest``."""
    names = [
        (f"{letter}{k}", min(largest, scale / k**decay)) for k in range(first, orders + 1) for letter in "ab"
    ]
    return tuple(Coefficient(name, unit, size) for name, size in names)


def series(site: Site, angle: ca.SX) -> ca.SX:
    """sum a_k sin(k angle) + b_k cos(k angle) over the coefficients of a site, less its mean over the arc that was seen.

    Beyond that arc it fades. Without its mean it takes nothing from the joint's zero, which holds there, too.
    """
    arc, c = _arc(site), ca.vertcat(*site.c.values())
    orders = {name: int(name[1:]) for name in site.c}
    waves = dict(zip("ab", _waves(angle, max(orders.values(), default=0)), strict=True))
    own = ca.vertcat(*(waves[name[0]][k - 1] for name, k in orders.items()))
    total = ca.dot(c, own - ca.DM([_mean(name[0], k, arc) for name, k in orders.items()]))
    return total if arc is None else total * _seen_share(angle, *arc)


def _waves(angle: ca.SX, orders: int) -> tuple[ca.SX, ca.SX]:
    """sin(k angle) and cos(k angle) for k = 1 ... orders: those of 1 ... m turned on by m give the next m.

    Four products cost far less than a sine and a cosine; rounding grows as the logarithm of k.
    """
    sines, cosines = ca.sin(angle), ca.cos(angle)
    while sines.numel() < orders:
        s, c, more = sines[-1], cosines[-1], min(sines.numel(), orders - sines.numel())
        first, second = sines[:more], cosines[:more]
        sines = ca.vertcat(sines, first * c + second * s)
        cosines = ca.vertcat(cosines, second * c - first * s)
    return sines, cosines


def _arc(site: Site) -> tuple[float, float] | None:
    """Ends of the arc that was seen, rad; None where none is stated."""
    if not all(end in site.settings for end in SEEN):
        return None
    low, high = (site.settings[end] for end in SEEN)
    return low, high


def _mean(wave: str, k: int, arc: tuple[float, float] | None) -> float:
    """Of sin(k q) (``a``) or cos(k q) (``b``) over an arc; zero over whole turns."""
    if arc is None or arc[0] == arc[1]:
        return 0.0
    low, high = (k * end for end in arc)
    area = np.cos(low) - np.cos(high) if wave == "a" else np.sin(high) - np.sin(low)
    return float(area / (high - low))


def _seen_share(angle: ca.SX, low: float, high: float) -> ca.SX:
    """1 on the arc that was seen and whole turns from it, falling off beyond its ends."""
    middle, half = (low + high) / 2, (high - low) / 2
    turned = angle - middle
    away = ca.fabs(ca.atan2(ca.sin(turned), ca.cos(turned)))  # whole turns do not count
    return 1.0 / (1.0 + (ca.fmax(0.0, away - half) / FADE) ** 2)


def over_arc(place: Place, settings: Settings, seen: Mapping[str, tuple[float, float]]) -> Settings:
    """Settings of a series with the arc over which its joint was seen, where that is less than a turn."""
    low, high = seen.get(place[0], (0.0, 2 * np.pi))
    if "orders" not in settings or high - low >= 2 * np.pi:
        return settings
    return {**settings, **{end: float(f"{value:.6g}") for end, value in zip(SEEN, (low, high), strict=True)}}
