"""How far a model without any name gets: smooth curves at the joints and mounts, as many columns as one allows.

A column moves one port (a joint's reading, a constant of a frame or of the instrument) by one smooth curve of one driver
(Legendre polynomials of a joint, the clock, the load, a thermometer; the side of arrival, the session). Columns are taken
greedily beside the geometry under its tolerances; how many of those allowed are of use is decided by cross-validation over
poses: the fewest within one standard error of the best (Breiman et al. 1984). Outside the fitted ranges a curve stays as it
is at their ends. All of it is linear about the specimen, by the simulator's own derivatives.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from challenge.measures import difference
from challenge.setup import Setup
from challenge.simulator.base import Campaign
from challenge.slopes import Constant, by_constants, by_joints, since_first

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
DEGREE = 5
MOST = 40
"""Columns that are tried at most."""
FOLDS = 5
RIDGE = 0.1
"""Weight of a column's coefficient when the column has unit length: a prior of 3 sigma, which of those tried (1, 3, 100)
predicted best on cases that no examination has."""
FAINT = 1e-6
"""Share of a column below which rounding is all that geometry leaves."""
INSTRUMENT = ("beam", "mirror")


@dataclass(frozen=True)
class Problem:
    """Rows in sigma: geometry (N, f) by steps, curves (N, c), what is seen (N,) of departures from the specimen."""

    geometry: Array
    curves: Array
    seen: Array

    @classmethod
    def of(cls, slopes: Array, curves: Array, seen: Array) -> Problem:
        """From (n, k, f), (n, k, c) and (n, k)."""
        return cls(slopes.reshape(-1, slopes.shape[2]), curves.reshape(-1, curves.shape[2]), np.ravel(seen))

    def part(self, rows: Mask) -> Problem:
        """Some rows (N,)."""
        return Problem(self.geometry[rows], self.curves[rows], self.seen[rows])


def best_empirical(setup: Setup, observed: Array, exact_held: Array, calm: Mask) -> tuple[float, ...]:
    """(MOST + 1,) held-out error in sigma with none, one, two ... columns allowed.

    observed (n, k) and exact_held (h, k): readings of the campaign with noise, and true ones of the held-out rows, mm and
    rad; calm (n,): rows that are not wild.
    """
    n, columns, sigma = len(setup.campaign), setup.machine.columns, setup.sigma
    clean, held_clean = setup.exact(())
    seen = difference(observed, clean, columns) / sigma
    held = difference(exact_held, held_clean, columns) / sigma
    used = ~setup.campaign.validation & calm
    slopes, curves = setup.slopes / sigma[:, None], _curves(setup, used) / sigma[:, None]
    known = Problem.of(slopes[:n][used], curves[:n][used], seen[used])
    asked = Problem.of(slopes[n:], curves[n:], held)
    fold = np.repeat(setup.campaign.pose[used] % FOLDS, len(columns))
    parts = [fold == number for number in np.unique(fold)]
    missed = np.array([errors_left(known.part(~out), known.part(out), setup.free) ** 2 for out in parts])
    errors = errors_left(known, asked, setup.free)
    return tuple(float(errors[_fewest(missed[:, : k + 1])]) for k in range(MOST + 1))


def _fewest(missed: Array) -> int:
    """The fewest columns whose squared error (folds, columns) is within one standard error of the least."""
    mean = missed.mean(axis=0)
    best = int(np.argmin(mean))
    # folds differ by how hard they are; what counts is how much their differences scatter
    worse = missed - missed[:, best : best + 1]
    spread = worse.std(axis=0, ddof=1) / np.sqrt(len(missed)) if len(missed) > 1 else np.zeros(len(mean))
    return int(np.flatnonzero(worse.mean(axis=0) <= spread)[0])


def errors_left(known: Problem, asked: Problem, free: Sequence[Constant]) -> Array:
    """(MOST + 1,) rms of what models of no column, one, two ... leave of what is asked (orthogonal matching pursuit)."""
    weight, nominal = np.array([c.weight for c in free]), np.array([-c.off for c in free])
    solve = np.linalg.pinv(np.vstack([known.geometry, np.diag(weight)]), rcond=1e-12)
    by_rows, by_prior = solve[:, : len(known.seen)], solve[:, len(known.seen) :]
    step, bends = by_rows @ known.seen + by_prior @ (weight * nominal), by_rows @ known.curves
    # what geometry leaves: in the readings, and in what it costs
    left = np.append(known.seen - known.geometry @ step, weight * (nominal - step))
    curves = np.vstack([known.curves - known.geometry @ bends, -weight[:, None] * bends])
    target, ahead = asked.seen - asked.geometry @ step, asked.curves - asked.geometry @ bends
    length, whole = np.linalg.norm(curves, axis=0), np.linalg.norm(known.curves, axis=0)
    curves = curves / np.where(length > FAINT * np.maximum(whole, 1.0), length, np.inf)
    ahead = ahead / np.where(length > 0, length, np.inf)
    out = [float(np.sqrt(np.mean(target**2)))]
    chosen, rest = list[int](), left
    for _ in range(min(MOST, len(known.seen) // 2, curves.shape[1])):
        gains = np.abs(curves.T @ rest)
        gains[chosen] = 0.0
        chosen.append(int(np.argmax(gains)))
        own = curves[:, chosen]
        sizes = np.linalg.solve(own.T @ own + RIDGE * np.eye(len(chosen)), own.T @ left)
        rest = left - own @ sizes
        out.append(float(np.sqrt(np.mean((target - ahead[:, chosen] @ sizes) ** 2))))
    return np.array(out + out[-1:] * (MOST + 1 - len(out)))


def _curves(setup: Setup, used: Mask) -> Array:
    """(n + h, k, c) what every curve at every port does to the readings, mm and rad."""
    whole = setup.whole
    ports = np.concatenate([by_joints(setup.machine, setup.specimen, whole), _mounts(setup)], axis=2)
    shapes = np.stack(list(_shapes(whole, np.append(used, np.zeros(len(whole) - len(used), bool)))), axis=1)
    moved = (ports[..., None] * shapes[:, None, None, :]).reshape(*ports.shape[:2], -1)
    compared = whole.origin != np.arange(len(whole))
    return np.asarray(moved - moved[whole.origin] if compared.any() else moved)


def _mounts(setup: Setup) -> Array:
    """(n + h, k, p) derivative by each constant of the frames and of the instrument."""
    own = [c for c in setup.free if c.frame or c.name.split(".")[0] in INSTRUMENT]
    return by_constants(setup.machine, setup.specimen, since_first(setup.whole), own)[1:]


def _shapes(whole: Campaign, used: Mask) -> Iterator[Array]:
    """(n,) each: one, polynomials of every driver that varies in the rows used, sides of arrival, sessions."""
    yield np.ones(len(whole))
    smooth = [*whole.q.T, whole.time, whole.payload, whole.pressure, *whole.temperatures.values()]
    for driver in smooth:
        low, high = float(np.min(driver[used])), float(np.max(driver[used]))
        if high - low > FAINT * max(abs(low), abs(high)):
            along = np.clip((2 * driver - low - high) / (high - low), -1.0, 1.0)
            yield from legendre.legvander(along, DEGREE)[:, 1:].T
    steps = [*whole.approach.T, whole.session.astype(float)]
    steps += [] if whole.velocity is None else [*whole.velocity.T]
    yield from (step for step in steps if np.ptp(step[used]) > 0)


__all__ = ["MOST", "Problem", "best_empirical", "errors_left"]
