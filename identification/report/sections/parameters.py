"""The constants: a table of all of them, their departures from the drawing, and how their estimates go together."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report.document import Block, Charts, Fold, Section, Table, Text
from truepose.identification.report.figures import parameters
from truepose.identification.report.figures.parameters import Departures
from truepose.identification.report.mount_words import mount_blocks
from truepose.identification.report.numbers import significant, unit_symbol
from truepose.identification.report.plain_names import plain_names
from truepose.models.machine.machine import Machine
from truepose.shown.result import frame

FEW = 12
"""Coefficients of effects up to which they stand among the constants."""
CORRELATED = 20
"""Most constants of a correlation map: those that go together most."""
ROUNDING = 1e-9
"""Below it a number is rounding."""
_LOOKS = {
    "free": ("free fit", "free", "tick"),
    "before": ("tolerances, no effects", "before", "ring"),
    "after": ("with effects", "after", "dot"),
    "calibrated": ("calibrated", "after", "dot"),
}


def parameter_section(diagnosis: Diagnosis) -> Section:
    """Table of what improved.yaml holds, departures of the three fits, correlations."""
    fits = {"free": diagnosis.free, "before": diagnosis.before}
    if diagnosis.terms:
        fits["after"] = diagnosis.after
    key = "after" if diagnosis.terms else "before"
    summary = diagnosis.fits.get(key)
    allowed = None if summary is None else summary.worst_allowed
    blocks = constants_blocks(diagnosis.after, "improved.yaml", averaged=bool(diagnosis.terms))
    blocks += parameter_blocks(diagnosis.nominal, fits, allowed)
    blocks += correlation_blocks(diagnosis.after)
    return Section("constants", "Calibrated constants", blocks)


def constants_blocks(fit: Estimate, file: str, *, averaged: bool = False) -> list[Block]:
    """Every constant with its drawing, value, 1-sigma, tolerance and unit; coefficients of effects folded where they are many.

    The CSV has all of them, with all digits.
    """
    table, names = frame(fit), plain_names(fit.effects)
    rows = [_row(names, record) for record in table.to_dict("records")]
    head = ["constant", "drawing", "value", "1 sigma", "tolerance", "off, in tolerances", "unit"]
    held = (
        f"The constants that {file} holds. They are averages over all explanations that the readings allow, so they"
        " differ a little from the numbers of the likeliest explanation, which the findings above and the headline tell."
        if averaged
        else f"The constants that {file} holds."
    )
    caption = (
        f"{held} 1 sigma: how well each is known; ∞: the readings say nothing of it. A click on a head sorts."
    )
    count = len(rows) if len(names) <= FEW else len(rows) - len(names)
    whole = Table(head, rows[:count], caption, csv=_csv(table))
    mount = mount_blocks(fit)
    if count == len(rows):
        return [whole, *mount]
    return [whole, *mount, Fold(f"{len(names)} coefficients of effects", [Table(head, rows[count:])])]


def _row(names: Mapping[str, str], record: Mapping[Hashable, Any]) -> list[str]:
    return [
        names.get(record["parameter"], record["parameter"]),
        _number(record["nominal"]),
        _rounded(float(record["value"]), float(record["std"])),
        significant(float(record["std"]), 2),
        _number(record["tolerance"], 3),
        _number(record["in_tolerances"], 2),
        unit_symbol(str(record["unit"])) or "1",
    ]


def _rounded(value: float, std: float) -> str:
    """A value to a tenth of its last known digit; all six digits where nothing is known of it."""
    if not np.isfinite(std) or std <= 0.0 or not np.isfinite(value):
        return _number(value)
    places = max(0, 2 - int(np.floor(np.log10(std))))
    return f"{round(value, places) + 0.0:.{places}f}" if places < 12 else _number(value)


def _number(value: object, digits: int = 6) -> str:
    number = float(str(value))
    if np.isnan(number) or np.isinf(number):
        return "-" if np.isnan(number) else "∞"
    return "0" if abs(number) < ROUNDING else f"{number:.{digits}g}"


def _csv(table: pd.DataFrame) -> str:
    """All digits; empty where there is no number."""
    names = ["parameter", "nominal", "value", "std", "tolerance", "in_tolerances", "unit"]
    return table[names].to_csv(index=False, lineterminator="\n")


def parameter_blocks(machine: Machine, fits: Mapping[str, Estimate], allowed: float | None) -> list[Block]:
    """Departures of every parameter of finite tolerance."""
    rows = [k for k, p in enumerate(machine.parameters) if 0 < p.tolerance < np.inf]
    if not rows:
        return [Text("No parameter has a finite tolerance, so none can be judged against its drawing.")]
    series = [
        Departures(*_LOOKS[key], fit.in_tolerances[rows], clipped=key == "free" and len(fits) > 1)  # type: ignore[arg-type]
        for key, fit in fits.items()
    ]
    names = [machine.parameters[k].name for k in rows]
    home = (
        " Driven out without effects and home with them is the mark of concealed physics."
        if "after" in fits
        else ""
    )
    more = f" The {parameters.MOST} farthest of {len(rows)} are shown." if len(rows) > parameters.MOST else ""
    caption = (
        "Where each fit puts each parameter, in tolerances of the drawing, the farthest first. Dashed: what the farthest"
        f" parameter of a true model stays within in 99 of 100 cases.{home} Marks at the edge lie beyond the scale.{more}"
    )
    return [Charts(parameters.dot_plot(names, series, allowed), caption)]


def correlation_blocks(fit: Estimate) -> list[Block]:
    """Correlations of the estimates that go together most."""
    names = [fit.prior.names[k] for k in fit.prior.free]
    if len(names) < 2:
        return []
    covariance = fit.root @ fit.root.T
    size = np.sqrt(np.diag(covariance))
    correlation = covariance / np.where(np.outer(size, size) > 0, np.outer(size, size), 1.0)
    strongest = np.max(np.abs(correlation - np.diag(np.diag(correlation))), axis=1)
    rows = np.sort(np.argsort(-strongest, kind="stable")[:CORRELATED])
    some = f" The {len(rows)} of {len(names)} that go together most." if len(rows) < len(names) else ""
    plain = plain_names(fit.effects)
    shown = [plain.get(names[k], names[k]) for k in rows]
    caption = (
        "Correlation of estimates: deep colour means that the readings tell the sum or the difference of two constants much"
        f" better than either. Blue: they err together, orange: against each other.{some}"
    )
    chart = parameters.correlation_map(shown, correlation[np.ix_(rows, rows)])
    return [Fold("Correlation of the estimates", [Charts([chart], caption)])]
