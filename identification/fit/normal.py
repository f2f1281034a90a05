"""The readings' share of a large fit as a few rows: their normal equations, summed by compiled code.

Only for machines whose pose is an explicit expression of the readings, before sensors whose readings stand for
themselves, with recordings that are worth a compiler. Normal equations square the condition number. They serve steps
alone, and only where the tolerances outweigh their rounding; rank, null space and covariance come from the readings
row by row (``Problem.data``).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation import engine
from truepose.codegen.evaluation.gram import GramFunction
from truepose.identification.prediction.predictor import Predictor

MARGIN = 10.0
"""How far the tolerances' information on any parameter is above the rounding of the readings' sums.

A step is then wrong by a tenth at most, where tolerances alone decide; the next one starts from exact residuals.
"""


@dataclass(frozen=True)
class NormalEquations:
    """function: sums of [J r] of the whitened readings by the free parameters, at inputs (q, z, y) of every row."""

    function: GramFunction
    inputs: tuple[Array, Array, Array]

    @classmethod
    def of(cls, predictor: Predictor, free: Index) -> NormalEquations | None:
        """Of parameters ``free`` (n,); None where rows are few, loops have to be closed, or rows are compared."""
        machine, recording = predictor.machine, predictor.recording
        if len(predictor.model.home) or any(sensor.compares for sensor in machine.sensors):
            return None
        if predictor.evaluations < engine.FEWEST_ROWS:
            return None
        key = tuple(free.tolist())
        if key not in predictor.sums:
            predictor.sums[key] = _sums(predictor, free)
        function = predictor.sums[key]
        columns = [recording.observations[name] for sensor in machine.sensors for name in sensor.columns]
        return (
            cls(function, (predictor.q, predictor.z, np.column_stack(columns)))
            if function.engine.compiled
            else None
        )

    def rows(self, p: Array, weight: Array, scale: Array, least: float) -> Array | None:
        """(n_free + 1, n_free + 1) rows of [J r] with the sums of all of them, J by steps of ``scale`` (n_free,).

        p (np,) parameters; weight (n,) of each row; least: the smallest information that the prior has of a step.
        None where rounding of the sums could be seen beside it, or where they could not be compiled.
        """
        if least <= 0.0:
            return None
        gram = self.function(*self.inputs, p, weight=weight).matrix
        steps = np.append(scale, 1.0)
        gram *= np.outer(steps, steps)
        rounding = float(np.finfo(float).eps * len(gram) * np.max(np.diag(gram)[:-1], initial=0.0))
        if not self.function.engine.compiled or not MARGIN * rounding < least:
            return None
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        values, vectors = np.linalg.eigh(gram / np.outer(size, size))
        rows: Array = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
        return rows


def _sums(predictor: Predictor, free: Index) -> GramFunction:
    model, places = predictor.model, {name: k for k, name in enumerate(predictor.model.names)}
    count = sum(len(sensor.columns) for sensor in predictor.machine.sensors)
    y, residuals, first = ca.SX.sym("y", count), list[ca.SX](), 0
    for sensor in predictor.machine.sensors:
        own = [*(parameter.name for parameter in sensor.parameters), *sensor.reads]
        columns = slice(first, first + len(sensor.columns))
        first = columns.stop
        # what an effect adds to a reading is taken off the reading, as in ``readings``
        seen = y[columns] - model.reading_shift[columns]
        residual = sensor.residual(
            model.worlds[sensor.view], {name: model.p[places[name]] for name in own}, seen
        )
        residuals.append(residual / ca.DM([channel.sigma for channel in sensor.channels]))
    residual = ca.vertcat(*residuals)
    jacobian = ca.jacobian(residual, model.p)[:, free.tolist()]
    inputs = [model.q, model.z, y, model.p]
    return GramFunction("normal", inputs, residual, jacobian, rows=predictor.evaluations)


__all__ = ["NormalEquations"]
