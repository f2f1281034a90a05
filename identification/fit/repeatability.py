"""Pose accuracy and repeatability after ISO 9283:1998 (7.2.1), from poses that a recording visits several times.

The standard asks for 30 visits of five poses under rated load and speed; a recording rarely has them. What it has is
evaluated by the standard's formulas, and the number of visits is told.

Positioning of one linear axis after ISO 230-2:2014, where a recording moves it alone, from both sides, several times.

Deviations are of what was read from what the model predicts, along the axis. The standard asks for five targets a metre and
five runs from each side; what a recording has is evaluated by the standard's formulas, and its targets and runs are told.

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
from truepose.models.file.driver import APPROACH
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


TARGETS, RUNS = 5, 2
"""Fewest targets, and fewest runs to each from each side."""


@dataclass(frozen=True)
class AxisTest:
    """Of one axis, mm: bidirectional accuracy A and systematic deviation E, repeatability R (of one side, the worse), reversal
    B; targets, and fewest runs to one of them from one side."""

    joint: str
    accuracy: float
    systematic: float
    repeatability: float
    reversal: float
    targets: int
    runs: int


def axis_tests(fit: Estimate, recording: Recording) -> list[AxisTest]:
    """Of every slide that moves alone; none where there are too few targets or runs, or no side of arrival was logged."""
    out = []
    for k, actuator in enumerate(fit.nominal.mechanism.actuators):
        # a standard's test states its sides: what the order of rows suggests is none
        side = recording.drivers.get(f"{APPROACH}.{actuator.reading}")
        if actuator.unit == "mm" and side is not None:
            found = _best(fit, recording, k, side)
            out += [found] if found is not None else []
    return out


def _best(fit: Estimate, recording: Recording, joint: int, side: Array) -> AxisTest | None:
    """The stretch with the most targets in which the other joints stand still."""
    others = np.delete(recording.q, joint, axis=1)
    _, group = np.unique(np.round(others, 9), axis=0, return_inverse=True)
    tests = [_test(fit, recording, joint, side, np.flatnonzero(group.ravel() == g)) for g in np.unique(group)]
    return max((t for t in tests if t is not None), key=lambda t: t.targets, default=None)


def _test(fit: Estimate, recording: Recording, joint: int, side: Array, rows: Index) -> AxisTest | None:
    along = _along(fit, recording, rows)
    if along is None:
        return None
    target = np.round(recording.q[rows, joint], 6)
    mean, spread, fewest = [], [], len(rows)
    for value in np.unique(target):
        runs = [along[(target == value) & (side[rows] == way)] for way in (1.0, -1.0)]
        runs = [run[np.isfinite(run)] for run in runs]
        if min(map(len, runs)) >= RUNS:
            mean.append([run.mean() for run in runs])
            spread.append([run.std(ddof=1) for run in runs])
            fewest = min(fewest, *map(len, runs))
    if len(mean) < TARGETS:
        return None
    m, s = np.array(mean), np.array(spread)
    return AxisTest(
        recording.joints[joint],
        accuracy=float(np.max(m + 2 * s) - np.min(m - 2 * s)),
        systematic=float(np.ptp(m)),
        repeatability=float(np.max(4 * s)),
        reversal=float(np.max(np.abs(m[:, 0] - m[:, 1]))),
        targets=len(m),
        runs=fewest,
    )


def _along(fit: Estimate, recording: Recording, rows: Index) -> Array | None:
    """(k,) deviations of the readings along the axis, mm: of a distance, or of a position in the direction of the travel."""
    if len(rows) < TARGETS * 2 * RUNS:
        return None
    off = -fit.residual[rows] * [channel.sigma for channel in fit.nominal.channels]
    if fit.lost is not None:
        off = np.where(fit.lost[rows], np.nan, off)
    lengths = [k for k, channel in enumerate(fit.nominal.channels) if channel.kind == "distance"]
    if lengths:
        return np.asarray(off[:, lengths[0]])
    at = position_channels(fit.nominal)
    names = [fit.nominal.channels[k].name for k in at or ()]
    if at is None or any(name not in recording.observations for name in names):
        return None
    read = np.column_stack([recording.observations[name][rows] for name in names])
    read = read[np.isfinite(read).all(axis=1)]
    if not len(read):
        return None
    way = np.linalg.svd(read - read.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray(off[:, at] @ way)


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
