"""What the drawing's tolerances explain of a misfit, and at which price: a few linear steps of all constants.

A hypothesis is right where little is left *and* no constant had to leave its tolerance for it. Both count in one number:
the rms of whitened readings and of departures from the drawing, in units of the same noise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from truepose.identification.leaves.check.rig import KEPT, Rig, Stand
from truepose.identification.prediction.predictor import Predictor

Array = NDArray[np.float64]
_STEPS, _PARTS, _ENOUGH = 6, (1.0, 0.3, 0.1), 0.01
_LOOSE = 1e3
"""Steps allowed to what is unknown (frames, infinite tolerances), in natural sizes: none is in the way."""


@dataclass(frozen=True)
class Settled:
    """Constants p (np,) where readings and tolerances agree best, the misfit that is left, and what it cost.

    price: rms of readings and departures, in sigmas; misfit: rms of the readings alone, over the rows that fit best; away:
    departure of each constant, in tolerances, by name.
    """

    p: Array
    price: float
    misfit: float
    away: dict[str, float]

    @property
    def farthest(self) -> float:
        """The largest departure, in tolerances."""
        return max(self.away.values(), default=0.0)


def expected(rig: Rig, stand: Stand) -> float:
    """Return the misfit (whitened rms) that the tolerances alone would leave once base and tool are fitted; at least 1."""
    here, p = _over(rig, stand), stand.p
    jacobian, _ = linearised(rig, here, p, stand)
    tolerance = rig.tolerances(stand.scene)
    known = np.flatnonzero(np.isfinite(tolerance) & (tolerance > 0) & ~_loose(rig))
    if not len(known) or not len(jacobian):
        return 1.0
    carried = jacobian[:, :, known] * tolerance[known]
    flat = carried.reshape(-1, len(known))
    left = without(jacobian[:, :, _loose(rig)].reshape(len(flat), -1), flat)
    return float(np.sqrt(1.0 + np.sum(left**2) / max(len(flat), 1)))


def settle(rig: Rig, stand: Stand, free: tuple[str, ...] = (), noise: float | None = None) -> Settled:
    """Return where readings and tolerances agree, with the frames ``free`` wherever they fit best.

    What is left then is taken as the readings' noise (sigmas, unless it is given), so that no constant bends for what it cannot
    explain.
    """
    if stand.bad:
        return Settled(stand.p, float("inf"), float("inf"), {})
    if noise is not None:
        return Problem(rig, stand, noise, free).settled()
    first = Problem(rig, stand, 1.0, free).settled()
    return Problem(rig, stand, max(first.misfit, 1.0), free).settled()


class Problem:
    """Readings and tolerances in one sum of squares, for one hypothesis."""

    def __init__(self, rig: Rig, stand: Stand, noise: float, free: tuple[str, ...]) -> None:
        self.rig, self.stand, self.noise = rig, stand, noise
        self.here = _over(rig, stand)
        tolerance = rig.tolerances(stand.scene)
        for frame in free:
            tolerance[rig.at[frame]] = np.inf
        self.moving = np.flatnonzero(tolerance > 0)
        self.known = np.isfinite(tolerance[self.moving])
        natural = np.where(rig.lengths[self.moving], 100.0, 1.0)
        self.scale = np.where(self.known, tolerance[self.moving], natural)
        self.held = np.where(self.known, 1.0, 1.0 / _LOOSE)

    def settled(self) -> Settled:
        """Return the least sum within a few linear steps."""
        p = self.stand.p.copy()
        best, misfit = self._price(p)
        for _ in range(_STEPS if len(self.moving) else 0):
            jacobian, residual = linearised(self.rig, self.here, p, self.stand)
            if not len(residual):
                break
            keep = _kept(residual)
            j = jacobian[keep][:, :, self.moving].reshape(-1, len(self.moving)) * self.scale / self.noise
            off = self.off(p) * self.held
            right = -np.concatenate([residual[keep].reshape(-1) / self.noise, np.where(self.known, off, 0.0)])
            step = np.linalg.lstsq(np.vstack([j, np.diag(self.held)]), right, rcond=None)[0]
            for part in _PARTS:
                trial = p.copy()
                trial[self.moving] += part * step * self.scale
                price, left = self._price(trial)
                if price < best:
                    break
            else:
                break
            gained, best, misfit, p = (best - price) / best, price, left, trial
            if gained < _ENOUGH:
                break
        names = [self.rig.names[k] for k in self.moving[self.known]]
        away = dict(zip(names, np.abs(self.off(p)[self.known]).tolist(), strict=True))
        return Settled(p, best, misfit, away)

    def off(self, p: Array) -> Array:
        """Return how far constants (np,) are from where the file has them, in tolerances or natural sizes."""
        out: Array = (p - self.stand.scene.p)[self.moving] / self.scale
        return out

    def _price(self, p: Array) -> tuple[float, float]:
        """The sum at constants (np,), and the readings' share of it, both as an rms over the readings."""
        x, good = self.rig.assembled(self.here, p, self.stand.scene)
        residual = np.concatenate([b.residual for b in self.here.blocks(p, x)])
        residual = residual * self.rig.scale(self.stand.scene)
        residual = residual[good & np.isfinite(residual).all(axis=1)]
        if len(residual) < 0.5 * len(good):
            return float("inf"), float("inf")
        kept = residual[_kept(residual)]
        off = self.off(p)[self.known]
        read, count = np.sum(kept**2), max(kept.size, 1)
        return float(np.sqrt((read + self.noise**2 * np.sum(off**2)) / count)), float(np.sqrt(read / count))


def linearised(rig: Rig, here: Predictor, p: Array, stand: Stand) -> tuple[Array, Array]:
    """Return whitened Jacobians (n, m, np) and residuals (n, m) of the rows that have them, at constants (np,)."""
    x, good = rig.assembled(here, p, stand.scene)
    blocks = list(here.blocks(p, x))
    scale = rig.scale(stand.scene)
    residual = np.concatenate([b.residual for b in blocks]) * scale
    jacobian = np.concatenate([b.jacobian for b in blocks]) * scale[:, None]
    fine = good & np.isfinite(residual).all(axis=1) & np.isfinite(jacobian).all(axis=(1, 2))
    return jacobian[fine], residual[fine]


def _over(rig: Rig, stand: Stand) -> Predictor:
    return rig.predictor.over(stand.scene.rows.subset(stand.rows))


def _loose(rig: Rig) -> NDArray[np.bool_]:
    """(np,) what the cheap fit moves freely: the two frames."""
    out = np.zeros(len(rig.names), dtype=bool)
    for places in rig.at.values():
        out[places] = True
    return out


def _kept(residual: Array) -> NDArray[np.bool_]:
    """(n,) the rows that fit best."""
    each = np.sum(residual**2, axis=1)
    return np.asarray(each <= np.quantile(each, KEPT))


def without(columns: Array, values: Array) -> Array:
    """Return what the span of some columns (n, k) leaves of others (n, m)."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    if not columns.size:
        return values
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis = u[:, s > 1e-9 * s[0]]
    return np.asarray(values - basis @ (basis.T @ values))


__all__ = ["Problem", "Settled", "expected", "linearised", "settle", "without"]
