"""Charts of what each finding shifts, against what drives it: the fit's value with its band, and what each row says.

The columns of a recording that residuals may follow are here too, in the units people read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from truepose.arrays import Array, Index
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.recording import Recording
from truepose.identification.report.partial_residuals import PortShift, port_shifts
from truepose.identification.report.phrases import finer, unit_symbol
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import ROW, Driver
from truepose.models.machine.machine import Machine
from truepose.models.machine.sensor import Channel
from truepose.shown.chart import Axis, Band, Chart, Layer, Level, Line, Marks

MOST_PORTS, FEW, MANY = 3, 6, 20
"""Most ports of a finding that are drawn where there are few findings, else one; of many findings the first are drawn."""
FOLDED = 1.5
"""Periods in what was measured from which on a function is drawn over one of them."""
STEADY = 0.05
"""Share of its range by which a fitted value may jump between neighbours, for a line through them."""
BAND = 1.96


@dataclass(frozen=True)
class Curve:
    """A shift over its driver x (n,): fitted (n,) with its 1-sigma (n,), rows (n,): what each row says of it.

    line: rows in the order of x, through whose fitted values a line goes; empty where x alone does not decide them.
    """

    title: str
    x_title: str
    y_title: str
    x: Array
    fitted: Array
    std: Array
    rows: Array
    line: Index


def all_curves(
    diagnosis: Diagnosis, findings: Sequence[Finding], rows: Index | None = None
) -> list[list[Curve]]:
    """Return what each finding shifts, the largest port first, in some ``rows`` or in all."""
    known, groups = set(diagnosis.after.prior.names), dict[int, list[PlacedEffect]]()
    for k, finding in enumerate(findings[:MANY]):
        terms = terms_of(diagnosis, finding)
        if terms and known.issuperset(name for term in terms for name in term.parameter_names):
            groups[k] = terms
    shifts = port_shifts(diagnosis.after, diagnosis.recording, list(groups.values()), rows)
    most = MOST_PORTS if len(findings) <= FEW else 1
    out: list[list[Curve]] = [[] for _ in findings]
    for (k, terms), own in zip(groups.items(), shifts, strict=True):
        out[k] = [_curve(diagnosis, terms, shift) for shift in sorted(own, key=_worth, reverse=True)[:most]]
    return out


def terms_of(diagnosis: Diagnosis, finding: Finding) -> list[PlacedEffect]:
    """Return the fitted terms that a finding gathers."""
    return [t for t in diagnosis.terms if t.effect.slug == finding.effect and t.place == finding.place]


def _worth(shift: PortShift) -> float:
    """Return how large a port's shift is relative to what a row can say of it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scatter = float(np.nanmedian(np.abs(shift.rows - shift.fitted)))
    return float(np.nanmax(np.abs(shift.fitted), initial=0.0)) / (scatter or 1.0)


def _curve(diagnosis: Diagnosis, terms: Sequence[PlacedEffect], shift: PortShift) -> Curve:
    machine = diagnosis.nominal
    size = float(np.nanmax(np.abs(shift.fitted), initial=0.0)) or 1.0
    scale, unit = finer(size, machine.unit_of(shift.port))
    y_title = f"shift [{unit_symbol(unit) or '1'}]"
    if shift.joint:
        column = _folded(diagnosis, shift)
    else:
        driver = _driver(diagnosis, terms, shift)
        column = driver or Column("", f"fitted {y_title}", scale * shift.fitted)
    line = _line(column.values, shift.fitted, is_function=bool(shift.joint))
    return Curve(
        title=port_words(machine, shift.port),
        x_title=column.title,
        y_title=y_title,
        x=column.values,
        fitted=scale * shift.fitted,
        std=scale * shift.std,
        rows=scale * shift.rows,
        line=line,
    )


def port_words(machine: Machine, port: str) -> str:
    """Return a port in words: ``displacement of q2``, ``error motion rx of q3``."""
    kind = machine.ports[port].kind if port in machine.ports else ""
    if kind == "displacement":
        return f"displacement of {machine.ports[port].of}"
    if kind == "motion":
        return f"error motion {port.rpartition('.')[2]} of {machine.ports[port].of}"
    return f"reading {machine.ports[port].of}" if kind else port


def _folded(diagnosis: Diagnosis, shift: PortShift) -> Column:
    """Return the joint's column, moved by whole periods onto the first one where several were measured."""
    column = joint_column(diagnosis.nominal, diagnosis.recording, shift.joint)
    period = shift.period * reading_unit(diagnosis.nominal, shift.joint)[0]
    if not np.ptp(column.values) > FOLDED * period:
        return column
    start = column.values.min()
    title = column.title.replace(" [", f", folded over {period:.4g} [", 1)
    return Column(column.name, title, start + np.mod(column.values - start, period))


def _line(x: Array, y: Array, *, is_function: bool) -> Index:
    """Return the rows through which a line goes: known ones in the order of x, none where y jumps between neighbours."""
    order = np.argsort(x, kind="stable")
    order = order[np.isfinite(x[order]) & np.isfinite(y[order])]
    b = y[order]
    first = np.diff(x[order], prepend=-np.inf) > 0
    spread = float(np.ptp(b)) if len(b) else 0.0
    jumps = np.abs(np.diff(b)[~first[1:]])  # of rows from the row before at the same x
    steps = np.abs(np.diff(b, 2)) if len(b) > 2 else np.zeros(1)
    rough = max(float(np.max(jumps, initial=0.0)), float(np.median(steps)))
    return order[first] if is_function or (spread and rough <= STEADY * spread) else order[:0]


