"""Forward kinematics of a symbolic model in Python, for test vectors of the generated C.

Loops are closed by Newton's method with the exact derivative, along a path from the home assembly, so that
the assembly is the one the machine file means.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from truepose.models.home import coordinate_scale
from truepose.models.kinematics import SymbolicModel

Array = NDArray[np.float64]
_ROUNDS = 50
_STEPS = 10
_SHRINK = (1.0, 0.5, 0.25, 0.1)


class Reference:
    """Numeric forward kinematics of a model."""

    def __init__(self, model: SymbolicModel) -> None:
        inputs = [model.q, model.z, model.p, model.x]
        self.model = model
        self._pose = ca.Function("pose", inputs, [ca.densify(model.pose)])
        derivatives = [ca.densify(ca.jacobian(model.closure, v)) for v in (model.x, model.q)]
        self._closure = ca.Function("closure", inputs, [ca.densify(model.closure), *derivatives])
        self._gap, self._strain = ca.Function("gap", inputs, [ca.densify(model.gap)]), strain_of(model)

    def home_readings(self, start: Array) -> Array:
        """Readings (nq,) at which the loops come closest to closing at the home assembly, from ``start``."""
        q = start.copy()
        for _ in range(_ROUNDS if len(self.model.home) else 0):
            residual, _, by_q = self._closed(q, self.model.home, self.model.p_home, self.model.z_home)
            step = np.linalg.lstsq(by_q, -residual, rcond=None)[0]
            if not np.isfinite(step).all():
                return start
            q = q + step
            if np.max(np.abs(step)) < 1e-9:
                break
        return q

    def forward(self, q: Array, near: Array | None = None) -> Array | None:
        """Pose (4, 4), nominal base to tool, at readings ``q`` (nq,); None where the loops do not close.

        ``near`` (nq,) are readings at which the home assembly closes nearly; the loops are followed from
        there. Without it Newton's method starts at the home assembly directly.
        """
        p, z, x = self.model.p_home, self.model.z_home, self.model.home
        steps = _STEPS if near is not None and len(x) else 1
        for step in range(1, steps + 1):
            at = q if near is None or step == steps else near + step / steps * (q - near)
            solved = self._newton(at, x, p, z)
            if solved is None:
                return None
            x = solved
        return np.array(self._pose(q, z, p, x))

    def passive(self, q: Array) -> Array | None:
        """Passive coordinates (nx,) at readings ``q`` (nq,), from the home assembly; None where the loops do not close."""
        return self._newton(q, self.model.home, self.model.p_home, self.model.z_home)

    def samples(self, low: Array, high: Array, near: Array, count: int) -> Iterator[tuple[Array, Array]]:
        """``count`` readings spread between ``low`` and ``high`` (nq,), with their poses.

        Readings at which the loops cannot be followed from ``near`` are drawn towards it.
        """
        for fractions in spread(len(low), 10 * count):
            target = low + fractions * (high - low)
            for amount in _SHRINK if len(self.model.home) else (1.0,):
                q = near + amount * (target - near) if len(self.model.home) else target
                pose, direct = self.forward(q, near), self.forward(q)
                if pose is not None and direct is not None and np.allclose(pose, direct, rtol=0, atol=1e-9):
                    yield q, pose
                    count -= 1
                    break
            if count == 0:
                return

    def _closed(self, q: Array, x: Array, p: Array, z: Array) -> tuple[Array, Array, Array]:
        residual, by_x, by_q = (np.array(v) for v in self._closure(q, z, p, x))
        return residual.ravel(), by_x, by_q

    def _newton(self, q: Array, x: Array, p: Array, z: Array) -> Array | None:
        reach = max(1.0, float(np.max(np.abs(self.model.home), initial=0.0)))
        for _ in range(_ROUNDS if len(x) else 0):
            residual, by_x, _ = self._closed(q, x, p, z)
            if not (np.isfinite(residual).all() and np.isfinite(by_x).all()):
                return None
            step = np.linalg.lstsq(by_x, -residual, rcond=None)[0]
            size = float(np.max(np.abs(step)))
            x = x + step * min(1.0, 0.2 * reach / max(size, 1e-300))
            if size < 1e-12 * reach:
                lacks = np.max(np.abs(np.array(self._gap(q, z, p, x))), initial=0.0)
                return x if np.max(np.abs(residual)) < 1e-8 * reach and lacks < self._strain else None
        return x if len(x) == 0 else None


def strain_of(model: SymbolicModel) -> float:
    """Largest gap (mm) at which overconstrained loops count as closed; inf where loops close without strain."""
    return coordinate_scale(model.machine, len(model.home), model.gap.numel()).gap


def spread(size: int, count: int) -> Iterator[Array]:
    """``count`` points that fill the unit cube evenly, the middle first (Kronecker sequence)."""
    slopes = slopes_of(size)
    for k in range(count):
        yield np.mod(0.5 + k * slopes, 1.0)


def slopes_of(size: int) -> Array:
    """Fractional parts of square roots of the first primes (size,)."""
    primes: list[int] = []
    candidate = 2
    while len(primes) < size:
        if all(candidate % prime for prime in primes):
            primes.append(candidate)
        candidate += 1
    roots: Array = np.sqrt(np.array(primes, dtype=float))
    return roots - np.floor(roots)
