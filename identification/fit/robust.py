"""Huber's loss on whole rows, by least squares that are weighed again until the weights settle."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from truepose.arrays import Array
from truepose.identification.fit.leastsquares import Solution
from truepose.identification.fit.problem import Problem
from truepose.identification.prediction.lost import told

HUBER = 1.345
REWEIGHTINGS = 12
SETTLED = 3e-3


def robust(problem: Problem, loss: str, solve: Callable[[Array], Solution]) -> Solution:
    """The minimum from scaled steps of zero: of plain least squares (``gauss``), or with ``problem.weights`` of the loss."""
    solution = solve(problem.nothing)
    if loss == "gauss":
        return solution
    for _ in range(REWEIGHTINGS):  # far rows may be why plain least squares found no rest
        squares = problem.residuals(problem.at(solution.t), problem.x) ** 2
        size = np.sqrt(np.sum(squares, axis=1) / told(squares, problem.lost))
        scale = max(float(np.median(size[problem.used])), 1e-300)
        weights = np.minimum(1.0, HUBER * 1.2 * scale / np.maximum(size, 1e-300))
        settled = np.max(np.abs(weights - problem.weights)[problem.used]) < SETTLED
        problem.weights = weights
        solution = solve(solution.t)
        if settled:
            break
    return solution


__all__ = ["robust"]
