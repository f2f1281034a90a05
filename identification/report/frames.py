"""Results as tables (pandas), one function a kind; the columns are documented at each result's ``to_frame``."""

from __future__ import annotations

import numpy as np
import pandas as pd

from truepose.identification.compensation.compensate import Compensation
from truepose.identification.compensation.inverse import Inverse, Reach
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.fit.calibrate import Calibration
from truepose.identification.fit.estimated import Estimate
from truepose.identification.identifiability.analysis import Identifiability
from truepose.identification.identifiability.observability import identifiable
from truepose.identification.report.finding_words import explanation, separating_experiment
from truepose.identification.report.results import drawing_of, unbounded
from truepose.shown.result import frame

CONSTANTS = ["parameter", "value", "std", "nominal", "unit", "tolerance", "in_tolerances", "identifiable"]
FINDINGS = [
    "effect", "place", "probability", "place_probability", "driver", "driver_probability", "or_else",
    "amplitudes", "explanation", "experiment",
]  # fmt: skip


@frame.register
def _(found: Estimate) -> pd.DataFrame:
    drawing = {p.name: drawing_of(found.nominal).get(p.name, p.nominal) for p in found.nominal.parameters}
    tolerance = {p.name: p.tolerance for p in found.nominal.parameters}
    units, seen = found.nominal.with_effects(found.effects).parameter_units, identifiable(found)
    away, std, open_ended = found.in_tolerances, found.std, unbounded(found)
    rows = [
        (
            name,
            float(found.p[k]),
            np.inf if name in open_ended else float(std[k]),
            drawing.get(name, np.nan),
            units[name],
            tolerance.get(name, np.nan),
            float(away[k]) if 0.0 < tolerance.get(name, 0.0) < np.inf else np.nan,
            seen[name],
        )
        for k, name in enumerate(found.prior.names)
        if found.prior.sigma[k] > 0
    ]
    return pd.DataFrame(rows, columns=CONSTANTS)


@frame.register
def _(found: Calibration) -> pd.DataFrame:
    return frame(found.fit)


@frame.register
def _(found: Diagnosis) -> pd.DataFrame:
    return pd.DataFrame([_finding(one) for one in found.findings], columns=FINDINGS)


def _finding(one: Finding) -> tuple[object, ...]:
    others = "; ".join(f"{other.effect} at {', '.join(other.place)}" for other in one.equivalents)
    sizes = "; ".join(f"{name} = {q.value:.4g} +- {q.std:.2g} {q.unit}" for name, q in one.parameters.items())
    return (
        one.effect,
        ", ".join(one.place),
        np.nan if one.nameless else one.probability,
        one.levels.place,
        one.levels.kind,
        one.levels.driver,
        others,
        sizes,
        explanation(one),
        separating_experiment(one),
    )


@frame.register
def _(found: Finding) -> pd.DataFrame:
    rows = [(name, q.value, q.std, q.unit) for name, q in found.parameters.items()]
    return pd.DataFrame(rows, columns=["coefficient", "value", "std", "unit"])


@frame.register
def _(found: Identifiability) -> pd.DataFrame:
    rows = [
        (p.name, p.unit, p.tolerance, p.std, p.std_at_drawing, p.status, ", ".join(p.partners))
        for p in found.parameters
    ]
    columns = ["parameter", "unit", "tolerance", "std", "std_at_drawing", "status", "trades_with"]
    return pd.DataFrame(rows, columns=columns)


@frame.register
def _(found: Compensation) -> pd.DataFrame:
    data = dict(zip(found.readings, found.command.T, strict=True))
    data |= {f"{name}.nominal": q for name, q in zip(found.readings, found.nominal.T, strict=True)}
    partial = () if found.task.is_whole else (("not_asked", found.not_asked),)
    for when, twist in (("before", found.before), ("after", found.after), *partial):
        data[f"{when}.position"] = np.linalg.norm(twist[:, :3], axis=1)
        data[f"{when}.rotation"] = np.linalg.norm(twist[:, 3:], axis=1)
    return pd.DataFrame(data)


@frame.register
def _(found: Inverse) -> pd.DataFrame:
    status = [Reach(int(s)).name.lower().replace("_", " ") for s in found.status]
    out = pd.DataFrame(dict(zip(found.readings, found.q.T, strict=True)))
    return out.assign(status=status, position=found.position, rotation=found.rotation)
