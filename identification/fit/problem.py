"""The least-squares problem of a machine and a recording: a prior, and whitened blocks that a solver folds.

``prior_of`` reads the tolerances; ``Problem`` gives rows of [J r] at scaled steps from a start. What a solver
makes of them is not known here.

The readings' share of a large fit as a few rows: their normal equations, summed by compiled code.

Only for machines whose pose is an explicit expression of the readings, before sensors whose readings stand for
themselves, with recordings that are worth a compiler. Normal equations square the condition number. They serve steps
alone, and only where the tolerances outweigh their rounding; rank, null space and covariance come from the readings
row by row (``Problem.data``).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.codegen.evaluation import batch
from truepose.codegen.evaluation.gram import GramFunction
from truepose.errors import InputError
from truepose.identification.fit.leastsquares import WIDE_PROBLEM, Rows
from truepose.identification.fit.turn import Turn, turn_of
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.prior import LONG
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

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
        if predictor.evaluations < batch.FEWEST_ROWS:
            return None
        key = tuple(free.tolist())
        if key not in predictor.sums:
            predictor.sums[key] = _sums(predictor, free)
        function = predictor.sums[key]
        columns = [recording.observations[name] for sensor in machine.sensors for name in sensor.columns]
        inputs = predictor.q, predictor.z, np.column_stack(columns)
        return cls(function, inputs) if function.engine.compiled else None

    def rows(self, p: Array, weight: Array, scale: Array, least: float) -> Array | None:
        """(n_free + 1, n_free + 1) rows of [J r] with the sums of all of them, J by steps of ``scale`` (n_free,).

        p (np,) parameters; weight (n,) of each row; least: the smallest information that the prior has of a step.
        None where rounding of the sums could be seen beside it, or where they could not be compiled.
        """
        if least <= 0.0:
            return None
        gram = self.function(*self.inputs, p, weight=weight)
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


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of every entry of p: mean, 1-sigma (0 fixed, inf none), scale of step, class of part."""

    names: tuple[str, ...]
    mean: Array
    sigma: Array
    scale: Array
    parts: tuple[str, ...]

    @property
    def free(self) -> Index:
        """(n,) indices of what is estimated."""
        return np.flatnonzero(self.sigma > 0)

    def with_sigma(self, sigma: Array) -> Prior:
        """The same parameters with other tolerances (np,)."""
        return replace(self, sigma=sigma)


def prior_of(machine: Machine, effects: Sequence[PlacedEffect] = ()) -> Prior:
    """Tolerances for geometry; for effects their spread, by default 100 times their largest size; 0 holds them at their values.

    Raises InputError where everything is exactly known, as in a file that states no tolerance: nothing to fit.
    """
    parameters = machine.parameters
    names = [p.name for p in parameters]
    mean, sigma = [p.nominal for p in parameters], [p.tolerance for p in parameters]
    scale, parts = [p.scale for p in parameters], [p.part for p in parameters]
    for effect in effects:
        names += effect.parameter_names
        for c, value in zip(effect.coefficients, effect.amplitudes, strict=True):
            mean.append(0.0 if effect.spread > 0.0 else value)
            sigma.append(effect.spread * c.scale)
            scale.append(c.scale)
            parts.append("effect")
    if not any(size > 0.0 for size in sigma):
        where = f"{machine.file.path}: tolerances" if machine.file else machine.name
        raise InputError(
            f"{where}: found no free parameter, expected a tolerance above 0 for at least one, "
            "such as 'tolerances: {length: 0.1, angle: 0.1}'"
        )
    return Prior(tuple(names), np.array(mean), np.array(sigma), np.array(scale), tuple(parts))


