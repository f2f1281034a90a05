"""Pose accuracy and repeatability after ISO 9283:1998 (7.2.1), from poses that a recording visits several times.

The standard asks for 30 visits of five poses under rated load and speed; a recording rarely has them. What it has is
evaluated by the standard's formulas, and the number of visits is told.

How far readings repeat where the arm came back: what no model of joints and loads leaves less than.

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
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.summary import rms_by_kind
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine

VISITS = 3
"""Fewest visits of a pose from which on its spread is told."""


@dataclass(frozen=True)
class PoseTest:
    """Of poses (k,) with several visits each: accuracy AP and repeatability RP of the position, mm, and visits (k,).

    accuracy: distance of the model's position from the mean of those that were read; repeatability: mean distance from that
    mean plus three standard deviations.
    """

    accuracy: Array
    repeatability: Array
    visits: Index


def pose_test(fit: Estimate, recording: Recording) -> PoseTest | None:
    """By the model of a fit; None where no pose has enough visits, or no sensor reads a position."""
    axes = position_channels(fit.nominal)
    if axes is None:
        return None
    off = fit.residual[:, axes] * [fit.nominal.channels[k].sigma for k in axes]
    known = np.isfinite(off).all(axis=1)
    if fit.lost is not None:
        known &= ~fit.lost[:, axes].any(axis=1)
    rows = np.flatnonzero(known)
    _, label, visits = np.unique(recording.replicates()[rows], return_inverse=True, return_counts=True)
    often = visits[label] >= VISITS
    order = np.argsort(label[often], kind="stable")
    found = []
    for own in np.split(off[rows[often][order]], np.cumsum(visits[visits >= VISITS])[:-1]):
        if len(own):
            mean = own.mean(axis=0)
            away = np.linalg.norm(own - mean, axis=1)
            found.append((np.linalg.norm(mean), away.mean() + 3.0 * away.std(ddof=1), len(own)))
    if not found:
        return None
    accuracy, repeatability, visits = map(np.array, zip(*found, strict=True))
    return PoseTest(accuracy, repeatability, visits.astype(np.intp))


def position_channels(machine: Machine) -> list[int] | None:
    """The three channels of the first point that a sensor reads; None where none does, or rows are only compared."""
    first = 0
    for sensor in machine.sensors:
        points: dict[str, list[int]] = {}
        for k, channel in enumerate(sensor.channels, first):
            if channel.kind == "position" and not sensor.compares:
                points.setdefault(channel.point, []).append(k)
        first += len(sensor.channels)
        found = next((at for at in points.values() if len(at) == 3), None)
        if found is not None:
            return found
    return None


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
