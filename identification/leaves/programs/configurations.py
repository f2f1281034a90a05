"""Choose among the joints that reach a target by its further numbers: status and turn (KUKA), quadrants (ABB).

Both are read from joint values as the controller shows them, so the machine file's joints must be the controller's
axes, with its zeros and directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Mask

SLACK = math.radians(0.05)
"""rad: a joint so near a sign's or a quadrant's border counts as on either side: targets are rounded."""
_QUARTER = math.pi / 2


@dataclass(frozen=True)
class StatusTurn:
    """KUKA's S and T. A bit of T is set where its axis is below zero. Bits of S: the wrist is behind axis 1 (overhead); it is
    behind the lower arm (axis 3 below its stretched position); axis 5 is below zero."""

    def fits(self, numbers: tuple[float, ...], q: Array) -> Mask:
        """(m,) joints q (m, nq), rad, whose signs are those of the configuration."""
        turn = int(numbers[1])
        out = np.ones(len(q), dtype=bool)
        for k in range(6):
            out &= q[:, k] < SLACK if turn >> k & 1 else q[:, k] > -SLACK
        return out

    def decides(self, numbers: tuple[float, ...], shape: Mask) -> Mask:
        """(m,) shapes (m, 3) of the arm that are those of the configuration: it tells apart joints that all fit."""
        return _has_bits(shape, numbers[0], (0, 1, 2))

    def renewed(self, numbers: tuple[float, ...], q: Array) -> tuple[float, ...] | None:
        """The numbers at joints (nq,) a correction away; None where the robot would be in another configuration."""
        status, turn = int(numbers[0]), int(numbers[1])
        now = 0
        for k in range(6):
            was = bool(turn >> k & 1)
            now |= (q[k] < (1e-12 if was else -1e-12)) << k
        if (now ^ turn) & 16:  # axis 5 through zero: the wrist is singular there
            return None
        return (float(status), float(now | turn & ~63))


@dataclass(frozen=True)
class Quadrants:
    """ABB's cf1, cf4, cf6: the quarter turns that axes 1, 4 and 6 stand in, from zero, and cfx, which tells the rest.

    Bits of cfx: axis 5 is negative; the wrist's centre is behind the lower arm; it is behind axis 1.
    """

    def fits(self, numbers: tuple[float, ...], q: Array) -> Mask:
        """(m,) joints q (m, nq), rad, whose quadrants are those of the configuration."""
        out = np.ones(len(q), dtype=bool)
        for quadrant, k in zip(numbers, (0, 3, 5), strict=False):
            low = quadrant * _QUARTER
            out &= (q[:, k] > low - SLACK) & (q[:, k] < low + _QUARTER + SLACK)
        return out

    def decides(self, numbers: tuple[float, ...], shape: Mask) -> Mask:
        """(m,) as of ``StatusTurn``."""
        return _has_bits(shape, numbers[3], (2, 1, 0))

    def renewed(self, numbers: tuple[float, ...], q: Array) -> tuple[float, ...] | None:
        """The numbers at joints (nq,) a correction away."""
        now = []
        for quadrant, k in zip(numbers, (0, 3, 5), strict=False):
            low = quadrant * _QUARTER
            stays = low - 1e-12 <= q[k] <= low + _QUARTER + 1e-12
            now.append(quadrant if stays else float(math.floor(q[k] / _QUARTER)))
        return (*now, *numbers[3:])


Configuration = StatusTurn | Quadrants
"""What a target's configuration means for joints, and for how the arm stands with them (``shape``)."""


def _has_bits(shape: Mask, number: float, places: tuple[int, ...]) -> Mask:
    return np.asarray((shape == [bool(int(number) >> k & 1) for k in places]).all(axis=1))
