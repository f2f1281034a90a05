"""Least squares within bounds, passive joints as unknowns beside the parameters, by IPOPT.

Unknowns are the free parameters, the passive coordinates of every row, and the whitened residuals themselves;
equations say that the residuals are those of the readings and that the loops of every row close (they are not
solved at every trial), an inequality that unit vectors keep their length. What is minimised is then half a sum
of squares of unknowns, with a constant Hessian, Gauss-Newton's. Written out as J'J by parameters and
coordinates the same Hessian loses in rounding what tolerances alone decide, and IPOPT takes it for indefinite.

Use it where bounds must hold; where none is active its estimate is that of damped Gauss-Newton.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from truepose.arrays import Array
from truepose.identification.fit.bounds import Bounds
from truepose.identification.fit.leastsquares import Linear, Solution, Status, triangular
from truepose.identification.fit.problem import Problem
from truepose.identification.fit.program import Program

LIMIT = 200
TOLERANCE = 1e-9
"""Of the optimality conditions."""
NEAR = 1e-7
"""Closer to its bound than this part of its step, a parameter stands at it."""
POLISHING = 3
LOST = 1e-9
"""Part of the sum of squares: where no more is left to gain, an end that IPOPT finds wanting is one."""
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "show_eval_warnings": False,
    "no_nlp_grad": True,  # multipliers of nothing but IPOPT itself are asked for
    "calc_lam_p": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.max_iter": LIMIT,
    "ipopt.tol": TOLERANCE,
    "ipopt.nlp_scaling_method": "none",  # columns and equations are scaled already
    "ipopt.bound_relax_factor": 0.0,
}
OUTCOMES = {
    "Solve_Succeeded": Status.CONVERGED,
    "Maximum_Iterations_Exceeded": Status.LIMIT,
    "Invalid_Number_Detected": Status.FAILED,
}


def simultaneous(problem: Problem, start: Array, bounds: Bounds) -> Solution:
    """The minimum within bounds from scaled steps ``start`` (n_free,)."""
    low, high = bounds.steps(problem)
    program = Program(problem, np.clip(start, low, high))
    v, status, iterations = _minimum(program, np.clip(start, low, high), low, high)
    problem.x = program.coordinates(v)
    t = program.steps(v)
    t = np.where(t - low < NEAR, low, np.where(high - t < NEAR, high, t))
    return polished(problem, t, (low, high), status, iterations)


def polished(
    problem: Problem, t: Array, bounds: tuple[Array, Array], status: Status, iterations: int
) -> Solution:
    """Gauss-Newton's last steps of what stands at no bound; they also tell how far from rest an end is."""
    low, high = bounds
    for trial in range(POLISHING + 1):
        factor = triangular(problem.blocks(t), len(t) + 1)
        left, cost = np.zeros(len(t)), 0.5 * float(np.sum(factor[:, -1] ** 2))
        if not np.isfinite(cost):
            return Solution(t, factor, cost, Status.FAILED, iterations, np.inf, left)
        inside = np.flatnonzero((t > low) & (t < high))
        left[inside] = Linear(factor[:, [*inside, len(t)]], len(inside)).step()
        gain = 0.5 * float(np.sum((factor[:, :-1] @ left) ** 2))
        after = t + left
        if gain > LOST * (1.0 + cost) or np.any(after < low) or np.any(after > high) or trial == POLISHING:
            break
        t = after
    slope = factor[:, :-1].T @ factor[:, -1]
    outwards = np.all(slope[t <= low] >= 0.0) and np.all(slope[t >= high] <= 0.0)
    if status is Status.STALLED and gain <= LOST * (1.0 + cost) and outwards:
        status = Status.CONVERGED
    return Solution(t, factor, cost, status, iterations, gain, left)


