"""Light of whole moves from ``fringe_signal``, which adds the light beam by beam. Lengths mm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from support.fringe_signal import WAVELENGTH, Detector, Run, displacement, run

Maker = Callable[[np.random.Generator], Run]
RATE = 1e4
REST = 0.3
SCAN = 2e-5
PEAK = 1.875  # highest speed of the smooth step, in units of its mean


def journey(seed: int, samples: float = 30.0, turning: bool = False, scan: float = SCAN, **light: Any) -> Run:
    """A simulated journey over 19 to 38 fringes."""
    detector = Detector(**{"noise": 0.005, **light})
    return journeys(samples, detector, turning, scan)(np.random.default_rng(seed))


def journeys(samples: float, detector: Detector, turning: bool, scan: float = SCAN) -> Maker:
    """A smooth move over 19 to 38 fringes with so many samples in the fastest one; turning, partly back again."""

    def make(rng: np.random.Generator) -> Run:
        distance = 0.015 * (1.0 + rng.random())
        duration = PEAK * distance / (WAVELENGTH / 2.0) * samples / RATE
        moves = [(distance, 0.0, duration)]
        if turning:
            moves.append((-distance * rng.uniform(0.2, 0.9), duration * rng.uniform(0.4, 1.0), duration))
        sign = rng.choice([-1.0, 1.0])
        t = np.arange(0.0, max(start + lasting for _, start, lasting in moves) + 2.0 * REST, 1.0 / RATE)
        return run(t, sign * displacement(t, REST, moves), detector, rng, 0.9 + 1e-3 * rng.random(), scan)

    return make


def cut(make: Maker, shift: bool) -> Maker:
    """Without 10 to 40 samples in the middle; ``shift``: as if they had never been, a jump of the signal."""

    def broken(rng: np.random.Generator) -> Run:
        one, lost = make(rng), int(rng.integers(10, 40))
        half = len(one.t) // 2
        keep = np.r_[0:half, half + lost : len(one.t)]
        t = one.t[: len(keep)] if shift else one.t[keep]
        return replace(one, t=t, signal=one.signal[keep], wavelength=one.wavelength[keep])

    return broken
