"""What is left after the named effects: driver, place and form; a hypothesis, labelled so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.alarms import Structure
from truepose.identification.diagnosis.result import Form, Remainder
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.identification.signatures.candidates import Catalogue
from truepose.models.driver import APPROACH, Driver
from truepose.models.effects.empirical import Empirical


def describe(fit: Estimate, recording: Recording, structure: Structure) -> Remainder:
    """Driver and form of the strongest dependence found by the structure tests."""
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    driver, told = structure.driver, Driver.of(structure.driver)
    values = _values(fit, recording, driver)
    place = (driver,) if driver in recording.joints else ()
    if told.thermal or told.kind == APPROACH:
        place = (told.place,)
    kind, cycles = ("order", 0) if values is None else best_shape(fit.residual[fit.used], values)
    return Remainder(place, driver, Form(kind, structure.share, cycles), size)


def of_form(cat: Catalogue, index: int, fit: Estimate) -> Remainder:
    """A form without a name: where, and what it is a function of."""
    placed = cat.candidates[index]
    assert isinstance(placed.effect, Empirical)
    driver, kind = placed.effect.describe(placed.settings_map)
    return Remainder(placed.place, driver, Form(kind), float(np.sqrt(max(fit.chi2_per_dof, 0.0))))


def _values(fit: Estimate, recording: Recording, driver: str) -> NDArray[np.float64] | None:
    """(n,) the driver at the fitted rows; None for the order of rows."""
    if driver in recording.joints:
        return recording.q[fit.used][:, recording.joints.index(driver)]
    found = recording.driver(driver) if driver != "order" else None
    return None if found is None else found[fit.used]


def best_shape(residual: np.ndarray, values: np.ndarray) -> tuple[str, int]:
    """Best of a few simple shapes of the residuals against the driver: its kind, and how many cycles."""
    span = float(np.ptp(values))
    t = 2 * (values - values.min()) / span - 1 if span else np.zeros(len(values))
    shapes = {("linear", 0): [t], ("quadratic", 0): [t, t**2]}
    for cycles in (1, 2, 3, 4, 6, 8):
        w = np.pi * cycles * t
        shapes["periodic", cycles] = [np.sin(w), np.cos(w)]
    if len(np.unique(values)) <= 3:
        return "steps", 0
    best, score = ("linear", 0), -np.inf
    for shape, functions in shapes.items():
        basis, _ = np.linalg.qr(np.column_stack([np.ones(len(t)), *functions]))
        gain = float(np.sum((basis[:, 1:].T @ residual) ** 2)) - 2.0 * len(functions) * residual.shape[1]
        if gain > score:
            best, score = shape, gain
    return best
