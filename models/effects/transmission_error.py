"""Gears that do not turn evenly: a joint error that repeats a whole number of times per turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, pi, sqrt
from typing import ClassVar

import casadi as ca
import numpy as np

from truepose.models.effects.base import Coefficient, Effect, Observed, Place, Settings, Shifts, Site, effects
from truepose.models.effects.common import ARCSEC, actuator_at, sine_coefficients, sine_pair, singly
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import ANY, HARMONIC, ORDER, ranges

FADE = 0.035
"""Angle in which a series of many orders fades beyond what was seen, rad: it knows nothing of the next few degrees."""
SEEN = ("from", "to")
"""Settings of a series: the ends of the arc over which it was fitted, rad."""


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


HIGHEST_ORDER = 30
SERIES = 60.0
LARGEST = 6e-4
"""2 arcmin, what the catalogue states for strain wave gears: where a joint was not moved, no more is made up."""
DECAY = 1.5
"""Amplitudes of a smooth gear error fall about as order^-1.5; the size is weighed against the data."""


@effects.add("transmission-error")
class TransmissionError(Effect):
    """Gears that do not turn evenly: a joint error that repeats a whole number of times per turn.

    a sin(k q) + b cos(k q), k the order: cycles per turn of the joint.

    Setting ``orders`` N: a series of all orders up to N, from ``first`` on (1 unless told): what stands above the usual
    series is a series of its own, with a size of its own.
    """

    slug = "transmission-error"
    setting_ranges = ranges({"order": ORDER, "first": HARMONIC, "orders": HARMONIC, "from": ANY, "to": ANY})
    driven_by = "position-periodic"
    title = "Transmission error of a geared joint"
    counted = True
    sentence = "The gear of joint {0} turns unevenly: its error repeats several times per turn."
    formula = (
        "dq = a sin(k q) + b cos(k q), k cycles per turn of the joint; or the sum over k = 1 ... 60, "
        "less its mean over the arc from ... to that was seen, beyond which it fades"
    )
    size = "strain wave gears 0.5 to 2 arcmin (1.5e-4 to 6e-4 rad)"
    look_alikes = ("encoder-eccentricity", "axis-wobble", "actuator-scale")
    experiment = (
        "sweep this joint alone in fine, unevenly spaced steps over a few periods; repeat with the gear "
        "coupled at another tooth: gear errors stay with the gear, encoder errors with the encoder"
    )
    source = (
        "Judd and Knasinski 1990, A technique to calibrate industrial robots with experimental verification"
    )
    settings_add = True
    # any function of the joint's angle may come from the gear or from the encoder that reads the angle
    twins: ClassVar = {"orders": {"encoder-eccentricity": 0.2}}

    def places(self, machine: Machine) -> Sequence[Place]:
        return singly(a.reading for a in machine.mechanism.actuators if a.unit == "rad")

    def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
        if "orders" in settings:
            first, last = (round(settings.get(end, 1.0)) for end in ("first", "orders"))
            return tuple(
                Coefficient(f"{letter}{k}", "rad", min(LARGEST, 5e-3 / k**DECAY))
                for k in range(first, last + 1)
                for letter in "ab"
            )
        return sine_coefficients("rad", 3e-3)

    def shifts(self, site: Site) -> Shifts:
        actuator = actuator_at(site.machine, site.place[0])
        angle = site.moved(actuator.reading)
        if "orders" in site.settings:
            return {actuator.displacement: series(site, angle)}
        return {actuator.displacement: sine_pair(site, site.settings.get("order", 1.0) * angle)}

    def settings(self, machine: Machine, place: Place, recording: Observed) -> Sequence[Settings]:
        """Orders that make a quarter of a period or more within the joint's range, singly, or as a series."""
        actuator = actuator_at(machine, place[0])
        orders = [float(k) for k in range(1, HIGHEST_ORDER + 1)]
        if actuator.gear_ratio:
            orders += [k for k in (abs(actuator.gear_ratio), 2 * abs(actuator.gear_ratio)) if k not in orders]
        span = actuator.range[1] - actuator.range[0] if actuator.range else 2 * pi
        return [*({"order": k} for k in orders if k * span >= pi / 2), {"orders": SERIES}]

    def weight(self, settings: Settings) -> float:
        return 10.0 if "orders" in settings else 1.0

    def within(self, place: Place, settings: Settings, seen: Mapping[str, tuple[float, float]]) -> Settings:
        """Add to a series the arc over which its joint was seen, where that is less than a turn."""
        low, high = seen.get(place[0], (0.0, 2 * np.pi))
        if "orders" not in settings or high - low >= 2 * np.pi:
            return settings
        arc = zip(SEEN, (low, high), strict=True)
        return {**settings, **{end: float(f"{value:.6g}") for end, value in arc}}

    def told(self, settings: Settings) -> str:
        """Without the arc: terms of one place and as many orders are one term."""
        return super().told({name: value for name, value in settings.items() if name not in SEEN})

    def found(self, values: Mapping[str, float], std: Mapping[str, float]) -> str:
        """The strongest orders with their amplitudes; low ones trade with geometry: their std judges them."""
        orders = sorted({int(name[1:]) for name in values if name[1:].isdigit()})
        size = {k: hypot(values[f"a{k}"], values[f"b{k}"]) for k in orders}
        sure = [k for k in orders if size[k] > 2.0 * hypot(std[f"a{k}"], std[f"b{k}"]) / sqrt(2)]
        strongest = sorted(sure, key=lambda k: -size[k])[:6]
        if not strongest:
            return ""
        told = ", ".join(f"{k} ({size[k] * ARCSEC:.0f} arcsec)" for k in strongest)
        return f"Orders that stand out of their uncertainty, cycles per turn: {told}."
