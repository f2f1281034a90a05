"""How wide tolerances have to be for a name to fall: where the odds of the name turn, written out."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from support.linear_models import LENGTH, READINGS, catalogue_of, unit
from truepose.identification import prior
from truepose.identification.diagnosis.posterior_summary import Named
from truepose.identification.diagnosis.proof import WIDENINGS, flip_inflation
from truepose.identification.diagnosis.search import Found
from truepose.identification.diagnosis.selection_problem import SelectionProblem, selection_problem
from truepose.identification.posterior.state import State, slot_odds
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.base import PlacedEffect

Array = NDArray[np.float64]


def test_a_name_falls_where_tolerances_are_wide_enough_to_stand_in_for_it(
    shifts: tuple[PlacedEffect, ...],
) -> None:
    """The widening told is the first at which the odds of the name, all else as in the mode, are below even."""
    told = []
    for size in (5.0, 12.0, 40.0, 4000.0):
        axes = np.linalg.qr(np.random.default_rng(4).standard_normal((READINGS, 3)))[0]
        along = np.cos(0.2) * axes[:, 0] + np.sin(0.2) * axes[:, 1]
        rows = np.column_stack([2.0 * axes[:, 0], 50.0 * along, -size * axes[:, 0]])
        lin = Linearisation(
            (rows.T @ rows,),
            (READINGS,),
            1,
            (slice(0, 1),),
            0,
            np.zeros(2),
            np.ones(1),
            (LENGTH,),
            shifts[:1],
        )
        problem = selection_problem(lin, catalogue_of(shifts[:1]), 1.5)
        values = problem.spike_slab.sizes.values
        state = State(((0, int(np.argmin(np.abs(np.log(values / (size / 50.0)))))),), unit(problem), 0.0)
        name = Named(problem.causes[0], (0,), 1.0, 1.0, (), 9.0)
        flip = flip_inflation(cast(Found, SimpleNamespace(problem=problem, mode=state)), name)
        worth = [_odds(problem, state, axes[:, 0], along, size, w) for w in WIDENINGS]
        needed = [odds > 0.0 for odds in worth]
        expected = None if needed[-1] else WIDENINGS[needed.index(False)]
        assert flip == expected
        told.append(flip)
    assert len(set(told)) > 2  # the sizes tell


def _odds(
    problem: SelectionProblem, state: State, part: Array, along: Array, size: float, width: float
) -> float:
    """Log odds of a term along ``along`` beside a part of this tolerance, in readings of ``size`` along the part."""
    ((term, own),) = state.members
    spread = float(problem.spike_slab.sizes.values[own])
    noise = problem.spike_slab.unknowns.noise[0].values[state.point.noise[0]]
    v = noise**2 * np.eye(READINGS) + (2.0 * width) ** 2 * np.outer(part, part)
    both = v + spread**2 * 50.0**2 * np.outer(along, along)
    gain = multivariate_normal.logpdf(size * part, cov=both) - multivariate_normal.logpdf(size * part, cov=v)
    share = float(problem.spike_slab.terms.log_first[term] + problem.spike_slab.sizes.log_prior[own])
    return float(gain) + share + slot_odds(prior.RICHNESS, 0)
