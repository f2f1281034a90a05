"""Forward kinematics of a symbolic model in Python, for test vectors of the generated C.

Loops are closed along a path from the home assembly, so that the assembly is the one the machine file means.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np

from truepose.arrays import Array
from truepose.models.machine.closure import closed, coordinate_scale, one_row
from truepose.models.machine.kinematics import SymbolicModel

_ROUNDS = 50
_STEPS = 10
_ASIDE, _LEVEL = 0.1, 1e-4
"""rad, and parts of the reach, to a pose next to home; share of the largest slope below which a passive motion is open."""
_SHRINK = (1.0, 0.5, 0.25, 0.1)


class Reference:
    """Numeric forward kinematics of a model."""

    def __init__(self, model: SymbolicModel) -> None:
        inputs = [model.q, model.z, model.p, model.x]
        self.model = model
        self._pose = ca.Function("pose", inputs, [ca.densify(model.pose)])
        g, lost = model.equations, [model.closure, ca.jacobian(model.closure, model.q)]
        self._loops = ca.Function(
            "loops", inputs, [ca.densify(v) for v in (g, ca.jacobian(g, model.x), model.gap)]
        )
        self._lost = ca.Function("lost", inputs, [ca.densify(v) for v in lost])
        self._scale = coordinate_scale(model.machine, len(model.home), model.gap.numel())

    @property
    def is_singular(self) -> bool:
        """True if loops leave a passive motion open at home that they do not leave open next to it: assemblies meet there."""
        home = self.model.home
        if not len(home) or not np.isfinite(self._scale.limit).all():
            return False
        aside = home + _ASIDE * self._scale.size * np.random.default_rng(0).uniform(-1.0, 1.0, len(home))
        ranks = []
        for x in (home, aside):
            by_x = np.array(self._loops(self.model.q_home, self.model.z_home, self.model.p_home, x)[1])
            ranks.append(int(np.linalg.matrix_rank(by_x * self._scale.size, rtol=_LEVEL)))
        return ranks[0] < ranks[1]

    def home_readings(self, start: Array) -> Array:
        """Readings (nq,) at which the loops come closest to closing at the home assembly, from ``start`` (nq,)."""
        q = start.copy()
        for _ in range(_ROUNDS if len(self.model.home) else 0):
            residual, by_q = (
                np.array(v) for v in self._lost(q, self.model.z_home, self.model.p_home, self.model.home)
            )
            step = np.linalg.lstsq(by_q, -residual[:, 0], rcond=None)[0]
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
        x = self.model.home
        steps = _STEPS if near is not None and len(x) else 1
        for step in range(1, steps + 1):
            at = q if near is None or step == steps else near + step / steps * (q - near)
            solved = self._newton(at, x)
            if solved is None:
                return None
            x = solved
        return np.array(self._pose(q, self.model.z_home, self.model.p_home, x))

    def passive(self, q: Array) -> Array | None:
        """Passive coordinates (nx,) at readings ``q`` (nq,), from the home assembly; None where the loops do not close."""
        return self._newton(q, self.model.home)

    def samples(self, low: Array, high: Array, near: Array, count: int) -> Iterator[tuple[Array, Array]]:
        """``count`` readings (nq,) spread between ``low`` and ``high`` (nq,), with their poses (4, 4).

        Readings at which the loops cannot be followed from ``near`` (nq,) are drawn towards it; where ``count`` places were
        tried and none will do, no more are tried.
        """
        left = count
        for k, fractions in enumerate(spread(len(low), 10 * count)):
            if k == count and left == count:
                return
            target = low + fractions * (high - low)
            for amount in _SHRINK if len(self.model.home) else (1.0,):
                q = near + amount * (target - near) if len(self.model.home) else target
                if (pose := self.forward(q, near)) is None or (direct := self.forward(q)) is None:
                    continue
                if np.allclose(pose, direct, rtol=0, atol=1e-9):
                    yield q, pose
                    left -= 1
                    break
            if left == 0:
                return

    def _newton(self, q: Array, x: Array) -> Array | None:
        if not len(x):
            return x
        here = one_row(self._loops, q, self.model.z_home, self.model.p_home)
        found, good = closed(here, x[None], self._scale)
        return found[0] if good[0] else None


def strain_of(model: SymbolicModel) -> float:
    """Largest gap (mm) at which overconstrained loops count as closed; inf where loops close without strain."""
    return coordinate_scale(model.machine, len(model.home), model.gap.numel()).gap


def spread(size: int, count: int) -> Iterator[Array]:
    """``count`` points (size,) that fill the unit cube evenly, the middle first (Kronecker sequence)."""
    slopes = slopes_of(size)
    for k in range(count):
        yield np.mod(0.5 + k * slopes, 1.0)


def slopes_of(size: int) -> Array:
    """(size,) fractional parts of the square roots of the first primes."""
    primes: list[int] = []
    candidate = 2
    while len(primes) < size:
        if all(candidate % prime for prime in primes):
            primes.append(candidate)
        candidate += 1
    roots: Array = np.sqrt(np.array(primes, dtype=float))
    return roots - np.floor(roots)
