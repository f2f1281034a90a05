"""Positioning of one linear axis after ISO 230-2:2014, where a recording moves it alone, from both sides, several times.

Deviations are of what was read from what the model predicts, along the axis. The standard asks for five targets a metre and
five runs from each side; what a recording has is evaluated by the standard's formulas, and its targets and runs are told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.fit.estimate import Estimate
from truepose.identification.fit.pose_repeatability import position_channels
from truepose.identification.recording.recording import Recording
from truepose.models.file.driver import APPROACH

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
