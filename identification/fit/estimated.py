"""The result of a fit: constants with their covariance, residuals, and what the readings alone determine.

What every result of a fit offers: the machine that was found, its predictions and its residuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from truepose.arrays import Array, Index, Mask
from truepose.errors import InputError
from truepose.identification.fit.decomposition import Decomposition, moved_by
from truepose.identification.fit.leastsquares import Solution
from truepose.identification.fit.noise import Scatter, channel_groups
from truepose.identification.fit.problem import Prior
from truepose.identification.fit.relinearised import Shrunk
from truepose.identification.fit.turn import Turn, Turned
from truepose.identification.prediction.sensor_rows import Block
from truepose.identification.recording.load import Sources
from truepose.identification.recording.recording import Recording
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine
from truepose.shown.result import Declared, Shown

if TYPE_CHECKING:
    import pandas as pd


machine_of: Declared[Machine] = Declared("an estimate, a calibration or a diagnosis")
predicted_frame: Declared[pd.DataFrame] = Declared("an estimate, a calibration or a diagnosis")
residual_frame: Declared[pd.DataFrame] = Declared("an estimate, a calibration or a diagnosis")


class Fitted(Shown):
    """A result that stands for the machine it found, wherever a function takes a machine."""

    @cached_property
    def machine(self) -> Machine:
        """The machine as it is read from the file that is written: constants, effects and covariance. Raises InputError."""
        return machine_of(self)

    def predict(self, rows: Recording | Sources) -> pd.DataFrame:
        """Predict readings and poses of the machine that was found, with the columns of ``truepose.predict``."""
        return predicted_frame(self, rows)

    @property
    def residuals(self) -> pd.DataFrame:
        """Prediction minus reading of each channel, in the machine file's units; ``fitted``: whether the row was fitted.

        The index is that of ``Recording.to_frame``. NaN where a row cannot be assembled.
        """
        return residual_frame(self)


UNKNOWN = 1e15
"""1-sigma, in steps, of a direction that nothing determines."""


@dataclass(frozen=True, repr=False)
class Estimate(Fitted):
    """Result of a fit.

    nominal: the machine that the fit started from, with the values of its file; recording: its rows. p (np,) parameters then
    effect coefficients, x (n, nx) passive coordinates, residual (n, m) whitened by sigma (NaN where a row cannot be
    assembled), used (n,) rows that were fitted, weights (n,) of the robust loss, factor: triangular factor of [J r] of the
    readings, columns scaled by ``prior.scale`` and restricted to ``prior.free``, or by the fewer steps of long series that
    were solved for (``turn``).
    ``to_frame()``: free constants, one a row: ``parameter``, ``value``, ``std`` (1-sigma), ``nominal`` (of the drawing),
    ``unit``, ``tolerance``, ``in_tolerances`` ((value - nominal) / tolerance), ``identifiable``. mm, rad; coefficients of
    effects follow in their own units. std is inf where neither readings nor tolerances hold.
    """

    nominal: Machine
    recording: Recording
    effects: tuple[PlacedEffect, ...]
    prior: Prior
    p: Array
    x: Array
    residual: Array
    used: Mask
    weights: Array
    factor: Array
    solution: Solution
    unassembled: tuple[int, ...]
    shrunk: Shrunk | None = None
    """What a linear (biased) estimator knows of itself; it has no prior, and its variance is not J'J's."""
    levels: int = 0
    """Unknowns that compared rows share; they cost readings."""
    lost: Mask | None = None
    """(n, m) channels whose reading was lost, with a residual of zero; None where none was."""
    parts: tuple[Array, ...] = ()
    """``factor`` of each sensor's kinds of reading alone, where there are several (``noise.channel_groups``)."""
    noise: float = 1.0
    """Readings counted as so many times noisier than stated: ``prior`` then holds tolerances over it, which is the same."""
    turn: Turn | None = None
    """From the steps that were solved for to those of the free entries; None where they are the same."""

    def lost_among(self, rows: Mask | Index) -> Mask | None:
        """(k, m) channels of some rows whose reading was lost; None where none was."""
        return None if self.lost is None else self.lost[rows]

    @property
    def prior_weight(self) -> Array:
        """(n,) scale over tolerance of each free entry; 0 without a prior."""
        free = self.prior.free
        return np.where(
            np.isinf(self.prior.sigma[free]), 0.0, self.prior.scale[free] / self.prior.sigma[free]
        )

    @cached_property
    def decomposition(self) -> Decomposition:
        """What readings and prior know of the free entries, in steps of ``prior.scale``: one SVD."""
        if self.turn is not None:
            return Turned.by(self.factor[:, :-1], self.prior_weight, self.turn)
        return Decomposition.of(self.factor[:, :-1], self.prior_weight)

    @property
    def slopes(self) -> Array:
        """(k, n_free) a factor of the readings' J by the free entries."""
        return self.factor[:, :-1] if self.turn is None else self.factor[:, :-1] @ self.turn.matrix.T

    @property
    def known(self) -> Decomposition | Shrunk:
        """Whose root and unknown directions are this estimate's: readings and prior, or a biased estimator."""
        return self.decomposition if self.shrunk is None else self.shrunk

    @property
    def step_root(self) -> Array:
        """(steps, k) ``known.root`` by the steps that were solved for: of a long series as much of it as readings see."""
        known = self.known
        return known.own.root if isinstance(known, Turned) else known.root

    def by_steps(self, block: Block) -> Array:
        """(n, m, k) derivative of a block's residuals by the steps that were solved for; times ``step_root`` it is that
        by independent unknowns of 1-sigma one."""
        free, scale = self.prior.free, self.prior.scale
        if self.turn is None:
            return np.asarray(block.jacobian[:, :, free] * scale[free])
        return self.turn.of_block(block, free, scale)

    @cached_property
    def scatter(self) -> Scatter:
        """The noise that the fitted readings were found to have, by sensor and kind of reading."""
        if not self.used.any():
            return Scatter((1.0,) * max(len(self.parts), 1))
        residual = self.residual[self.used]
        groups, taken = [list(range(residual.shape[1]))], [self.effective_parameters]
        if len(self.parts) > 1 and self.shrunk is None:
            groups = list(channel_groups(self.nominal).values())
            taken = [self.decomposition.share(part[:, :-1]) for part in self.parts]
        levels = [self.levels * len(at) / residual.shape[1] for at in groups]
        used = [a + b for a, b in zip(taken, levels, strict=True)]
        return Scatter.of(residual, self.weights[self.used], groups, used)

    @cached_property
    def root(self) -> Array:
        """(n_free, k) F, in steps of ``prior.scale``: F F' is the covariance of what is determined, with the noise found."""
        if self.noise != 1.0:
            return np.asarray(self.noise * self.known.root)
        found = self.scatter
        if found.as_stated:
            return self.known.root
        if self.shrunk is not None:
            return np.asarray(np.sqrt(found.variance[0]) * self.shrunk.root)
        pairs = zip(found.variance, self.parts or (self.factor,), strict=True)
        return self.decomposition.root_with(found.slope, [np.sqrt(v) * part[:, :-1] for v, part in pairs])

    @property
    def posterior(self) -> Array:
        """(n_free, n_free) covariance if every sigma were as stated and the loss plain."""
        return self.posterior_among(np.arange(len(self.prior.free)))

    def posterior_among(self, at: Index | Mask) -> Array:
        """(k, k) the same of some free entries."""
        return self._spread(self.known.root, at)

    @property
    def covariance(self) -> Array:
        """(n_free, n_free) covariance with the noise found; directions nothing determines have a variance of 1e30.

        Tolerances are taken as stated; readings as noisy as they were (``truepose.identification.fit.noise``).
        """
        return self.covariance_among(np.arange(len(self.prior.free)))

    def covariance_among(self, at: Index | Mask) -> Array:
        """(k, k) the same of some free entries."""
        return self._spread(self.root, at)

    def _spread(self, root: Array, at: Index | Mask) -> Array:
        scale = self.prior.scale[self.prior.free][at, None]
        out = np.hstack([root[at], UNKNOWN * self.known.unknown.T[at]]) * scale
        return np.asarray(out @ out.T)

    @property
    def std(self) -> Array:
        """(np,) 1-sigma with the noise found; 0 for what is fixed.

        What a direction that nothing determines moves by less than a thousandth of its step counts as determined, as it
        does in ``identifiable``; in the covariance it is exact.
        """
        out, unknown = np.zeros(len(self.p)), self.known.unknown
        loose = np.where(moved_by(unknown), np.sum(unknown**2, axis=0), 0.0)
        spread = np.sum(self.root**2, axis=1) + UNKNOWN**2 * loose
        out[self.prior.free] = np.sqrt(spread) * self.prior.scale[self.prior.free]
        return out

    @property
    def null_space(self) -> Array:
        """(k, n_free) directions, in steps of ``prior.scale``, that the readings alone cannot see."""
        return self.decomposition.null_space

    @property
    def rank(self) -> int:
        """How many directions of the free parameters the readings determine."""
        return self.decomposition.rank

    @property
    def effective_parameters(self) -> float:
        """Trace of the readings' share of the information: degrees of freedom that were really used."""
        return self.known.effective

    @property
    def n_observations(self) -> int:
        """Number of fitted readings, less the levels that compared rows share."""
        return int(np.sum(self.residual[self.used] != 0.0)) - self.levels

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals of the fitted rows."""
        return float(np.sum(self.residual[self.used] ** 2))

    @property
    def chi2_per_dof(self) -> float:
        """chi2 over readings less effective parameters."""
        return self.chi2 / max(self.n_observations - self.effective_parameters, 1.0)

    @property
    def in_tolerances(self) -> Array:
        """(np,) (estimate - nominal) / drawing tolerance; 0 where the tolerance is zero or infinite."""
        nominal = np.array([p.nominal for p in self.nominal.parameters])
        tolerance = np.array([p.tolerance for p in self.nominal.parameters])
        ok = (tolerance > 0) & np.isfinite(tolerance)
        out = np.zeros(len(self.p))
        out[: len(ok)][ok] = (self.p[: len(ok)][ok] - nominal[ok]) / tolerance[ok]
        return out

    @property
    def worst_parameter_sigma(self) -> float:
        """Largest |estimate - nominal| / tolerance."""
        return float(np.max(np.abs(self.in_tolerances), initial=0.0))

    def fitted_effects(self) -> tuple[PlacedEffect, ...]:
        """The effects with their estimated coefficients."""
        offset, out = len(self.nominal.parameters), []
        for effect in self.effects:
            size = len(effect.coefficients)
            out.append(effect.with_values(self.p[offset : offset + size].tolist()))
            offset += size
        return tuple(out)


def check_estimate(given: object) -> None:
    """Raise InputError for what is no estimate: a calibration and a diagnosis hold several."""
    if not isinstance(given, Estimate):
        raise InputError(
            f"estimate: found {type(given).__name__}, expected an Estimate, such as calibration.fit or diagnosis.after"
        )
