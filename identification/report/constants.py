"""The constants: a table of all of them, and where each fit puts them against their tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from truepose.arrays import Array, Index
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report.phrases import known, significant, unit_symbol
from truepose.models.machine.machine import Machine
from truepose.models.machine.mount_terms import said_terms
from truepose.shown.chart import Axis, Chart, Layer, Level, Marks, Shape, Tone
from truepose.shown.document import Block, Charts, Fold, Section, Table, Text
from truepose.shown.result import frame

FEW = 12
"""Coefficients of effects up to which they stand among the constants."""
MOST, PER_PANEL = 60, 20
ROUNDING = 1e-9
"""Below it a number is rounding."""
HEAD = ["constant", "drawing", "value", "1 sigma", "tolerance", "off, in tolerances", "unit"]
_LOOKS: Mapping[str, tuple[str, Tone, Shape]] = {
    "free": ("free fit", "free", "tick"),
    "before": ("tolerances, no effects", "before", "ring"),
    "after": ("with effects", "after", "dot"),
    "calibrated": ("calibrated", "after", "dot"),
}


def constants_section(
    fit: Estimate, file: str, fits: Mapping[str, Estimate], allowed: float | None, *, averaged: bool = False
) -> Section:
    """Return the constants of a fit whose machine is in ``file``, and the departures of some ``fits`` from the drawing.

    allowed: what the farthest constant of a true model stays within; averaged: whether values are means over explanations.
    """
    blocks = [*_tables(fit, file, averaged=averaged), _departures(fit.nominal, fits, allowed)]
    return Section("constants", "Calibrated constants", blocks)


def _tables(fit: Estimate, file: str, *, averaged: bool) -> list[Block]:
    """Return every constant with its drawing, value, 1-sigma, tolerance and unit; many coefficients of effects are folded.

    The CSV has all of them, with all digits.
    """
    table = frame(fit)
    rows = _rows(table)
    mean = (
        " They are averages over all explanations that the readings allow, so they differ a little from the numbers of the"
        " likeliest explanation, which the findings and the headline tell."
    )
    caption = (
        f"The constants that {file} holds.{mean if averaged else ''} 1 sigma: how well each is known; ∞: the readings say"
        " nothing of it. A click on a head sorts."
    )
    coefficients = sum(len(effect.coefficients) for effect in fit.effects)
    count = len(rows) if coefficients <= FEW else len(rows) - coefficients
    columns = ["parameter", "nominal", "value", "std", "tolerance", "in_tolerances", "unit"]
    csv = table[columns].to_csv(index=False, lineterminator="\n")
    out: list[Block] = [Table(HEAD, rows[:count], caption, csv=csv)]
    more = Fold(f"{coefficients} coefficients of effects", [Table(HEAD, rows[count:])])
    return out if count == len(rows) else [*out, more]


def farthest_table(fit: Estimate) -> Table:
    """All constants, the farthest from the drawing first."""
    table = frame(fit)
    sizes = table["in_tolerances"].abs()
    order = sizes.sort_values(ascending=False, na_position="last", kind="stable").index
    return Table(["farthest from drawing", *HEAD[1:]], _rows(table.loc[order]))


def _rows(table: pd.DataFrame) -> list[list[str]]:
    return [
        [
            r["parameter"],
            _number(r["nominal"]),
            _rounded(float(r["value"]), float(r["std"])),
            significant(float(r["std"]), 2),
            _number(r["tolerance"], 3),
            _number(r["in_tolerances"], 3),
            unit_symbol(str(r["unit"])) or "1",
        ]
        for r in table.to_dict("records")
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


def _departures(machine: Machine, fits: Mapping[str, Estimate], allowed: float | None) -> Block:
    """Draw the departures of every parameter of finite tolerance, the farthest first."""
    rows = [k for k, p in enumerate(machine.parameters) if 0 < p.tolerance < np.inf]
    if not rows:
        return Text("No parameter has a finite tolerance, so none can be judged against its drawing.")
    away = {key: fit.in_tolerances[rows] for key, fit in fits.items()}
    held = np.nan_to_num(np.array([np.abs(v) for key, v in away.items() if key != "free" or len(fits) == 1]))
    order = np.argsort(-np.round(np.max(held, axis=0), 6), kind="stable")[:MOST]
    limit = allowed if allowed is not None and known(allowed) else 0.0
    reach = 1.12 * max(2.0, limit, float(np.max(held, initial=0.0)))
    panels = [order[k : k + PER_PANEL] for k in range(0, len(order), PER_PANEL)]
    names = [machine.parameters[k].name for k in rows]
    home = (
        " Driven out without effects and home with them is the mark of concealed physics."
        if "after" in fits
        else ""
    )
    more = f" The {MOST} farthest of {len(rows)} are shown." if len(rows) > MOST else ""
    caption = (
        "Where each fit puts each parameter, in tolerances of the drawing, the farthest first. Dashed: what the farthest"
        f" parameter of a true model stays within in 99 of 100 cases.{home} Marks at the edge lie beyond the scale.{more}"
    )
    return Charts([_panel(names, away, panel, reach, limit) for panel in panels], caption)


def _panel(names: Sequence[str], away: Mapping[str, Array], rows: Index, reach: float, limit: float) -> Chart:
    """Draw one line a parameter; what lies beyond the scale is put at its edge."""
    layers: list[Layer] = [
        *(Level(side, "x", "one tolerance", dashed=False, tone="accent") for side in (-1.0, 1.0)),
        Level(0.0, "x", dashed=False, tone="free"),
    ]
    if limit > 0:
        layers += [Level(side * limit, "x", "allowed to the farthest", tone="ink") for side in (-1, 1)]
    at = np.arange(len(rows), dtype=float)
    for key, values in away.items():
        name, tone, shape = _LOOKS[key]
        layers.append(Marks(np.clip(values[rows], -0.99 * reach, 0.99 * reach), at, tone, name, shape))
    x = Axis("estimate less drawing [tolerances]", -reach, reach)
    return Chart("", x, Axis("", names=[names[k] for k in rows]), layers, height=62.0 + 17.0 * len(rows))


def mount_words(fit: Estimate) -> list[str]:
    """Return TPOINT's terms of a mount in one sentence: ``TPOINT's terms, arcsec: IH +899.2 +- 0.3, ...``."""
    values = dict(zip(fit.prior.names, fit.p.tolist(), strict=True))
    std = dict(zip(fit.prior.names, fit.std.tolist(), strict=True))
    terms = said_terms(fit.nominal, fit.effects, values, std)
    told = [f"{one.term.name} {one.value:+.1f} +- {one.std:.1f}" for one in terms]
    return [f"TPOINT's terms, arcsec: {', '.join(told)}"] if told else []
