"""Calibration as one call: the estimate that was asked for, and the free fit beside it.

``estimator``: ``map`` holds parameters by their tolerances, ``ols`` trusts readings alone (directions they do
not see stay at the drawing), ``huber`` is ``map`` with a loss that bends for outliers. ``solver``: ``gn``
starts undamped, ``lm`` damped; where one finds no minimum the other is tried, and a note says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from truepose.errors import ConvergenceError, InputError
from truepose.identification.align import aligned_start
from truepose.identification.estimate import FREE_WIDENING, Estimate, Prior, estimate, prior_of
from truepose.identification.export import fit_json
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.models.machine import Machine
from truepose.models.units import close_matches

ESTIMATORS = ("map", "ols", "huber")
SOLVERS = {"gn": 0.0, "lm": 1e-4}
"""Initial damping."""


@dataclass(frozen=True)
class Calibration:
    """The fit, the free fit (None when it found no minimum), and what was fitted how."""

    fit: Estimate
    free: Estimate | None
    recording: Recording
    notes: tuple[str, ...]
    method: dict[str, str]

    @cached_property
    def fit_json(self) -> dict[str, Any]:
        """The content of ``fit.json``."""
        return fit_json(self.fit, self.recording, self.free, notes=self.notes, method=self.method)


def calibrate(
    machine: Machine,
    recording: Recording,
    *,
    estimator: str = "map",
    solver: str = "gn",
    progress: Callable[[str], None] = lambda _: None,
) -> Calibration:
    """Fit the machine with the effects of its file.

    Raises InputError for an estimator or solver that does not exist and for too few rows, ConvergenceError
    naming the parameters responsible.
    """
    _check("estimator", estimator, ESTIMATORS)
    _check("solver", solver, tuple(SOLVERS))
    progress("fitting")
    predictor = Predictor(machine, recording, machine.effects)
    start = aligned_start(predictor)
    loss = "huber" if estimator == "huber" else "gauss"
    fitting = partial(estimate, machine, recording, machine.effects, loss=loss, predictor=predictor)
    if estimator == "ols":
        # widening infinite tolerances only says that valleys may be flat
        flat = _flat(prior_of(machine, machine.effects))
        fit, notes = _either(partial(fitting, start=start, prior=flat, widen=FREE_WIDENING), solver)
    else:
        fit, notes = _either(partial(fitting, start=start), solver)
    progress("fitting without tolerances")
    free, more = _free_fit(partial(fitting, start=fit.p, widen=FREE_WIDENING), solver)
    notes = [*recording.notes, *_left_out(fit, recording), *notes, *more]
    return Calibration(fit, free, recording, tuple(notes), {"estimator": estimator, "solver": solver})


def _either(fitting: Callable[..., Estimate], solver: str) -> tuple[Estimate, list[str]]:
    """The fit by the solver asked for, by the other where that one finds no minimum."""
    try:
        return fitting(damping=SOLVERS[solver]), []
    except ConvergenceError as first:
        other = next(name for name in SOLVERS if name != solver)
        try:
            fit = fitting(damping=SOLVERS[other])
        except ConvergenceError:
            raise first from None
    return fit, [f"{solver} found no minimum, {other} did; this is its result"]


def _check(what: str, name: str, known: tuple[str, ...]) -> None:
    if name not in known:
        hint = close_matches(name, known)
        ending = f"; {hint}" if hint.startswith("did") else ""
        raise InputError(f"--{what}: found {name!r}, expected one of {', '.join(known)}{ending}")


def _flat(prior: Prior) -> Prior:
    """The same parameters without tolerances; what is exactly known stays so."""
    sigma: NDArray[np.float64] = np.where(prior.sigma > 0, np.inf, 0.0)
    return replace(prior, sigma=sigma)


def _free_fit(fitting: Callable[..., Estimate], solver: str) -> tuple[Estimate | None, list[str]]:
    try:
        return _either(fitting, solver)[0], []
    except ConvergenceError as exc:
        return None, [
            f"the fit with {FREE_WIDENING:g} times wider tolerances, for comparison, has no result: {exc}"
        ]


def _left_out(fit: Estimate, recording: Recording) -> list[str]:
    return [
        f"{recording.where(k)}: the mechanism cannot be assembled there; the row was left out"
        for k in fit.unassembled
    ]


__all__ = ["ESTIMATORS", "SOLVERS", "Calibration", "calibrate"]
