"""Least squares without tolerances, on the parameters that the readings can tell; the others stay at the drawing.

The program chooses the parameters (``independent_subset``), from the exact Jacobian at the drawing. Use it to
reproduce calibrations of the literature, which list them by hand; for a calibration under tolerances use
``estimate``, which needs no choice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.estimated import Estimate
from truepose.identification.fit.leastsquares import triangular
from truepose.identification.fit.problem import Prior, prior_of
from truepose.identification.identifiability.observability import Columns, Subset, independent_subset
from truepose.identification.prediction.predictor import Predictor
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SubsetEstimate:
    """The fit, which parameters it chose, and the columns of the Jacobian it chose from (at the drawing)."""

    fit: Estimate
    subset: Subset
    columns: Columns


def columns_at_drawing(
    predictor: Predictor, effects: tuple[PlacedEffect, ...] = (), held: Callable[[str], bool] | None = None
) -> Columns:
    """Jacobian of the calibration rows by every parameter with a tolerance that is not ``held``."""
    prior = _kept(prior_of(predictor.machine, effects), held)
    free, p = prior.free, predictor.model.p_home
    x, good = predictor.assemble(p)
    used = good & ~predictor.recording.validation
    blocks = (
        (block.jacobian[used[block.rows]][:, :, free] * prior.scale[free]).reshape(-1, len(free))
        for block in predictor.blocks(p, x, used)
    )
    names = tuple(prior.names[k] for k in free)
    return Columns(names, triangular(blocks, len(free)), prior.scale[free])


def estimate_subset(
    predictor: Predictor,
    effects: tuple[PlacedEffect, ...] = (),
    *,
    least: float = 0.0,
    held: Callable[[str], bool] | None = None,
) -> SubsetEstimate:
    """Fit what the predictor's recording can tell.

    ``effects`` are the predictor's. ``least``: a parameter is chosen when what is new in its column is as long as so
    many sigmas of the readings for one step (its tolerance): 0.1 leaves out what would not be known to ten tolerances.
    ``held`` says which entries keep their value all the same. Raises InputError for too few readings,
    ConvergenceError where no minimum is found.
    """
    columns = columns_at_drawing(predictor, effects, held)
    subset = independent_subset(columns, least=least)
    prior = prior_of(predictor.machine, effects)
    chosen = set(subset.kept)
    sigma = np.array([np.inf if name in chosen else 0.0 for name in prior.names])
    fit = estimate(
        predictor.machine,
        predictor.recording,
        effects,
        prior=replace(prior, sigma=sigma),
        predictor=predictor,
    )
    return SubsetEstimate(fit, subset, columns)


def _kept(prior: Prior, held: Callable[[str], bool] | None) -> Prior:
    if held is None:
        return prior
    return replace(prior, sigma=np.where([held(name) for name in prior.names], 0.0, prior.sigma))


__all__ = ["SubsetEstimate", "columns_at_drawing", "estimate_subset"]
