"""How far readings repeat where the arm came back: what no model of joints and loads leaves less than.

Two visits of one place have the same joint values up to what the arm stops at. What a model leaves of both differs by
the readings' noise and by what did not come back with the joints: play, drift, the place of the last stop. Its root mean square
over sqrt(2) is that of one row. The model takes out what the joints differ by, so that no column has to number the poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from truepose.arrays import Array, Index
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.recording.recording import Recording

CLOSE = 1e-3
"""Largest difference of every joint, in shares of the range that it covered, for two rows to be visits of one place."""
NEIGHBOURS = 8
"""Rows next to each row among which another visit is looked for."""
FEWEST = 30
"""Pairs that tell a scatter to a tenth; the closest ones, and those up to twice as far apart."""


@dataclass(frozen=True)
class Revisits:
    """Pairs of rows at the same place.

    apart: largest difference of a turning joint (``turn``, rad) and of a sliding one (``slide``, mm) in a pair. scatter: of
    one row, by kind of reading (mm, rad), and what the model leaves of the same rows (``left``).
    """

    pairs: int
    apart: Mapping[str, float]
    scatter: Mapping[str, float]
    left: Mapping[str, float]


def revisits(fit: Estimate, recording: Recording) -> Revisits | None:
    """Of the fitted rows; None where fewer than ``FEWEST`` places were visited again."""
    rows = np.flatnonzero(fit.used & np.isfinite(fit.residual).all(axis=1))
    place = np.empty(len(recording), dtype=np.intp)
    place[recording.order] = np.arange(len(recording))
    pairs, apart = _pairs(recording.q[rows], place[rows])
    if len(pairs) < FEWEST:
        return None
    pairs = pairs[apart <= 2.0 * np.sort(apart)[FEWEST - 1]]
    first, second = rows[pairs[:, 0]], rows[pairs[:, 1]]
    lost, channels = fit.lost, fit.nominal.channels
    gone = None if lost is None else lost[first] | lost[second]
    difference = (fit.residual[first] - fit.residual[second]) / np.sqrt(2.0)
    both = np.concatenate([fit.residual[first], fit.residual[second]])
    return Revisits(
        len(pairs),
        _apart(fit, np.abs(recording.q[first] - recording.q[second])),
        rms_by_kind(difference, channels, gone),
        rms_by_kind(both, channels, None if gone is None else np.concatenate([gone, gone])),
    )


def _pairs(q: Array, order: Index) -> tuple[Index, Array]:
    """(k, 2) rows that are each other's closest visit, but not next to each other in ``order`` (n,), and how far apart."""
    scaled = q / np.maximum(np.ptp(q, axis=0), 1e-12) if len(q) else q
    if len(q) < 2 or not np.any(np.ptp(q, axis=0) > 0.0):
        return np.zeros((0, 2), dtype=np.intp), np.zeros(0)
    count = min(NEIGHBOURS, len(q) - 1) + 1
    distance, near = map(
        np.asarray, cKDTree(scaled).query(scaled, count, p=np.inf, distance_upper_bound=CLOSE)
    )
    found = near < len(q)
    later = np.abs(order[np.where(found, near, 0)] - order[:, None]) > 1
    distance = np.where(found & later, distance, np.inf)
    best = np.argmin(distance, axis=1)
    own, other = np.arange(len(q)), near[np.arange(len(q)), best]
    apart = distance[own, best]
    there = np.isfinite(apart)
    pairs = np.sort(np.column_stack([own, other])[there], axis=1).astype(np.intp)
    pairs, index, count_of = np.unique(pairs, axis=0, return_index=True, return_counts=True)
    mutual = count_of > 1
    return pairs[mutual], apart[there][index][mutual]


def _apart(fit: Estimate, difference: Array) -> dict[str, float]:
    """Largest difference over pairs, of joints that turn and of those that slide."""
    mechanism = fit.nominal.mechanism
    units = {a.reading: a.unit for a in mechanism.actuators}
    out = dict[str, float]()
    for name, unit in (("turn", "rad"), ("slide", "mm")):
        own = [k for k, reading in enumerate(mechanism.readings) if units.get(reading) == unit]
        if own:
            out[name] = float(np.max(difference[:, own]))
    return out


__all__ = ["Revisits", "revisits"]
