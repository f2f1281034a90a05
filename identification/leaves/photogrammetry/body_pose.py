"""Displacement of a rigid body from points measured on it before and after: pose, covariance, suspects.

Use ``body_pose`` for photogrammetry or tracker points of one body in two placements; it needs no idea of the
body's shape. (Frames of a cylinder, as in the telescope paper, section 3.1, err by more.)
``pose_table`` turns a whole table of points into the columns of a ``pose`` sensor.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import chi2 as chi2_distribution

from truepose.arrays import Array
from truepose.errors import InputError
from truepose.identification.fit.align import rigid_motion
from truepose.models.lie import pose_of

FEWEST = 3
LOOSE = 0.3
"""rad; a rotation whose 1-sigma is larger is not determined, and its linear covariance would mean nothing."""
SUSPICIOUS = 0.01
"""Chance that any good point of a body is called suspect."""
_FLAT = 1e-6


@dataclass(frozen=True)
class BodyPose:
    """Where a body went: ``after = R before + t``, with what the n points say about it.

    pose (4, 4) [R t], mm; covariance (6, 6) of the twist [v; w] (mm, rad) in the frame of ``after``: the true
    pose is Exp(w) R, t + v; residuals (n, 3) after less displaced before, mm; sigma: 1-sigma of one of their coordinates
    before the fit, mm; lever (n, 3) adjusted points less t, mm.
    """

    pose: Array
    covariance: Array
    residuals: Array
    sigma: float
    lever: Array

    @property
    def std(self) -> Array:
        """(6,) 1-sigma of the twist, mm and rad."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def chi2(self) -> float:
        """Sum of squared residuals in units of the noise."""
        return float(np.sum((self.residuals / self.sigma) ** 2))

    @property
    def dof(self) -> int:
        """Degrees of freedom of ``chi2``."""
        return 3 * len(self.residuals) - 6

    @cached_property
    def drops(self) -> Array:
        """(n,) what chi2 falls by when a point is left out; chi2 with 3 degrees of freedom for a good point."""
        r, j = self.residuals / self.sigma, _rows(self.lever) / self.sigma
        spread, axes = np.linalg.eigh(np.eye(3) - j @ self.covariance @ j.transpose(0, 2, 1))
        # a direction in which the others say nothing cannot be checked
        gain = np.divide(1.0, spread, out=np.zeros_like(spread), where=spread > _FLAT)
        return np.asarray(np.sum(gain * np.einsum("nij,ni->nj", axes, r) ** 2, axis=1))

    @property
    def suspects(self) -> tuple[int, ...]:
        """Points that hardly belong to the rigid body, worst first (none can be told among three).

        One bad point drags its neighbours: leave the worst out and fit again before judging the others.
        """
        if len(self.residuals) <= FEWEST:
            return ()
        limit = chi2_distribution.isf(SUSPICIOUS / len(self.residuals), 3)
        return tuple(int(k) for k in np.argsort(-self.drops) if self.drops[k] > limit)


def body_pose(before: ArrayLike, after: ArrayLike, sigma_after: float, sigma_before: float = 0.0) -> BodyPose:
    """Rigid displacement between corresponding points ``before`` and ``after``, both (n, 3), mm, n >= 3.

    The noise of either scatter is the 1-sigma (mm) of every coordinate; errors of different points are independent. The least
    sum of squares of after - (R before + t) is maximum likelihood for noise in both scatters, and found exactly by a singular
    value decomposition (Haralick et al., IEEE Trans. SMC 19, 1989). Raises InputError where a rotation is not determined,
    saying which.
    """
    x, y = _points(before, "before"), _points(after, "after")
    if x.shape != y.shape:
        raise InputError(
            f"found {len(x)} points before and {len(y)} after, expected pairs of the same point in each row"
        )
    if len(x) < FEWEST:
        raise InputError(f"found {len(x)} points, expected at least 3 that are not on one line")
    for what, size in (("sigma_before", sigma_before), ("sigma_after", sigma_after)):
        if not (np.isfinite(size) and size >= 0.0):
            raise InputError(f"{what}: found {size}, expected a number >= 0, mm")
    sigma = float(np.hypot(sigma_before, sigma_after))
    if sigma == 0.0:
        raise InputError("found no noise, expected sigma > 0 in one scatter or both")
    turn, shift = rigid_motion(x, y)
    arm = turn @ x.mean(axis=0)
    r = y - x @ turn.T - shift
    lever = y - (sigma_after / sigma) ** 2 * r - shift
    j = _rows(lever - arm).reshape(-1, 6) / sigma  # about the middle, where it is well conditioned
    information = j.T @ j
    _refuse_loose(information, turn)
    about = np.eye(6)
    about[:3, 3:] = -_rows(arm[None])[0, :, 3:]  # motion of the origin by a twist about the middle
    return BodyPose(pose_of(turn, shift), about @ np.linalg.inv(information) @ about.T, r, sigma, lever)


def _rows(lever: Array) -> Array:
    """(n, 3, 6) motion of points ``lever`` (n, 3) by the twist [v; w]: v + w x lever."""
    out = np.zeros((len(lever), 3, 6))
    out[:, :, :3] = np.eye(3)
    out[:, [0, 1, 2], [4, 5, 3]] = lever[:, [2, 0, 1]]
    out[:, [0, 1, 2], [5, 3, 4]] = -lever[:, [1, 2, 0]]
    return out


def _points(points: ArrayLike, what: str) -> Array:
    p = np.asarray(points, dtype=float)
    if p.ndim != 2 or p.shape[1] != 3:
        raise InputError(f"{what}: found an array of shape {p.shape}, expected (n, 3): x y z of each point")
    bad = np.flatnonzero(~np.isfinite(p).all(axis=1))
    if bad.size:
        raise InputError(f"{what}: point {bad[0]}: found {p[bad[0]]}, expected finite numbers")
    return p


def _refuse_loose(information: Array, turn: Array) -> None:
    """InputError where the points leave a rotation free, named by its axis in the frame of ``before``."""
    shifts, mixed, turns = information[:3, :3], information[:3, 3:], information[3:, 3:]
    strength, axes = np.linalg.eigh(turns - mixed.T @ np.linalg.solve(shifts, mixed))
    loose = strength < np.maximum(LOOSE**-2, 1e-14 * strength[-1])
    if not loose.any():
        return
    if loose.sum() > 1:
        raise InputError(
            "the points coincide within their noise: no rotation is determined; expected 3 that are apart and not on one line"
        )
    axis = turn.T @ axes[:, 0]
    axis = np.round(axis * np.sign(axis[np.argmax(np.abs(axis))]), 3) + 0.0
    raise InputError(
        f"the points lie on one line within their noise: the rotation about ({axis[0]:.3f}, {axis[1]:.3f}, {axis[2]:.3f}) "
        "(frame of the points before) is not determined; expected a point off that line"
    )
