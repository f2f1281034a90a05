"""Least squares within bounds, passive joints as unknowns beside the parameters, by IPOPT.

Unknowns are the free parameters, the passive coordinates of every row, and the whitened residuals themselves;
equations say that the residuals are those of the readings and that the loops of every row close (they are not
solved at every trial), an inequality that unit vectors keep their length. What is minimised is then half a sum
of squares of unknowns, with a constant Hessian, Gauss-Newton's. Written out as J'J by parameters and
coordinates the same Hessian loses in rounding what tolerances alone decide, and IPOPT takes it for indefinite.

Use it where bounds must hold; where none is active its estimate is that of damped Gauss-Newton.

The simultaneous form of a least-squares problem: whitened residuals and loop equations of one long vector.

Unknowns v are the steps of the free parameters, then the passive coordinates of row after row, all in columns
of about length one. Derivatives are sparse: a row's readings and loops know its own coordinates alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np
import scipy.sparse as sp

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.fit.bounds import Bounds, directions
from truepose.identification.fit.leastsquares import Linear, Solution, Status, triangular
from truepose.identification.fit.problem import Problem
from truepose.identification.prediction.port_kinematics import twists_by
from truepose.identification.prediction.sensor_rows import Block, Sight, joined
from truepose.models.machine.closure import coordinate_scale

REST = 1e-3
"""Step, in its natural size, of a passive coordinate that no reading sees directly."""


class Program:
    """The program of a problem around scaled steps ``start`` (n_free,).

    size: number of unknowns; step (n_free,) turns the first of them into scaled steps; least (j,) lower bounds
    of the equations, whose upper bounds are zero.
    """

    def __init__(self, problem: Problem, start: Array) -> None:
        self.problem, self.n = problem, len(problem.prior.free)
        model, machine = problem.predictor.model, problem.predictor.machine
        self.nx = len(model.home)
        outputs = []
        for value in (model.closure, model.reading_shift):
            outputs += [value, ca.jacobian(value, model.p), ca.jacobian(value, model.x)]
        for world in model.worlds.values():
            outputs += [world, *twists_by(world, model.p, model.x)]
        rows = problem.predictor.evaluations
        self._model = BatchFunction("simultaneous", [model.x, model.q, model.z, model.p], outputs, rows=rows)
        self._comparisons = problem.predictor.comparisons(problem.used * problem.weights)
        self._compares = any(c is not None for c in self._comparisons)
        # rows that are not fitted matter where readings compare rows
        self._rows = np.flatnonzero(problem.assembled if self._compares else problem.used)
        self.size = self.n + len(self._rows) * self.nx
        length = np.linalg.norm(triangular(problem.blocks(start), self.n + 1)[:, : self.n], axis=0)
        self._x0 = problem.x.copy()  # the loops are closed there
        # between steps in tolerances, in which rounding of the gradient shows, and columns of length one,
        # in which nothing is seen of what tolerances alone decide
        self.step = 1.0 / np.sqrt(np.maximum(length, 1.0))
        self._last: tuple[Array, tuple[Array, ...]] | None = None
        self._stride, self._weight = np.ones(self.nx), np.ones(self.nx)
        names = list(model.names)
        self._directions = [[names.index(name) for name in axis] for axis in directions(machine)]
        self.least = np.append(np.zeros(len(self._rows) * self.nx), np.full(len(self._directions), -np.inf))
        if self.nx:
            self._scale(start, coordinate_scale(machine, self.nx, model.gap.numel()).size)

    def _scale(self, start: Array, natural: Array) -> None:
        """Columns of the passive coordinates, and rows of the equations, of about length one."""
        v = self.unknowns(start)
        block = self._observations(v)
        used = np.flatnonzero(self.problem.used)
        seen = np.sqrt(np.mean(np.sum(block.here[used][:, :, -self.nx :] ** 2, axis=1), axis=0))
        self._stride = 1.0 / np.maximum(seen, 1.0 / (REST * natural))
        _, by_p, by_x = self._closures(v)
        rows = np.concatenate([by_p, by_x], axis=2)
        self._weight = 1.0 / np.median(np.linalg.norm(rows, axis=2), axis=0)

    def steps(self, v: Array) -> Array:
        """(n_free,) scaled steps of the problem."""
        return np.asarray(v[: self.n] * self.step)

    def coordinates(self, v: Array) -> Array:
        """(n, nx) passive coordinates; of rows that are no unknowns as at the start."""
        x = self._x0.copy()
        x[self._rows] += v[self.n :].reshape(len(self._rows), self.nx) * self._stride
        return x

    def unknowns(self, t: Array) -> Array:
        """(size,) unknowns at scaled steps, coordinates as at the start."""
        return np.append(t / self.step, np.zeros(self.size - self.n))

    @property
    def prior(self) -> tuple[Array, Array]:
        """(n_free,) weight and pull: tolerances ask that weight * v + pull is small."""
        rows = self.problem.prior_rows(self.problem.p)
        return np.diag(rows[:, :-1]) * self.step, rows[:, -1]

    def observations(self, v: Array) -> tuple[Array, sp.csc_array]:
        """(k,) whitened residuals of the fitted rows and their derivative (k, size)."""
        block, used = self._observations(v), np.flatnonzero(self.problem.used)
        root = np.sqrt(self.problem.weights[used])[:, None]
        by_t = (
            block.changes(block.here[:, :, self.problem.prior.free] * self._by_step)[used] * root[..., None]
        )
        parts = [_full(by_t.reshape(-1, self.n)), self._by_coordinate(block, used, root)]
        return (block.residual[used] * root).ravel(), sp.hstack(parts).tocsc()

    def equations(self, v: Array) -> tuple[Array, sp.csc_array]:
        """(j,) zero where loops close, and below zero where directions are, with their derivative (j, size)."""
        loops, units = self._loops(v), self._unit_lengths(v)
        return np.concatenate([loops[0], units[0]]), sp.vstack([loops[1], units[1]]).tocsc()

    def _loops(self, v: Array) -> tuple[Array, sp.csr_array]:
        gap, by_p, by_x = self._closures(v)
        left = (by_p * self._weight[:, None]).reshape(-1, self.n)
        right = _along_diagonal(by_x * self._weight[:, None])
        return (gap * self._weight).ravel(), sp.hstack([_full(left), right]).tocsr()

    def _unit_lengths(self, v: Array) -> tuple[Array, sp.csr_array]:
        """Squared length less one of the components that are parameters of a unit vector."""
        p, free = self.problem.at(self.steps(v)), self.problem.prior.free
        slopes = np.zeros((len(self._directions), len(p)))
        for row, places in zip(slopes, self._directions, strict=True):
            row[places] = 2.0 * p[places]
        value = np.array([p[places] @ p[places] - 1.0 for places in self._directions])
        left = _full(slopes[:, free] * self._by_step)
        return value, sp.hstack([left, sp.csr_array((len(value), self.size - self.n))]).tocsr()

    @property
    def _by_step(self) -> Array:
        return np.asarray(self.problem.prior.scale[self.problem.prior.free] * self.step)

    def _by_coordinate(self, block: Block, used: Index, root: Array) -> sp.csr_array:
        """Derivative of the fitted readings by the coordinates of all rows."""
        by_x = block.here[:, :, block.here.shape[2] - self.nx :] * self._stride
        if not self._compares or self.nx == 0:
            return _along_diagonal(by_x[used] * root[..., None])
        apart = np.zeros((*by_x.shape[:2], len(self._rows), self.nx))
        apart[self._rows, :, np.arange(len(self._rows))] = by_x[self._rows]
        changes = block.changes(apart.reshape(*by_x.shape[:2], -1))[used] * root[..., None]
        return _full(changes.reshape(-1, changes.shape[2]))

    def _observations(self, v: Array) -> Block:
        """Residuals of all rows, with derivatives by p and by each row's own coordinates side by side."""
        predictor, p = self.problem.predictor, self.problem.at(self.steps(v))
        shift, shift_by_p, shift_by_x, *seen = self._evaluated(v)[3:]
        poses = {
            view: (seen[3 * k], np.concatenate(seen[3 * k + 1 : 3 * k + 3], axis=2))
            for k, view in enumerate(predictor.model.worlds)
        }
        sight = Sight.over(poses, shift[..., 0], np.concatenate([shift_by_p, shift_by_x], axis=2))
        every = slice(0, len(shift))
        return joined(every, predictor.seen(sight, p, every, self._comparisons))

    def _closures(self, v: Array) -> tuple[Array, Array, Array]:
        """Of each row in play: closure (k, nx), and by steps (k, nx, n_free) and coordinates (k, nx, nx)."""
        gap, by_p, by_x = (part[self._rows] for part in self._evaluated(v)[:3])
        return gap[..., 0], by_p[:, :, self.problem.prior.free] * self._by_step, by_x * self._stride

    def _evaluated(self, v: Array) -> tuple[Array, ...]:
        """Poses, closures and their derivatives of all rows; readings and equations share one evaluation."""
        if self._last is None or not np.array_equal(self._last[0], v):
            predictor, p = self.problem.predictor, self.problem.at(self.steps(v))
            self._last = v.copy(), self._model(self.coordinates(v), predictor.q, predictor.z, p)
        return self._last[1]


def _full(matrix: Array) -> sp.csr_array:
    """The matrix with all its entries, zeros among them: a pattern must not depend on where it was seen."""
    return _along_diagonal(matrix[None])


def _along_diagonal(blocks: Array) -> sp.csr_array:
    """The blocks (k, m, w) along the diagonal of a matrix (k m, k w)."""
    k, m, w = blocks.shape
    columns = np.arange(k * w).reshape(k, 1, w) + np.zeros((1, m, 1), dtype=int)
    return sp.csr_array((blocks.ravel(), columns.ravel(), np.arange(k * m + 1) * w), shape=(k * m, k * w))


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


SOLVERS = {"ipopt": simultaneous}
"""By the name that ``calibrate`` knows them by."""
