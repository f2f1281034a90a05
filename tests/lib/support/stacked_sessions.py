"""Sessions seen at random in one least-squares problem, what moves between them said rather than found, and all of it as
Gaussians written out in full."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.linalg import block_diag

from truepose.arrays import Array
from truepose.identification.fit.problem import Prior
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.leaves.drift.movement_problem import Kinds, Stack, movement_problem
from truepose.identification.leaves.drift.movements import Likeliest, MovementPosterior
from truepose.identification.posterior.design import GridPoint
from truepose.identification.posterior.spike_slab import SpikeSlab
from truepose.identification.posterior.state import State

SESSIONS, ROWS = 4, 9
SCALE = np.array([0.5, 2.0, 10.0])
SIGMA_STEPS = np.array([1.0, 2.0, 0.5])
PRIOR = Prior(
    ("a", "fixed", "b", "c"),
    np.array([1.0, 9.0, 2.0, 3.0]),
    np.array([0.5, 0, 4, 5]),
    np.insert(SCALE, 1, 1.0),
    ("length", "length", "angle", "frame"),
)
CLASSES = tuple(PartClass(kind) for kind in ("length", "angle", "frame"))
KINDS = Kinds(("a", "b", "c"), np.array([False, False, True]))
UNITS = {"a": "mm", "b": "rad", "c": "mm"}
TIMES = (100.0, 160.0, 340.0, 400.0)


def stacked(seed: int, moving: Array | None = None) -> Stack:
    """Sessions seen at random; ``moving`` (K,) is what the second parameter does, in steps."""
    rng = np.random.default_rng(seed)
    jacobian = 3.0 * rng.standard_normal((SESSIONS, ROWS, 3))
    offset = rng.standard_normal((SESSIONS, ROWS)) - jacobian @ (rng.standard_normal(3) * SIGMA_STEPS)
    if moving is not None:
        offset = offset - jacobian[:, :, 1] * moving[:, None]
    return Stack(jacobian, offset, SESSIONS * ROWS, SIGMA_STEPS, CLASSES)


def plain(jacobian: Array, offset: Array, sigma: float = 1.0) -> Stack:
    """Lengths of one tolerance (steps)."""
    n = jacobian.shape[2]
    return Stack(jacobian, offset, offset.size, np.full(n, sigma), (PartClass("length"),) * n)


def at(problem: SpikeSlab, noise: float = 1.0, widening: int = 0) -> GridPoint:
    """The point of the grid nearest to a noise."""
    values = np.array(problem.unknowns.noise[0].values)
    return GridPoint((int(np.argmin(np.abs(np.log(values / noise)))),), widening)


def likeliest_of(
    stack: Stack, moving: Mapping[int, float], noise: float = 1.0, widening: int = 0, kinds: Kinds = KINDS
) -> Likeliest:
    """What moves, and how far in usual movements, said rather than found."""
    problem = movement_problem(stack, kinds)
    log = np.log(problem.sizes.values)
    members = [(i, int(np.argmin(np.abs(log - np.log(size))))) for i, size in moving.items()]
    return Likeliest(stack, problem, State(tuple(sorted(members)), at(problem, noise, widening), 0.0))


def said(top: Likeliest, probability: Sequence[float], kinds: Kinds = KINDS) -> MovementPosterior:
    """A posterior with these probabilities."""
    own = np.array(probability)
    alike = {i: {2: 1.5} for i in top.moved}
    return MovementPosterior(top, own, own, 2.0 * own, alike, 0.0, 1.0, kinds.extrinsic)


def covariance_of(top: Likeliest) -> Array:
    """(K n, K n) prior covariance of all sessions' parameters in steps, written out in full."""
    stack, n = top.stack, top.stack.jacobian.shape[2]
    unknowns, k = top.spike_slab.unknowns, len(stack.jacobian)
    classes = tuple(dict.fromkeys(stack.classes))
    factors = [unknowns.widening[top.state.point.widening][classes.index(c)] for c in stack.classes]
    prior = np.kron(np.ones((k, k)), np.diag((stack.sigma * factors) ** 2))
    for i, size in top.state.members:
        one = np.zeros((n, n))
        one[i, i] = (top.spike_slab.sizes.values[size] * stack.unit[i]) ** 2
        prior += np.kron(np.eye(k) - 1.0 / k, one)
    return np.asarray(prior, dtype=np.float64)


def dense(top: Likeliest) -> tuple[Array, Array]:
    """Posterior mean and covariance of all sessions' parameters (K n), by conditioning one Gaussian on the readings."""
    prior, seen = covariance_of(top), block_diag(*top.stack.jacobian)
    noise = top.noise**2 * np.eye(len(seen))
    gain = prior @ seen.T @ np.linalg.inv(seen @ prior @ seen.T + noise)
    mean, covariance = gain @ -top.stack.offset.ravel(), prior - gain @ seen @ prior
    return np.asarray(mean, dtype=np.float64), np.asarray(covariance, dtype=np.float64)


def distance_rows(n: int, sessions: int, rng: np.random.Generator) -> tuple[pd.DataFrame, NDArray[np.intp]]:
    """Return poses whose changes of distance count from the row before, in sessions; the first of each counts from itself."""
    rows = pd.DataFrame(rng.uniform(-3.0, 3.0, (n, 3)), columns=["x", "y", "t"])
    session = np.arange(n) // (n // sessions)
    origin = np.where(np.arange(n) % (n // sessions) == 0, np.arange(n), np.arange(n) - 1)
    return rows.assign(pose=np.arange(n), **{"from": origin}, session=session, dL=0.0), origin
