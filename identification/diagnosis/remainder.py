"""What is left after the named effects: driver, place and form; a hypothesis, labelled so."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from truepose.identification.diagnosis.alarms import Structure
from truepose.identification.diagnosis.candidates import Catalogue
from truepose.identification.diagnosis.result import Finding, Remainder
from truepose.identification.diagnosis.unnamed import Unnamed
from truepose.identification.fit.estimate import Estimate
from truepose.identification.recording.recording import Recording
from truepose.models.driver import APPROACH, Driver


def describe(fit: Estimate, recording: Recording, structure: Structure) -> Remainder:
    """Driver and form of the strongest dependence found by the structure tests."""
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    driver, told = structure.driver, Driver.of(structure.driver)
    values = _values(fit, recording, driver)
    place = (driver,) if driver in recording.joints else ()
    if told.thermal or told.kind == APPROACH:
        place = (told.place,)
    form = (
        "varies with the order of acquisition"
        if values is None
        else _form(fit.residual[fit.used], values, driver)
    )
    return Remainder(
        place, driver, f"{form}; explains {100 * structure.share:.0f} % of the remainder; hypothesised", size
    )


def pile(names: Sequence[Finding], fit: Estimate, structure: Structure) -> Remainder:
    """What several names together stand in for, none of which is believed: at the part that all share, if any."""
    size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
    alike = ", ".join(f"{f.effect} at {'+'.join(f.place)}" for f in names)
    form = f"looks like {alike} together, more likely one thing without a name; hypothesised"
    shared = tuple(part for part in names[0].place if all(part in f.place for f in names))
    return Remainder(shared or names[0].place, structure.driver, form, size)


def unnamed(cat: Catalogue, accepted: Iterable[int], fit: Estimate) -> Remainder | None:
    """The strongest rival without a name among accepted terms, if there is one."""
    for index in accepted:
        placed = cat.candidates[index]
        if isinstance(placed.effect, Unnamed):
            driver, form = placed.effect.describe(placed.settings_map)
            size = float(np.sqrt(max(fit.chi2_per_dof, 0.0)))
            return Remainder(placed.place, driver, f"{placed.place[0]} errs as {form}; hypothesised", size)
    return None


def _values(fit: Estimate, recording: Recording, driver: str) -> NDArray[np.float64] | None:
    """(n,) the driver at the fitted rows; None for the order of rows."""
    if driver in recording.joints:
        return recording.q[fit.used][:, recording.joints.index(driver)]
    found = recording.driver(driver) if driver != "order" else None
    return None if found is None else found[fit.used]


def _form(residual: np.ndarray, values: np.ndarray, driver: str) -> str:
    """Best of a few simple shapes of the residuals against the driver."""
    span = float(np.ptp(values))
    t = 2 * (values - values.min()) / span - 1 if span else np.zeros(len(values))
    shapes = {f"linear in {driver}": [t], f"bent (quadratic) in {driver}": [t, t**2]}
    for cycles in (1, 2, 3, 4, 6, 8):
        w = np.pi * cycles * t
        shapes[f"periodic in {driver}, about {cycles} periods over its range"] = [np.sin(w), np.cos(w)]
    if len(np.unique(values)) <= 3:
        return f"steps with {driver}"
    best, score = "", -np.inf
    for name, functions in shapes.items():
        basis, _ = np.linalg.qr(np.column_stack([np.ones(len(t)), *functions]))
        gain = float(np.sum((basis[:, 1:].T @ residual) ** 2)) - 2.0 * len(functions) * residual.shape[1]
        if gain > score:
            best, score = name, gain
    return best
