"""Small pictures of results for notebooks; the report's own figures, which move, are in ``figures``."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from truepose.identification.compensation.compensate import Compensation
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.identifiability.analysis import Identifiability
from truepose.shown.drawing import bars, dots

SHOWN = 12


def tolerances(fit: Estimate) -> str:
    """How far the farthest constants stand from their drawing."""
    away = fit.in_tolerances
    order = np.argsort(-np.round(np.abs(away), 6), kind="stable")[:SHOWN]  # rounding orders nothing
    values = {fit.prior.names[k]: float(away[k]) for k in order if away[k] != 0.0}
    return bars(values, title="farthest from the drawing, in tolerances", limit=1.0)


def residuals(fits: Mapping[str, Estimate]) -> str:
    """Root mean square of each row's readings, in stated sigmas."""
    sizes = {name: np.sqrt(np.mean(fit.residual**2, axis=1)).tolist() for name, fit in fits.items()}
    return dots(sizes, title="residual of each row, in stated sigmas")


def before_and_after(found: Diagnosis) -> str:
    """Residuals under tolerances, and with what was found."""
    fits = {"before": found.before}
    return residuals({**fits, "after": found.after} if found.terms else fits)


def sights(found: Identifiability) -> str:
    """Which constants the readings say least about."""
    left = {p.name: p.std / p.tolerance for p in found.parameters if 0.0 < p.tolerance < np.inf}
    most = dict(sorted(left.items(), key=lambda item: -round(item[1], 6))[:SHOWN])
    title = "1-sigma to expect, in tolerances: 1 says that the readings tell nothing"
    return bars(most, title=title, limit=1.0) if most else ""


def path_errors(found: Compensation) -> str:
    """Position errors along the path, before and after."""
    size = {
        name: np.linalg.norm(twist[:, :3], axis=1).tolist()
        for name, twist in (("before", found.before), ("after", found.after))
    }
    return dots(size, title="position error along the path, mm")