def _driver(diagnosis: Diagnosis, terms: Sequence[PlacedEffect], shift: PortShift) -> Column | None:
    """Return the logged driver that a shift follows most, or the load that it carries; None where joints drive it."""
    logged = [Driver.of(name).now.name for term in terms for name in term.drivers]
    columns = [column_of(diagnosis.nominal, diagnosis.recording, name) for name in dict.fromkeys(logged)]
    driven = [column for column in columns if column is not None and np.ptp(column.values) > 0]
    if driven:
        return max(driven, key=lambda c: _goes_with(c.values, shift.fitted))
    return _load(diagnosis, shift.port) if any(term.needs_load for term in terms) else None


def _load(diagnosis: Diagnosis, port: str) -> Column | None:
    """Return gravity's load at a port in each row."""
    fit = diagnosis.after
    predictor = Predictor(diagnosis.nominal, diagnosis.recording, fit.effects, ports=True)
    p = np.concatenate([fit.p, np.zeros(len(predictor.model.names) - len(fit.p))])
    values = predictor.loads_at([port], p, fit.x).get(port)
    if values is None or not np.ptp(values) > 0:
        return None
    unit = "N" if diagnosis.nominal.unit_of(port) == "mm" else "N·m"
    return Column(port, f"load [{unit}]", values)


def _goes_with(x: Array, y: Array) -> float:
    ok = np.isfinite(y)
    if ok.sum() < 3 or not np.ptp(x[ok]) > 0 or not np.ptp(y[ok]) > 0:
        return 0.0
    return abs(float(np.corrcoef(x[ok], y[ok])[0, 1]))


def curve_chart(curve: Curve, rows: Index) -> Chart:
    """Draw what was identified with its 95 % band, and what each of some rows says of it."""
    layers: list[Layer] = [Level(0.0, "y", dashed=False)]
    low, high = curve.fitted - BAND * curve.std, curve.fitted + BAND * curve.std
    if len(curve.line):
        x = curve.x[curve.line]
        layers.append(Band(x, low[curve.line], high[curve.line], "after", "95 % band"))
        layers.append(Line(x, curve.fitted[curve.line], "after", "identified"))
    layers.append(Marks(curve.x[rows], curve.rows[rows], "before", "each row", by_row=True))
    if not len(curve.line):
        layers.append(
            Marks(curve.x[rows], curve.fitted[rows], "after", "identified, in each row", by_row=True)
        )
    return Chart(curve.title, Axis(curve.x_title), Axis(curve.y_title, *_ends(curve.rows, low, high)), layers)


def _ends(rows: Array, low: Array, high: Array) -> tuple[float, float]:
    """Return ends that show the function and all but the farthest rows."""
    known = rows[np.isfinite(rows)]
    ends = np.quantile(known, [0.01, 0.99]) if known.size else np.zeros(2)
    lowest = min(float(ends[0]), float(np.nanmin(low, initial=0.0)))
    highest = max(float(ends[1]), float(np.nanmax(high, initial=0.0)))
    room = 0.08 * (highest - lowest) or 1.0
    return lowest - room, highest + room


MOST = 12


@dataclass(frozen=True)
class Column:
    """A driver's name, its axis title with unit, and values (n,)."""

    name: str
    title: str
    values: Array


def columns(machine: Machine, recording: Recording, first: Sequence[str] = ()) -> list[Column]:
    """Joints, what was logged and varies, the order of rows: twelve at most, those of ``first`` kept."""
    found = [column_of(machine, recording, name) for name in (*recording.joints, *recording.logged)]
    out = [column for column in found if column is not None]
    varying = [c for c in out if np.ptp(c.values) > 0.0]
    kept = {c.name for c in sorted(varying, key=lambda c: c.name not in first)[: MOST - 1]}
    return [
        *(c for c in varying if c.name in kept),
        order_column(recording),
    ]


def column_of(machine: Machine, recording: Recording, name: str) -> Column | None:
    """A joint or a logged driver; None where the recording has neither."""
    if name in recording.joints:
        return joint_column(machine, recording, name)
    values = recording.driver(name)
    if values is None:
        return None
    if name == ROW:
        return Column(name, "rows before the last [1]", values)
    unit = machine.driver_unit(name)
    shown = "±1" if unit == "1" else unit_symbol(unit) or "as recorded"
    return Column(name, f"{name} [{shown}]", values)


def order_column(recording: Recording) -> Column:
    """The order in which rows were recorded."""
    return Column("order", "row in order of acquisition [1]", np.arange(1.0, len(recording) + 1.0))


def joint_column(machine: Machine, recording: Recording, name: str) -> Column:
    """A joint's own motion, angles in degrees."""
    factor, unit = reading_unit(machine, name)
    values = recording.moved[:, recording.joints.index(name)]
    return Column(name, f"{name} [{unit}]", values * factor)


def reading_unit(machine: Machine, name: str) -> tuple[float, str]:
    """Factor and unit in which a joint's readings are shown."""
    unit = machine.mechanism.actuator(name).reading_unit
    return (float(np.degrees(1.0)), "°") if unit == "rad" else (1.0, unit_symbol(unit))


def component_groups(channels: Sequence[Channel]) -> dict[str, list[int]]:
    """Indices of residual components that share an axis (P1.x, P2.x: x), six groups at most."""
    out: dict[str, list[int]] = {}
    for k, channel in enumerate(channels):
        out.setdefault(channel.name.rsplit(".", 1)[-1], []).append(k)
    return dict(list(out.items())[:6])