def _minimum(program: Program, start: Array, low: Array, high: Array) -> tuple[Array, Status, int]:
    """Unknowns (size,) of the program where IPOPT ends, how it ended, and its iterations."""
    first = program.unknowns(start)
    residual = program.observations(first)[0]
    unknowns = ca.MX.sym("v", program.size + len(residual))
    weight, pull = program.prior
    held = ca.DM(pull) + ca.DM(weight) * unknowns[: program.n]
    equations = _Equations(program, len(residual))
    curvature = np.concatenate([weight**2, np.zeros(program.size - program.n), np.ones(len(residual))])
    nlp = {
        "x": unknowns,
        "f": (ca.sumsqr(unknowns[program.size :]) + ca.sumsqr(held)) / 2,
        "g": equations.values(unknowns),
    }
    own = {"jac_g": equations.slopes, "hess_lag": _diagonal(curvature, equations.count)}
    solver = ca.nlpsol("simultaneous", "ipopt", nlp, {**OPTIONS, **own})
    free = np.full(len(curvature) - program.n, np.inf)
    found = solver(
        x0=np.append(first, residual),
        lbx=np.append(low / program.step, -free),
        ubx=np.append(high / program.step, free),
        lbg=np.append(np.zeros(len(residual)), program.least),
        ubg=0.0,
    )
    outcome = solver.stats()
    status = OUTCOMES.get(outcome["return_status"], Status.STALLED)
    return found["x"].full()[: program.size, 0], status, int(outcome["iter_count"])


def _diagonal(curvature: Array, equations: int) -> ca.Function:
    """The Hessian of the objective, weighted, as IPOPT's interface takes it."""
    v, weight = ca.MX.sym("v", len(curvature)), ca.MX.sym("weight")
    others = [ca.MX.sym("p", 0, 0), weight, ca.MX.sym("multipliers", equations)]
    return ca.Function("curvature", [v, *others], [weight * ca.diag(ca.DM(curvature))])


class _Equations:
    """Residuals of the readings, loops and directions as CasADi takes them, evaluated once a point."""

    def __init__(self, program: Program, residuals: int) -> None:
        self._program, self._residuals = program, residuals
        self._at: Array | None = None
        size = program.size + residuals
        pattern = self._evaluated(np.zeros(size))[1]
        self.count = int(pattern.shape[0])
        column, sparsity = ca.Sparsity.dense(self.count, 1), sparsity_of(pattern)
        self.values = _Numeric("equations", [size], [column], lambda v: self._evaluated(v)[:1])
        self.slopes = _Numeric("slopes", [size, 0], [column, sparsity], lambda v, _: self._evaluated(v))

    def _evaluated(self, unknowns: Array) -> tuple[Array, sp.csc_array]:
        """Equations (count,) and their derivative (count, size + residuals)."""
        v, w = np.split(unknowns, [self._program.size])
        if self._at is None or not np.array_equal(self._at, v):
            self._at = v.copy()
            self._kept = self._program.observations(v), self._program.equations(v)
        (r, by_v), (g, loops) = self._kept
        below = sp.csr_array((len(g), len(r)))
        slopes = sp.vstack([sp.hstack([-by_v, sp.eye_array(len(r))]), sp.hstack([loops, below])])
        return np.concatenate([w - r, g]), sp.csc_array(slopes)


class _Numeric(ca.Callback):
    """A function of numbers for CasADi: sizes of its inputs, patterns of its outputs."""

    def __init__(
        self,
        name: str,
        inputs: Sequence[int],
        outputs: Sequence[ca.Sparsity],
        values: Callable[..., Sequence[Any]],
    ) -> None:
        super().__init__()
        self._inputs, self._outputs, self._values = inputs, outputs, values
        self.construct(name, {})

    def get_n_in(self) -> int:
        return len(self._inputs)

    def get_n_out(self) -> int:
        return len(self._outputs)

    def get_sparsity_in(self, k: int) -> ca.Sparsity:
        return ca.Sparsity.dense(self._inputs[k], 1 if self._inputs[k] else 0)

    def get_sparsity_out(self, k: int) -> ca.Sparsity:
        return self._outputs[k]

    def eval(self, arguments: Sequence[ca.DM]) -> list[ca.DM]:
        values = self._values(*(a.full()[:, 0] if a.numel() else np.zeros(0) for a in arguments))
        return [ca.project(ca.DM(value), self._outputs[k]) for k, value in enumerate(values)]


def sparsity_of(matrix: sp.csc_array) -> ca.Sparsity:
    """The pattern of a sparse matrix, rows in order in each column."""
    matrix.sort_indices()
    return ca.Sparsity(*matrix.shape, matrix.indptr.tolist(), matrix.indices.tolist())


__all__ = ["polished", "simultaneous", "sparsity_of"]