class Problem:
    """The whitened least-squares problem in scaled steps t (n_free,) from p (np,): readings, then prior.

    ``used`` (n,) are the rows that are fitted (a row whose every reading was lost is none of them), ``lost`` (n, m) the
    channels that read nothing (None: all read), ``weights`` (n,) those of a robust loss, ``x`` (n, nx) the passive
    coordinates at the latest step. ``slim``: steps of long series are those that the readings see, fewer than n_free: ``turn``,
    of a fit that begins at ``p``, or worked out. Raises InputError when there are too few readings.
    """

    def __init__(
        self, predictor: Predictor, prior: Prior, p: Array, used: Mask, *, slim: bool = False,
        turn: Turn | None = None,
    ) -> None:  # fmt: skip
        self.predictor, self.prior, self.p, self.used = predictor, prior, p, used
        self.weights = np.ones(len(used))
        self.x, good = predictor.assemble(p)
        self.assembled = good
        self.unassembled = tuple(int(k) for k in np.flatnonzero(~good & used))
        self.used = used & good
        self.lost = predictor.lost
        if self.lost is not None:
            self.used &= ~self.lost.all(axis=1)
        self.levels = sum(c.unknowns for c in predictor.comparisons(self.used) if c is not None)
        """Unknowns that compared rows share (points of sockets): readings that say nothing of parameters."""
        gone = 0 if self.lost is None else int(self.lost[self.used].sum())
        self.n_observations = int(self.used.sum()) * len(predictor.channels) - gone - self.levels
        self._check_size()
        self.turn = turn
        if slim and turn is None:
            self._slim()
        self._normal = NormalEquations.of(predictor, prior.free) if self.turn is None else None

    def _slim(self) -> None:
        """Long series start where their prior is in what readings do not see, and stay there."""
        free, scale = self.prior.free, self.prior.scale[self.prior.free]
        places = {int(k): i for i, k in enumerate(free)}
        lengths = [len(effect.coefficients) for effect in self.predictor.model.effects]
        ends = np.cumsum([len(self.predictor.machine.parameters), *lengths])
        effects = [
            np.array([places[k] for k in range(a, b) if k in places], dtype=np.intp)
            for a, b in pairwise(ends)
        ]
        if len(free) < WIDE_PROBLEM or not any(len(at) > LONG for at in effects):
            return
        turn = turn_of(effects, self.data(self.p, self.x), scale / self.prior.sigma[free])
        if turn is None:
            return
        away = (self.p - self.prior.mean)[free] / scale
        self.p = self.p.copy()
        self.p[free] -= scale * (turn.rest @ (turn.rest.T @ away))
        self.turn = turn

    @property
    def nothing(self) -> Array:
        """The step of zeros: (n_free,), or as many as long series are solved for."""
        return np.zeros(len(self.prior.free) if self.turn is None else self.turn.matrix.shape[1])

    def lifted(self, t: Array) -> Array:
        """(n_free,) a step of the free entries."""
        return t if self.turn is None else np.asarray(self.turn.matrix @ t)

    def at(self, t: Array) -> Array:
        """(np,) parameters at a step."""
        p = self.p.copy()
        p[self.prior.free] += self.prior.scale[self.prior.free] * self.lifted(t)
        return p

    def blocks(self, t: Array) -> Iterable[Rows]:
        """Rows of [J r] (k, n_free + 1) of readings and prior; NaN where a used row cannot be assembled."""
        p = self.at(t)
        x, good = self.predictor.assemble(p, self.x)
        if not good[self.used].all():
            yield np.full((1, len(t) + 1), np.nan)
            return
        self.x = np.where(good[:, None], x, self.x) if x.shape[1] else x
        few = self._few_rows(p)
        yield from self.data(p, self.x) if few is None else few
        yield self.prior_rows(p)

    def _few_rows(self, p: Array) -> list[Rows] | None:
        """Rows of [J r] with the sums of all readings, where they are many and steps cannot tell the difference.

        The sums are of rows without a loss; the others follow.
        """
        if self._normal is None:
            return None
        free = self.prior.free
        scale = self.prior.scale[free]
        least = float(np.min((scale / self.prior.sigma[free]) ** 2, initial=np.inf))
        gone = np.zeros_like(self.used) if self.lost is None else self.lost.any(axis=1)
        rows = self._normal.rows(p, self.used * ~gone * self.weights, scale, least)
        if rows is None:
            self._normal = None
            return None
        at = np.flatnonzero(self.used & gone)
        return [rows, *self._rows(self.predictor.of_rows(at), p, self.x[at], at)] if at.size else [rows]

    def data(self, p: Array, x: Array) -> Iterable[Rows]:
        """Blocks (rows, k + 1) of [J r] of the readings alone, J by the k steps, at ``p`` (np,) and ``x`` (rows, nx)."""
        predictor, at = self._fitted
        return self._rows(predictor, p, x[at], at)

    @cached_property
    def _fitted(self) -> tuple[Predictor, Index]:
        """The predictor of the rows (k,) that are fitted; of all where readings compare rows."""
        every = any(sensor.compares for sensor in self.predictor.machine.sensors)
        at = np.flatnonzero(self.used | every)
        return (self.predictor if len(at) == len(self.used) else self.predictor.of_rows(at)), at

    def _rows(self, predictor: Predictor, p: Array, x: Array, at: Index) -> Iterable[Rows]:
        """The same of a predictor for the rows ``at``."""
        free, used, weights = self.prior.free, self.used[at], self.weights[at]
        root = np.sqrt(weights)
        place = np.full(len(p), -1)
        place[free] = np.arange(len(free))
        for block in predictor.blocks(p, x, used * weights):
            rows = np.flatnonzero(used[block.rows])
            part = block.part(rows, place, self.prior.scale, root[block.rows][rows])
            if part is not None and len(free) >= WIDE_PROBLEM:
                if self.turn is not None:
                    part, columns = self.turn.of_part(part), len(self.nothing) + 1
                    if columns <= WIDE_PROBLEM:  # so few steps are left that a factor of the rows pays
                        yield part.written(columns).reshape(-1, columns)
                        continue
                yield part
                continue
            w = root[block.rows][rows, None]
            jacobian = block.jacobian[rows][:, :, free] * self.prior.scale[free] * w[..., None]
            stacked = np.concatenate([jacobian, (block.residual[rows] * w)[..., None]], axis=2)
            flat = stacked.reshape(-1, len(free) + 1)
            yield flat if self.turn is None else self.turn.of_rows(flat)

    def prior_rows(self, p: Array) -> Array:
        """(n, k + 1) rows of [J r] of the tolerances, one for each free parameter, at ``p`` (np,)."""
        free = self.prior.free
        sigma = self.prior.sigma[free]
        weight = np.where(np.isinf(sigma), 0.0, self.prior.scale[free] / sigma)
        pull = np.where(np.isinf(sigma), 0.0, (p[free] - self.prior.mean[free]) / sigma)
        if self.turn is not None:  # along what readings do not see there is no pull
            weight, pull = self.turn.of_prior(weight, pull)
        return np.column_stack([np.diag(weight), pull])

    def residuals(self, p: Array, x: Array) -> Array:
        """(n, m) whitened residuals of all rows."""
        blocks = self.predictor.blocks(p, x, self.used * self.weights)
        return np.concatenate([block.residual for block in blocks])

    def residuals_of(self, rows: Mask, p: Array, x: Array) -> Array:
        """(n, m) the same of some rows (n,); NaN in others, unless readings compare rows."""
        sensors = self.predictor.machine.sensors
        if any(sensor.compares or sensor.differs_from_row for sensor in sensors):
            return self.residuals(p, x)
        at, out = np.flatnonzero(rows), np.full((len(rows), len(self.predictor.channels)), np.nan)
        if at.size:
            blocks = self.predictor.of_rows(at).blocks(p, x[at])
            out[at] = np.concatenate([block.residual for block in blocks])
        return out

    def _check_size(self) -> None:
        recording = self.predictor.recording
        known = int(np.sum(np.isfinite(self.prior.sigma[self.prior.free])))
        free = len(self.prior.free)
        if self.n_observations < free - known or self.n_observations == 0:
            raise InputError(
                f"{', '.join(recording.files)}: found {int(self.used.sum())} usable rows "
                f"({self.n_observations} readings), expected at least as many readings as the {free - known} "
                "parameters without a finite tolerance"
            )
