"""Photocurrent of a Fabry-Perot cavity whose mirror moves, computed beam by beam.

The reflected amplitude is the sum of the beams that went round the cavity 0, 1, 2 ... times; nothing of
truepose is used. Lengths mm, times s. Noise is a share of the fringe's peak-to-peak value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array

WAVELENGTH = 1.56e-3
FIBRE = (0.04, 0.9)


@dataclass(frozen=True)
class Detector:
    """What turns light into numbers; the defaults are a quiet one.

    ``noise``: 1-sigma of a sample; ``drift``: change of the gain over the series, relative; ``wander``: the same
    for the offset, in fringes' peak-to-peak; ``steps``: how many steps of the converter one fringe spans, 0
    without a converter; ``background``: light that does not interfere, in units of the reflected light.
    """

    reflectivities: tuple[float, float] = FIBRE
    gain: float = 1.0
    background: float = 0.0
    noise: float = 0.005
    drift: float = 0.0
    wander: float = 0.0
    steps: int = 0

    @property
    def peak_to_peak(self) -> float:
        """Largest less smallest signal without drift."""
        low, high = reflected(np.array([0.0, np.pi]), self.reflectivities)
        return self.gain * float(high - low)

    def read(self, phase: Array, rng: np.random.Generator) -> Array:
        """(n,) samples at round-trip phases (n,), rad."""
        share = np.linspace(0.0, 1.0, len(phase))
        light = self.gain * (reflected(phase, self.reflectivities) + self.background)
        signal = light * (1.0 + self.drift * share) + self.wander * self.peak_to_peak * share
        signal += self.noise * self.peak_to_peak * rng.standard_normal(len(phase))
        if self.steps:
            step = self.peak_to_peak / self.steps
            signal = np.round(signal / step) * step
        return np.asarray(signal)


@dataclass(frozen=True)
class Run:
    """One series: times (n,), signal (n,), wavelengths (n,), and the true change of length."""

    t: Array
    signal: Array
    wavelength: Array
    change: float


def reflected(phase: Array, reflectivities: tuple[float, float]) -> Array:
    """Reflected share of the light, beam after beam until they are weaker than 1e-15.

    Outside the first mirror reflects with -sqrt(R1), inside with +sqrt(R1); it transmits 1 - R1 in two passes.
    """
    first, second = np.sqrt(reflectivities[0]), np.sqrt(reflectivities[1])
    turn = np.exp(1j * np.asarray(phase))
    beam = (1.0 - first**2) * second * turn
    total = beam - first
    strength = first * second
    while strength > 1e-15:
        beam = beam * (first * second * turn)
        total += beam
        strength *= first * second
    return np.asarray(total.real**2 + total.imag**2)


def smooth_step(t: Array, start: float, duration: float) -> Array:
    """From 0 to 1 with the least jerk: speed and acceleration are 0 at both ends."""
    u = np.clip((t - start) / duration, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u * u))


def ramp(t: Array, start: float, duration: float, blend: float) -> Array:
    """From 0 to 1 at constant speed, with parabolic blends of ``blend`` s at both ends."""
    u = np.clip(t - start, 0.0, duration)
    speed = 1.0 / (duration - blend)
    rising = np.minimum(u, blend)
    falling = np.clip(u - (duration - blend), 0.0, blend)
    cruise = np.clip(u - blend, 0.0, duration - 2.0 * blend)
    return np.asarray(speed * (rising**2 / (2.0 * blend) + cruise + falling - falling**2 / (2.0 * blend)))


def displacement(t: Array, rest: float, moves: Sequence[tuple[float, float, float]]) -> Array:
    """Sum of smooth moves (distance, start after the rest, duration): overlapping ones make turning points."""
    total = np.zeros_like(t)
    for distance, start, duration in moves:
        total += distance * smooth_step(t, rest + start, duration)
    return total


def run(
    t: Array,
    path: Array,
    detector: Detector,
    rng: np.random.Generator,
    length: float = 0.9,
    scan: float = 0.0,
    scan_time: float = 0.5,
) -> Run:
    """A series along ``path`` (n,) of displacements from a cavity of ``length``.

    With ``scan`` (mm) the wavelength goes up by that and back while the mirror rests, before and after.
    """
    wavelength = np.full_like(t, WAVELENGTH)
    if scan:
        step = float(t[1] - t[0])
        n = round(scan_time / step)
        sweep = WAVELENGTH + scan * (1.0 - np.abs(np.linspace(-1.0, 1.0, n)))
        path = np.concatenate([np.full(n, path[0]), path, np.full(n, path[-1])])
        wavelength = np.concatenate([sweep, wavelength, sweep])
        t = t[0] + step * np.arange(len(path))
    phase = 4.0 * np.pi * (length + path) / wavelength
    return Run(t, detector.read(phase, rng), wavelength, float(path[-1] - path[0]))
