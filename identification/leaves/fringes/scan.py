"""Read a scan of the wavelength while the mirror rests: the cavity's length, roughly, and the phase with its side.

The phase of the round trip is delta0 + L x with x = 4 pi (1/lambda - 1/lambda0). How fast fringes pass while x
is scanned gives L; and as delta0 is found from both sides of lambda0, it is known modulo 2 pi and not, as from
the level alone, up to its sign.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.leastsquares import minimise
from truepose.identification.leaves.fringes.levels import Levels, rough_levels
from truepose.models.sensors.irradiance import fringe, fringe_slope

_FEWEST = 16
_BINS = 600
_WHOLE = 1.5  # fringes from which on a scan shows its own levels
_LONGEST = 0.25  # fringes a bin
_FREE, _KNOWN = 0.1, 0.01  # of a fringe: 1-sigma of levels taken from the scan's range, and from the move
_MISFIT = 0.1  # of a fringe
_POOR = 0.3  # of the length
_PHASE = 0.005  # rad: no phase is better than the levels' shape
_STARTS = 4
_STEPS, _LEFT, _DAMPING = 30, 1e-6, 1e-3


@dataclass(frozen=True)
class Scan:
    """``phase`` (rad, modulo 2 pi, 0 at resonance) at the base wavelength, ``length`` in the wavelength's unit.

    With their 1-sigma; ``low`` and ``high``: the signal at the ends of a fringe, None when the scan was too
    short to show them.
    """

    phase: float
    phase_sigma: float
    length: float
    length_sigma: float
    low: float | None
    high: float | None


def read_scan(
    wavelength: Array, signal: Array, base: float, g: float, noise: float, levels: Levels | None = None
) -> Scan | None:
    """Samples (n,) at wavelengths (n,) with the mirror at rest; None when they do not give a length.

    ``noise`` is that of a sample; ``levels`` are those of the move beside the scan.
    """
    if len(wavelength) < _FEWEST:
        return None
    x = 4.0 * np.pi * (1.0 / wavelength - 1.0 / base)
    span = float(np.ptp(x))
    used = levels or rough_levels(signal)
    if span <= 0.0 or not used.size > 0.0:
        return None
    x, v, sigma = _binned(x / span, used.normalise(0.0, signal), noise / used.size)
    slack = _FREE if levels is None else _KNOWN
    tries = [_fit(x, v, sigma, start, g, slack) for start in first_guesses(x, v, g, levels is not None)]
    chi2, p, covariance = min(tries, key=lambda fit: fit[0])
    scale = max(1.0, chi2 / (len(x) - 4))
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0) * scale)
    fringes = abs(p[1]) / (2.0 * np.pi)
    if np.sqrt(scale) * float(np.median(sigma)) > _MISFIT or spread[1] > _POOR * p[1]:
        return None
    if levels is None and fringes < _WHOLE:
        return None
    low, high = used.low[0] + p[2] * used.size, used.low[0] + (p[2] + 1.0 + p[3]) * used.size
    own = fringes >= _WHOLE
    return Scan(
        float(np.angle(np.exp(1j * p[0]))),
        float(np.hypot(spread[0], _PHASE)),
        float(p[1] / span),
        float(spread[1] / span),
        float(low) if own else None,
        float(high) if own else None,
    )


def _binned(x: Array, v: Array, noise: float) -> tuple[Array, Array, Array]:
    """Means over equal shares of the scan, in order of x, and their 1-sigma."""
    place = np.floor((x - x.min()) / (np.ptp(x) + 1e-300) * _BINS).astype(np.intp)
    count = np.bincount(place)
    some = np.flatnonzero(count)
    size = count[some]
    mean_x, mean_v = (np.bincount(place, weights=values)[some] / size for values in (x, v))
    return mean_x, mean_v, np.asarray(np.hypot(noise / np.sqrt(size), 0.001))


def first_guesses(x: Array, v: Array, g: float, known: bool) -> list[Array]:
    """Starts (phase, length, low, size - 1): the best of a periodogram, and short lengths where levels are known."""
    longest = 2.0 * np.pi * _LONGEST * len(x)
    lengths = np.arange(2.0 * np.pi, longest, np.pi / 4.0)
    turn = np.exp(1j * lengths[:, None] * x[None, :])
    power = np.abs(turn @ (v - v.mean())) ** 2
    out = []
    for k in np.argsort(-power)[:_STARTS]:
        # v falls with the cosine of the phase
        phase = np.angle(-np.sum(np.conj(turn[k]) * (v - v.mean())))
        out.append(np.array([phase, lengths[k], 0.0, 0.0]))
    if known:
        phases, short = np.meshgrid(np.arange(16) * np.pi / 8.0, np.arange(0.25, 10.0, 0.25))
        model = fringe(np.cos(phases.ravel()[:, None] + short.ravel()[:, None] * x), g)
        misfit = np.sum((model - v) ** 2, axis=1)
        best = np.argsort(misfit)[: 2 * _STARTS]
        out += [np.array([phases.ravel()[k], short.ravel()[k], 0.0, 0.0]) for k in best]
    return out


def _fit(x: Array, v: Array, sigma: Array, p: Array, g: float, slack: float) -> tuple[float, Array, Array]:
    """chi2, parameters and their covariance by least squares; a length is positive."""

    def blocks(p: Array) -> list[Array]:
        if not p[1] > 0.0:
            return [np.full((1, 5), np.nan)]
        phase, size = p[0] + p[1] * x, 1.0 + p[3]
        shape, slope = fringe(np.cos(phase), g), fringe_slope(phase, g)
        rate, off = size * slope, p[2] + size * shape - v
        light = np.array([rate, rate * x, np.ones_like(x), shape, off]) / sigma
        levels = np.vstack([np.zeros((2, 2)), np.eye(2), p[2:]]) / slack
        return [np.hstack([light, levels]).T]

    found = minimise(blocks, p, limit=_STEPS, tolerance=_LEFT, share=_LEFT, damping=_DAMPING)
    jacobian = found.factor[:, :4]
    return 2.0 * found.cost, found.t, np.asarray(np.linalg.pinv(jacobian.T @ jacobian), dtype=np.float64)
