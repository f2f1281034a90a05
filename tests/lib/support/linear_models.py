"""Random linear problems whose evidence can be counted in full, for laws of the posterior."""

from __future__ import annotations

import numpy as np

from support.effects import with_effect
from truepose.arrays import Array
from truepose.identification.diagnosis.selection_problem import SelectionProblem
from truepose.identification.fit.tolerance_classes import PartClass
from truepose.identification.posterior.design import GridPoint
from truepose.identification.signatures.candidates import Catalogue
from truepose.identification.signatures.linearisation import Linearisation
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

LENGTH, ANGLE = PartClass("length"), PartClass("angle")
READINGS = 60


def linear(
    placed: tuple[PlacedEffect, ...],
    seed: int = 1,
    *,
    sizes: tuple[float, ...] = (),
    weight: Array | None = None,
    departure: float = 0.0,
) -> tuple[Linearisation, Array, Array, Array]:
    """Random columns of three parts and of one column a candidate; J, G and the readings e at the drawing beside it."""
    rng, w = np.random.default_rng(seed), len(placed)
    j, g = rng.standard_normal((READINGS, 3)), rng.standard_normal((READINGS, w))
    own = np.ones(3) if weight is None else weight
    known = np.where(own > 0.0, 1.0 / np.where(own > 0.0, own, 1.0), 0.0)
    e = rng.standard_normal(READINGS) + j @ (known * rng.standard_normal(3))
    e = e + g[:, : len(sizes)] @ np.array(sizes) if sizes else e
    away = departure * rng.standard_normal(3 + w)
    # the residual of a reading is its prediction less itself
    rows = np.column_stack([j, g, np.column_stack([j, g]) @ away - e])
    columns = tuple(slice(k, k + 1) for k in range(w))
    lin = Linearisation((rows.T @ rows,), (READINGS,), 3, columns, away, own, (LENGTH, LENGTH, ANGLE), placed)
    return lin, j, g, e


def shifts_of(arm: Machine) -> tuple[PlacedEffect, ...]:
    """One effect of one coefficient at each joint, and another that can only have one sign."""
    own = [with_effect(arm, "zero-shift", (joint,), {"session": 1.0}) for joint in ("q1", "q2", "q3")]
    return (*own, with_effect(arm, "joint-compliance", ("q2",)))


def catalogue_of(placed: tuple[PlacedEffect, ...]) -> Catalogue:
    return Catalogue(placed, (-float(np.log(len(placed))),) * len(placed), ())


def unit(problem: SelectionProblem) -> GridPoint:
    """The point nearest to stated noise and tolerances."""
    values = np.array(problem.spike_slab.unknowns.noise[0].values)
    return GridPoint((int(np.argmin(np.abs(np.log(values)))),), 0)
