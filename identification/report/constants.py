"""The constants: a table of all of them, and where each fit puts them against their tolerances."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.fit.estimated import Estimate
from truepose.identification.report.naming import plain_names
from truepose.identification.report.numbers import known, significant, unit_symbol
from truepose.models.machine.machine import Machine
from truepose.models.machine.mount_terms import Said, said_terms
from truepose.shown.chart import Axis, Bars, Chart, Layer, Level, Marks, Shape, Span, Tone
from truepose.shown.document import Block, Charts, Fold, Section, Table, Text
from truepose.shown.result import frame

FEW, SHOWN = 12, 12
"""Coefficients of effects up to which they stand among the constants, and constants of a notebook's chart."""
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


@dataclass(frozen=True)
class Departures:
    """A fit's departures (k,) from the drawing, in tolerances; clipped: it may run off the scale."""

    name: str
    tone: Tone
    shape: Shape
    values: Array
    clipped: bool = False


def parameter_section(diagnosis: Diagnosis) -> Section:
    """What improved.yaml holds, and the departures of the three fits."""
    fits = {"free": diagnosis.free, "before": diagnosis.before}
    if diagnosis.terms:
        fits["after"] = diagnosis.after
    summary = diagnosis.fits.get("after" if diagnosis.terms else "before")
    allowed = None if summary is None else summary.worst_allowed
    averaged = bool(diagnosis.terms)
    return constants_section(diagnosis.after, "improved.yaml", fits, allowed, averaged=averaged)


def constants_section(
    fit: Estimate, file: str, fits: Mapping[str, Estimate], allowed: float | None, *, averaged: bool = False
) -> Section:
    """Of a fit whose machine is in ``file``, with departures of some ``fits`` and what the farthest may be."""
    blocks = [*constants_blocks(fit, file, averaged=averaged), departure_block(fit.nominal, fits, allowed)]
    return Section("constants", "Calibrated constants", blocks)


def constants_blocks(fit: Estimate, file: str, *, averaged: bool = False) -> list[Block]:
    """Every constant with its drawing, value, 1-sigma, tolerance and unit; coefficients of effects folded where they are many.

    The CSV has all of them, with all digits.
    """
    table, names = frame(fit), plain_names(fit.effects)
    rows = [_row(names, record) for record in table.to_dict("records")]
    mean = (
        " They are averages over all explanations that the readings allow, so they differ a little from the numbers of the"
        " likeliest explanation, which the findings and the headline tell."
    )
    caption = (
        f"The constants that {file} holds.{mean if averaged else ''} 1 sigma: how well each is known; ∞: the readings say"
        " nothing of it. A click on a head sorts."
    )
    count = len(rows) if len(names) <= FEW else len(rows) - len(names)
    columns = ["parameter", "nominal", "value", "std", "tolerance", "in_tolerances", "unit"]
    csv = table[columns].to_csv(index=False, lineterminator="\n")
    out: list[Block] = [Table(HEAD, rows[:count], caption, csv=csv), *_mount_blocks(fit)]
    more = Fold(f"{len(names)} coefficients of effects", [Table(HEAD, rows[count:])])
    return out if count == len(rows) else [*out, more]


def farthest_table(fit: Estimate) -> Table:
    """All constants, the farthest from the drawing first."""
    table, names = frame(fit), plain_names(fit.effects)
    sizes = table["in_tolerances"].abs()
    order = sizes.sort_values(ascending=False, na_position="last", kind="stable").index
    rows = [_row(names, record) for record in table.loc[order].to_dict("records")]
    return Table(["farthest from drawing", *HEAD[1:]], rows)


