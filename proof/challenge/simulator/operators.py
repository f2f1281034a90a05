"""Machine elements with a memory, and gears and encoders as they are made.

Hysteresis is a state evolved through the true path of a joint: ``waypoints`` gives the path with its overshoots,
``play``, ``stop`` and ``prandtl_ishlinskii`` run along it, ``at_rows`` picks what holds when a row is read.
All of them act on each column (joint) alone and are exact between turning points, so that a finer path changes
nothing. ``creep`` follows time; ``StiffeningSpring``, ``mesh_error`` and ``eccentric_disc`` have no memory.

Sources: Visintin, Differential Models of Hysteresis (1994), for play and stop; Kuhnen 2003 for their sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
MOVE, DWELL = 5.0, 2.0
"""s that a move takes, and that a machine stands before it is read unless a campaign says otherwise."""


def waypoints(q: Array, approach: Array, overshoot: ArrayLike) -> Array:
    """(2 n, nq) turning points of a campaign's path: before every reading the far end of its approach.

    q (n, nq) readings in order of time; approach +1 or -1 (0: straight from the last pose); overshoot > 0: by how
    much a joint starts behind its goal, in the unit of the joint. A joint that neither moves nor changes its side
    between two rows stays where it is.
    """
    via = q - np.asarray(approach, dtype=float) * np.asarray(overshoot, dtype=float)
    if len(q):
        still = (np.diff(q, axis=0) == 0) & (np.diff(approach, axis=0) == 0)
        rows, joints = np.nonzero(still)
        via[rows + 1, joints] = q[rows + 1, joints]
    path: Array = np.stack([via, q], axis=1).reshape(-1, q.shape[1])
    return path


def at_rows(along: Array) -> Array:
    """(n, nq) of (2 n, nq): the states at the readings of a path from ``waypoints``."""
    return along[1::2]


def play(path: Array, half_width: ArrayLike, start: ArrayLike | None = None) -> Array:
    """(m, ...) output of a play operator, backlash of 2 ``half_width``, along ``path`` (m, ...).

    start: output before the path begins; the first point of the path unless told.
    """
    r = np.asarray(half_width, dtype=float)
    out = np.empty(np.broadcast_shapes(path.shape, (1, *r.shape)))
    state = np.asarray(path[0] if start is None else start, dtype=float)
    for k, x in enumerate(path):
        state = np.minimum(np.maximum(state, x - r), x + r)
        out[k] = state
    return out


def stop(path: Array, half_width: ArrayLike, start: ArrayLike | None = None) -> Array:
    """(m, ...) elastic-plastic stop: spring deflection that slips beyond ``half_width`` (Coulomb pre-sliding)."""
    slip: Array = path - play(path, half_width, start)
    return slip


def prandtl_ishlinskii(path: Array, thresholds: Sequence[float], weights: Sequence[float]) -> Array:
    """(m, ...) sum of ``weights[i]`` times a play of half width ``thresholds[i]``, less the path's own share.

    What is returned is the departure from a line: sum w_i (play_i - path), zero for zero weights.
    """
    total = np.zeros_like(path)
    for threshold, weight in zip(thresholds, weights, strict=True):
        total -= weight * stop(path, threshold)
    return total


def presliding(path: Array, distances: Sequence[float], shares: Sequence[float]) -> Array:
    """(m, ...) friction as a share of its Coulomb limit, -1 ... 1: elements in parallel, each slipping after its distance.

    shares: of the Coulomb limit borne by each element; they add up to 1.
    """
    total = np.zeros_like(path)
    for distance, share in zip(distances, shares, strict=True):
        total += share * stop(path, distance) / distance
    return total


def creep(
    q: Array,
    time: Array,
    per_decade: ArrayLike,
    *,
    shortest: float = 1.0,
    longest: float = 1e4,
    dwell: Array | None = None,
) -> Array:
    """(n, nq) creep after moves at ``time`` (n,) s: Kelvin-Voigt elements in series, three to a decade of time.

    q (n, nq) positions stepped to, ``dwell`` (n,) s before each reading; in the spectrum's range each step grows
    by ``per_decade`` of itself for every factor 10 in time. Before the first row all elements are at rest there.
    """
    decades = np.log10(longest / shortest)
    taus = np.geomspace(shortest, longest, int(np.ceil(3 * decades)) + 1)
    gain = np.asarray(per_decade, dtype=float) * decades / (len(taus) - 1)
    waited = np.full(len(time), DWELL) if dwell is None else dwell
    arrival = np.asarray(time) - waited
    state = np.tile(q[0], (len(taus), 1))
    out = np.empty_like(q)
    for k in range(len(q)):
        if k:
            stay = max(arrival[k] - time[k - 1], 0.0)
            state = q[k - 1] + (state - q[k - 1]) * np.exp(-stay / taus)[:, None]
        state = q[k] + (state - q[k]) * np.exp(-waited[k] / taus)[:, None]
        out[k] = gain * np.sum(state - q[k], axis=0)
    return out


@dataclass(frozen=True)
class StiffeningSpring:
    """A gear's wind-up: torque = stiffness w + stiffness (ratio - 1) w^3 / knee^2 beyond a soft start.

    stiffness: of the soft start, N*m/rad (N/mm); at windup ``knee`` the secant stiffness is ``ratio`` times that.
    """

    stiffness: float
    ratio: float
    knee: float

    def windup(self, torque: Array) -> Array:
        """Twist (rad or mm) that balances a torque of any shape: Newton's method from the linear twist down."""
        k, cubic = self.stiffness, self.stiffness * (self.ratio - 1) / self.knee**2
        w = np.asarray(torque, dtype=float) / k
        for _ in range(60):
            step = (k * w + cubic * w**3 - torque) / (k + 3 * cubic * w**2)
            w = w - step
            if np.all(np.abs(step) <= 1e-15 * (1 + np.abs(w))):
                break
        return w


def mesh_error(
    q: Array, cycles: Sequence[float], amplitudes: Sequence[float], phases: Sequence[float]
) -> Array:
    """Kinematic error of a gear at angles q of any shape, rad: waves of ``cycles`` per turn of the joint."""
    error = np.zeros_like(q)
    for n, amplitude, phase in zip(cycles, amplitudes, phases, strict=True):
        error += amplitude * (np.sin(n * q + phase) - np.sin(phase))
    return error


def eccentric_disc(reading: Array, eccentricity: float, phase: float) -> Array:
    """True angle (rad) of a shaft whose encoder disc stands ``eccentricity`` (of its radius) off the axis.

    ``reading`` (rad) may have any shape. The head stands at radius 1 from the axis; the disc's centre turns about it at
    ``phase`` from the zero line. The disc reads the direction of the head as seen from its own centre.
    """

    def excess(angle: Array) -> Array:
        beat = angle + phase
        seen: Array = np.arctan2(eccentricity * np.sin(beat), 1 - eccentricity * np.cos(beat))
        return seen

    angle = np.asarray(reading, dtype=float)
    for _ in range(50):
        new = reading - excess(angle)
        if np.all(np.abs(new - angle) < 1e-15):
            return new
        angle = new
    return angle
