"""Pose accuracy and repeatability after ISO 9283:1998 (7.2.1), from poses that a recording visits several times.

The standard asks for 30 visits of five poses under rated load and speed; a recording rarely has them. What it has is
evaluated by the standard's formulas, and the number of visits is told.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.fit.estimate import Estimate
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


__all__ = ["PoseTest", "pose_test", "position_channels"]