def _row(names: Mapping[str, str], record: Mapping[Hashable, Any]) -> list[str]:
    return [
        names.get(record["parameter"], record["parameter"]),
        _number(record["nominal"]),
        _rounded(float(record["value"]), float(record["std"])),
        significant(float(record["std"]), 2),
        _number(record["tolerance"], 3),
        _number(record["in_tolerances"], 3),
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


def departure_block(machine: Machine, fits: Mapping[str, Estimate], allowed: float | None) -> Block:
    """Departures of every parameter of finite tolerance."""
    rows = [k for k, p in enumerate(machine.parameters) if 0 < p.tolerance < np.inf]
    if not rows:
        return Text("No parameter has a finite tolerance, so none can be judged against its drawing.")
    series = [
        Departures(*_LOOKS[key], fit.in_tolerances[rows], clipped=key == "free" and len(fits) > 1)
        for key, fit in fits.items()
    ]
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
    return Charts(dot_plot([machine.parameters[k].name for k in rows], series, allowed), caption)


def dot_plot(names: Sequence[str], series: Sequence[Departures], allowed: float | None) -> list[Chart]:
    """One line a parameter, the farthest on top, some a panel; clipped series stand at the edge beyond the scale."""
    sizes = np.nan_to_num(np.array([np.abs(s.values) for s in series if not s.clipped]))
    order = np.argsort(-np.round(np.max(sizes, axis=0), 6), kind="stable")[:MOST]
    limit = allowed if allowed is not None and known(allowed) else 0.0
    reach = 1.12 * max(2.0, limit, float(np.max(sizes, initial=0.0)))
    return [
        _panel(names, series, order[k : k + PER_PANEL], reach, limit) for k in range(0, len(order), PER_PANEL)
    ]


def _panel(
    names: Sequence[str], series: Sequence[Departures], rows: Index, reach: float, limit: float
) -> Chart:
    layers: list[Layer] = [
        Span(-1.0, 1.0, "accent", "one tolerance"),
        Level(0.0, "x", dashed=False, tone="free"),
    ]
    if limit > 0:
        layers += [Level(side * limit, "x", "allowed to the farthest", tone="ink") for side in (-1, 1)]
    at = np.arange(len(rows), dtype=float)
    for one in series:
        values = np.clip(one.values[rows], -0.99 * reach, 0.99 * reach)
        layers.append(Marks(values, at, one.tone, one.name, one.shape))
    x = Axis("estimate less drawing [tolerances]", -reach, reach)
    return Chart("", x, Axis("", names=[names[k] for k in rows]), layers, height=62.0 + 17.0 * len(rows))


def farthest_chart(fit: Estimate) -> list[Chart]:
    """How far the farthest constants stand from their drawing, for a notebook."""
    away = fit.in_tolerances
    order = np.argsort(-np.round(np.abs(away), 6), kind="stable")[:SHOWN]  # rounding orders nothing
    return bar_chart(
        {fit.prior.names[k]: float(away[k]) for k in order if away[k] != 0.0}, "off the drawing [tolerances]"
    )


def bar_chart(values: Mapping[str, float], axis: str, limit: float = 1.0) -> list[Chart]:
    """Bars of a few named numbers with a size that is marked on both sides; none without numbers."""
    finite = {name: value for name, value in values.items() if np.isfinite(value)}
    if not finite:
        return []
    sizes = np.array(list(finite.values()))
    sides = (-1, 1) if np.any(sizes < 0.0) else (1,)
    bars = Bars(sizes, np.arange(len(sizes), dtype=float), "after", texts=[f"{v:.3g}" for v in sizes])
    levels = [Level(side * limit, "x", tone="ink") for side in sides]
    return [
        Chart("", Axis(axis), Axis("", names=list(finite)), [bars, *levels], height=62.0 + 17.0 * len(sizes))
    ]


def _terms(fit: Estimate) -> tuple[Said, ...]:
    """TPOINT's terms of a fit; none where the machine is no mount."""
    values = dict(zip(fit.prior.names, fit.p.tolist(), strict=True))
    std = dict(zip(fit.prior.names, fit.std.tolist(), strict=True))
    return said_terms(fit.nominal, fit.effects, values, std)


def mount_words(fit: Estimate) -> list[str]:
    """One sentence: ``TPOINT's terms, arcsec: IH +899.2 +- 0.3, ...``."""
    told = [f"{one.term.name} {one.value:+.1f} +- {one.std:.1f}" for one in _terms(fit)]
    return [f"TPOINT's terms, arcsec: {', '.join(told)}"] if told else []


def _mount_blocks(fit: Estimate) -> list[Block]:
    """The terms beside our names, with formulas."""
    rows = [
        [
            one.term.name,
            one.term.ours,
            f"{one.value:+.2f}",
            f"{one.std:.2f}",
            one.term.formula,
            one.term.words,
        ]
        for one in _terms(fit)
    ]
    head = ["TPOINT", "here", "arcsec", "1 sigma", "formula", "what it is"]
    caption = (
        "The mount in the words of its field. A term is what is added to what the encoders say for where the telescope really"
        " points: h hour angle, d declination, A azimuth from the north by the east, E altitude, z zenith distance."
    )
    return [Table(head, rows, caption)] if rows else []
