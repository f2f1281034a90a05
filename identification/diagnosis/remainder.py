"""What is left after the named effects: driver, place and form; a hypothesis, labelled so."""

from __future__ import annotations

import numpy as np

from truepose.identification.diagnosis.alarms import Structure
from truepose.identification.diagnosis.result import Form, Remainder
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.driver import APPROACH, Driver
from truepose.models.effects.empirical import Empirical
from truepose.models.smooth import orthonormal, powers, scaled, waves

CYCLES = (1, 2, 3, 4, 6, 8)
"""Cycles over a driver's range that a periodic form may have."""


def describe(fit: Estimate, recording: Recording, structure: Structure) -> Remainder:
    """Driver and form of the strongest dependence found by the structure tests."""
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    driver, told = structure.driver, Driver.of(structure.driver)
    values = recording.columns().get(driver)
    place = (driver,) if driver in recording.joints else ()
    if told.thermal or told.kind == APPROACH:
        place = (told.place,)
    kind, cycles = ("order", 0) if values is None else best_shape(fit.residual[fit.used], values[fit.used])
    return Remainder(place, driver, Form(kind, structure.share, cycles), size)


def of_form(cat: Catalogue, index: int, fit: Estimate) -> Remainder:
    """A form without a name: where, and what it is a function of."""
    placed = cat.candidates[index]
    assert isinstance(placed.effect, Empirical)
    driver, kind = placed.effect.describe(placed.settings_map)
    return Remainder(placed.place, driver, Form(kind), float(np.sqrt(max(fit.chi2_per_dof, 0.0))))


def best_shape(residual: np.ndarray, values: np.ndarray) -> tuple[str, int]:
    """Best of a few simple shapes of the residuals against the driver: its kind, and how many cycles."""
    if len(np.unique(values)) <= 3:
        return "steps", 0
    t = scaled(values, float(values.min()), float(values.max()))
    shapes = {("linear", 0): powers(t, 1), ("quadratic", 0): powers(t, 2)}
    shapes |= {("periodic", cycles): waves(t, cycles) for cycles in CYCLES}
    best, score = ("linear", 0), -np.inf
    for shape, functions in shapes.items():
        explained = float(np.sum((orthonormal(functions).T @ residual) ** 2))
        gain = explained - 2.0 * len(functions) * residual.shape[1]
        if gain > score:
            best, score = shape, gain
    return best
