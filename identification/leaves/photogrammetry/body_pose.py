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
from truepose.errors import ConvergenceError, InputError
from truepose.models import lie
from truepose.models.lie import pose_of

FEWEST = 3
LOOSE = 0.3
"""rad; a rotation whose 1-sigma is larger is not determined, and its linear covariance would mean nothing."""
SUSPICIOUS = 0.01
"""Chance that any good point of a body is called suspect."""
_MAX_ITERATIONS = 100
_FLAT = 1e-6


@dataclass(frozen=True)
class BodyPose:
    """Where a body went: ``after = R before + t``, with what the n points say about it.

    pose (4, 4) [R t], mm; covariance (6, 6) of the twist [v; w] (mm, rad) in the frame of ``after``: the true
    pose is Exp(w) R, t + v; residuals (n, 3) after less displaced before, mm; noise (n, 3, 3) their covariance
    before the fit; lever (n, 3) adjusted points less t, mm.
    """

    pose: Array
    covariance: Array
    residuals: Array
    noise: Array
    lever: Array

    @property
    def std(self) -> Array:
        """(6,) 1-sigma of the twist, mm and rad."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def chi2(self) -> float:
        """Sum of squared residuals in units of the noise."""
        return float(np.einsum("ni,nij,nj->", self.residuals, np.linalg.inv(self.noise), self.residuals))

    @property
    def dof(self) -> int:
        """Degrees of freedom of ``chi2``."""
        return 3 * len(self.residuals) - 6

    @property
    def p_value(self) -> float:
        """Chance of a larger chi2 when the body is rigid and the noise as stated."""
        return float(chi2_distribution.sf(self.chi2, self.dof))

    @cached_property
    def drops(self) -> Array:
        """(n,) what chi2 falls by when a point is left out; chi2 with 3 degrees of freedom for a good point."""
        root = np.linalg.cholesky(self.noise)
        r = np.linalg.solve(root, self.residuals[..., None])[..., 0]
        j = np.linalg.solve(root, _rows(self.lever))
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

    def at(self, point: ArrayLike) -> tuple[Array, Array]:
        """Where a point (3,) of the body went, mm, and its covariance (3, 3)."""
        arm = self.pose[:3, :3] @ np.asarray(point, dtype=float)
        j = _rows(arm[None])[0]
        return self.pose[:3, 3] + arm, j @ self.covariance @ j.T


def body_pose(
    before: ArrayLike, after: ArrayLike, sigma_after: ArrayLike, sigma_before: ArrayLike = 0.0
) -> BodyPose:
    """Rigid displacement between corresponding points ``before`` and ``after``, both (n, 3), mm, n >= 3.

    The noise of either scatter is one 1-sigma (mm), one a point (n,), or covariances (3, 3) or (n, 3, 3), mm^2;
    errors of different points are independent. Minimises sum r' C^-1 r, r = after - (R before + t), with
    C = C_after + R C_before R', which is maximum likelihood for noise in both scatters. Weights alike in all
    directions are solved exactly by a singular value decomposition (Haralick et al., IEEE Trans. SMC 19, 1989);
    others by Gauss-Newton from there. Raises InputError where a rotation is not determined, saying which.
    """
    x, y = _points(before, "before"), _points(after, "after")
    if x.shape != y.shape:
        raise InputError(
            f"found {len(x)} points before and {len(y)} after, expected pairs of the same point in each row"
        )
    if len(x) < FEWEST:
        raise InputError(f"found {len(x)} points, expected at least 3 that are not on one line")
    cx, cy = (
        _covariances(sigma_before, len(x), "sigma_before"),
        _covariances(sigma_after, len(x), "sigma_after"),
    )
    _refuse_exact(cx + cy)
    weight = 3.0 / np.trace(cx + cy, axis1=1, axis2=2)
    middle_x, middle_y = (np.average(p, axis=0, weights=weight) for p in (x, y))
    turn, shift = _isotropic(x - middle_x, y - middle_y, weight), np.zeros(3)
    if not (_is_isotropic(cx) and _is_isotropic(cy)):
        turn, shift = _gauss_newton(x - middle_x, y - middle_y, cx, cy, turn)
    return _result(x, y, cx, cy, turn, middle_y + shift - turn @ middle_x, middle_x)


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


def _covariances(sigma: ArrayLike, n: int, what: str) -> Array:
    """(n, 3, 3) from 1-sigmas or covariances."""
    s = np.asarray(sigma, dtype=float)
    if s.shape in ((), (n,)):
        if not (np.isfinite(s).all() and (s >= 0.0).all()):
            raise InputError(f"{what}: found {s}, expected numbers >= 0, mm")
        return np.asarray(np.broadcast_to(s**2, (n,))[:, None, None] * np.eye(3))
    if s.shape not in ((3, 3), (n, 3, 3)):
        raise InputError(f"{what}: found shape {s.shape}, expected one number, ({n},), (3, 3) or ({n}, 3, 3)")
    size = np.max(np.abs(s), initial=0.0)
    symmetric = np.isfinite(s).all() and np.max(np.abs(s - np.swapaxes(s, -1, -2))) <= 1e-9 * size
    if not symmetric or np.min(np.linalg.eigvalsh(s)) < -1e-12 * size:
        raise InputError(f"{what}: found a matrix that is no covariance, expected symmetric and >= 0, mm^2")
    return np.broadcast_to(s, (n, 3, 3)).copy()


def _refuse_exact(noise: Array) -> None:
    """InputError where a point has no noise in some direction: its weight would be infinite."""
    spread = np.linalg.eigvalsh(noise)
    bad = np.flatnonzero(spread[:, 0] <= 1e-14 * np.max(spread))
    if bad.size:
        raise InputError(
            f"point {bad[0]}: found no noise in some direction, expected sigma > 0 in one scatter or both"
        )


def _is_isotropic(covariance: Array) -> bool:
    return bool((covariance == covariance[:, :1, :1] * np.eye(3)).all())


def _isotropic(x: Array, y: Array, weight: Array) -> Array:
    """Rotation that minimises sum w |y - R x|^2 of centred points, never a reflection."""
    u, _, vt = np.linalg.svd((weight[:, None] * y).T @ x)
    return np.asarray((u * [1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _adjusted(
    x: Array, y: Array, cx: Array, cy: Array, turn: Array, shift: Array
) -> tuple[Array, Array, Array]:
    """Residuals (n, 3), their covariance (n, 3, 3) and the likeliest true points less ``shift`` (n, 3)."""
    noise = cy + turn @ cx @ turn.T
    _refuse_exact(noise)
    r = y - x @ turn.T - shift
    true = y - np.einsum("nij,nj->ni", cy @ np.linalg.inv(noise), r)
    return r, noise, true - shift


def _information(noise: Array, lever: Array) -> tuple[Array, Array]:
    """(6, 6) information of the twist about the origin, and (n, 6, 3) weighted rows J' C^-1."""
    j = _rows(lever)
    weighted = np.asarray(np.linalg.solve(noise, j).transpose(0, 2, 1), dtype=float)
    return np.asarray(np.einsum("nai,nib->ab", weighted, j)), weighted


