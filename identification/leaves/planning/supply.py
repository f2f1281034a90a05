"""Where planned poses come from: candidates inside the joints' ranges, and random sets of poses.

Planned joint values in the units of the machine file, rounded inside their ranges.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.leaves.planning.information import PoseInformation, Poses
from truepose.models.machine.machine import Machine
from truepose.models.units import convert


def rounded(q: Array, machine: Machine, step: float) -> Array:
    """Joint values (n, nq) rounded to about ``step`` of their range in the file's units, never out of it."""
    out = q.copy()
    for k, actuator in enumerate(machine.mechanism.actuators):
        if actuator.range is None:
            continue
        unit = machine.column_unit(actuator.reading)
        low, high = (convert(end, actuator.reading_unit, unit) for end in actuator.range)
        places = decimals(np.array([high - low]), step)
        values = np.round(convert(q[:, k], actuator.reading_unit, unit), places)
        out[:, k] = np.clip(convert(values, unit, actuator.reading_unit), *actuator.range)
    return out


def decimals(values: Array, step: float) -> int:
    """Decimals that resolve ``step`` of the largest of ``values`` (n,); 0 where all are zero."""
    if not np.any(values):
        return 0
    return int(np.ceil(-np.log10(step * float(np.max(np.abs(values))))))


CANDIDATES = 600
STRONG = 3.0
"""Loops that react so many times more strongly to the constants than those of the median pose: the pose is on the
way to a singularity, where every criterion is drawn and a real machine should not go."""
_ROUNDS = 50


@dataclass(frozen=True)
class Supply:
    """Candidates ``poses`` that can be assembled, none next to a singularity (``strongest``).

    given: they are the user's; left_out: how many of those were no use.
    """

    information: PoseInformation
    poses: Poses
    strongest: float
    given: bool
    left_out: int

    @classmethod
    def of(cls, information: PoseInformation, given: Array | None, rng: np.random.Generator) -> Supply:
        """The given poses (c, nq), or half drawn inside the ranges, half of low, middle and high joint values."""
        q = given
        if q is None:
            q = np.concatenate([_uniform(information, CANDIDATES // 2, rng), _levels(information, rng)])
        poses = information.at(q)
        strongest = STRONG * float(np.median(poses.amplification[poses.good])) if poses.good.any() else 0.0
        use = poses.within(strongest)
        if not use.any():
            raise InputError(
                f"{information.machine.name}: found no pose among {len(q)} in which the mechanism can be assembled, "
                "expected ranges of the joints that it can reach"
            )
        return cls(
            information,
            poses.take(use),
            strongest,
            given is not None,
            int(np.sum(~use)) if given is not None else 0,
        )

    def draw(self, n: int, rng: np.random.Generator) -> Poses:
        """``n`` random poses: uniform inside the ranges, or some of the given ones (each once, if there are enough)."""
        if self.given:
            return self.poses.take(rng.choice(len(self.poses.q), n, replace=n > len(self.poses.q)))
        found = np.empty((0, len(self.information.low)))
        for _ in range(_ROUNDS):
            poses = self.information.at(_uniform(self.information, n, rng))
            found = np.concatenate([found, poses.q[poses.within(self.strongest)]])
            if len(found) >= n:
                return self.information.at(found[:n])
        raise InputError(
            f"{self.information.machine.name}: found {len(found)} of {n * _ROUNDS} random poses in which the mechanism "
            "can be assembled, expected narrower ranges of the joints"
        )


def _uniform(information: PoseInformation, n: int, rng: np.random.Generator) -> Array:
    return rng.uniform(information.low, information.high, (n, len(information.low)))


def _levels(information: PoseInformation, rng: np.random.Generator) -> Array:
    """Poses whose joints stand low, in the middle or high: all of them, or some where there are too many."""
    joints, wanted = len(information.low), CANDIDATES // 2
    if 3**joints <= wanted:
        shares = np.array(list(product((0.0, 0.5, 1.0), repeat=joints)))
    else:
        shares = np.unique(rng.integers(0, 3, (wanted, joints)), axis=0) / 2.0
    return np.asarray(information.low + shares * (information.high - information.low))