def _gauss_newton(x: Array, y: Array, cx: Array, cy: Array, turn: Array) -> tuple[Array, Array]:
    """Rotation and shift of centred points under full covariances.

    The true points are unknowns as well; eliminated, they leave C^-1 as the weight and move the lever arms to
    the adjusted points, which makes the gradient exact although C depends on R.
    """
    shift = np.zeros(3)
    for _ in range(_MAX_ITERATIONS):
        r, noise, lever = _adjusted(x, y, cx, cy, turn, shift)
        information, weighted = _information(noise, lever)
        _refuse_loose(information, turn)
        right = np.einsum("nai,ni->a", weighted, r)
        step = np.linalg.solve(information, right)
        turn, shift = lie.exp_so3(step[3:]) @ turn, shift + step[:3]
        if step @ right < 1e-12 * (1.0 + float(np.einsum("ni,nij,nj->", r, np.linalg.inv(noise), r))):
            return turn, shift
    raise ConvergenceError(
        f"the body's pose did not converge in {_MAX_ITERATIONS} steps: covariances and residuals contradict each other"
    )


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


def _result(x: Array, y: Array, cx: Array, cy: Array, turn: Array, shift: Array, middle: Array) -> BodyPose:
    r, noise, lever = _adjusted(x, y, cx, cy, turn, shift)
    arm = turn @ middle
    information, _ = _information(noise, lever - arm)  # about the middle, where it is well conditioned
    _refuse_loose(information, turn)
    about = np.eye(6)
    about[:3, 3:] = -_rows(arm[None])[0, :, 3:]  # motion of the origin by a twist about the middle
    return BodyPose(pose_of(turn, shift), about @ np.linalg.inv(information) @ about.T, r, noise, lever)


__all__ = ["BodyPose", "body_pose"]
