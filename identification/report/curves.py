"""What a finding adds to the machine at its estimated coefficients, as functions of what drives it, for drawing.

An effect of one reading is drawn by its own formula, evaluated between the readings too, and folded over its period where
it has one; any other by its fitted value in each row, against the driver or the load that it reads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from truepose.arrays import Array, Index
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.identification.diagnosis.result import Diagnosis, Finding
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.report.drivers import Column, column_of, joint_column, reading_unit
from truepose.identification.report.formulas import Formula, formula, terms_of
from truepose.identification.report.numbers import finer, unit_symbol
from truepose.identification.report.partial_residuals import PortShift, all_port_shifts
from truepose.models.effects.base import PlacedEffect
from truepose.models.file.driver import Driver
from truepose.models.machine.machine import Machine

POINTS = 721
MOST_PORTS, FEW, MANY = 3, 6, 20
"""Most ports of a finding that are drawn where there are few findings, else one; of many findings the first are drawn."""
FOLDED = 1.5
"""Periods in what was measured from which on a function is drawn over one of them."""
SAME = 1e-3
"""Share of its size by which a function may differ from itself a period later."""
STEADY = 0.05
"""Share of its range by which a fitted value may jump between neighbours, for a line through them."""


@dataclass(frozen=True)
class Curve:
    """A shift over its driver: x (n,), y and its 1-sigma (n,), empty where it is no function of the driver alone.

    measured (r,): the driver in each row of the recording; rows (r,): what each row says of the shift, None where that is
    not known; fitted (r,): the fit's value in each row, where other drivers act beside this one. Axis titles and a title.
    """

    x: Array
    y: Array
    std: Array
    measured: Array
    x_title: str
    y_title: str
    title: str = ""
    rows: Array | None = None
    fitted: Array | None = None

    def thinned(self, rows: Index) -> Curve:
        """With some rows of the recording alone."""
        said, fitted = (None if v is None else v[rows] for v in (self.rows, self.fitted))
        return replace(self, measured=self.measured[rows], rows=said, fitted=fitted)


def curves(diagnosis: Diagnosis, finding: Finding) -> list[Curve]:
    """What the finding adds, three ports at most, the largest first; none where its terms are not in the fit."""
    return all_curves(diagnosis, [finding])[0]


def all_curves(
    diagnosis: Diagnosis, findings: Sequence[Finding], rows: Index | None = None
) -> list[list[Curve]]:
    """The same of several findings, whose readings are evaluated once for all of them, in some ``rows`` or in all."""
    known, machine, fit = set(diagnosis.after.prior.names), diagnosis.nominal, diagnosis.after
    drawn: dict[int, tuple[list[PlacedEffect], Formula, list[str]]] = {}
    for k, finding in enumerate(findings[:MANY]):
        terms = terms_of(diagnosis, finding)
        found = formula(machine, terms)
        if found is not None and all(name in known for term in terms for name in term.parameter_names):
            ports = [port for port, shift in found.shifts.items() if not shift.is_zero()]
            drawn[k] = terms, found, [port for port in ports if port in machine.ports or port in known]
    wanted = [(terms, ports) for terms, _, ports in drawn.values()]
    out: list[list[Curve]] = [[] for _ in findings]
    for (k, (terms, found, _)), shifts in zip(
        drawn.items(), all_port_shifts(fit, diagnosis.recording, wanted, rows), strict=True
    ):
        largest = sorted(shifts, key=lambda s: -_worth(s))[: MOST_PORTS if len(findings) <= FEW else 1]
        out[k] = [_curve(diagnosis, terms, found, shift) for shift in largest]
    return out


def _worth(shift: PortShift) -> float:
    """How large a port's shift is beside what a row can say of it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        scatter = float(np.nanmedian(np.abs(shift.rows - shift.fitted)))
    return float(np.nanmax(np.abs(shift.fitted), initial=0.0)) / (scatter or 1.0)


def _curve(diagnosis: Diagnosis, terms: Sequence[PlacedEffect], found: Formula, shift: PortShift) -> Curve:
    machine, expression = diagnosis.nominal, found.shifts[shift.port]
    readings = [name for name, symbol in found.q.items() if ca.depends_on(expression, symbol)]
    scale, unit = finer(
        float(np.nanmax(np.abs(shift.fitted), initial=0.0)) or 1.0, machine.unit_of(shift.port)
    )
    y_title = f"shift [{unit_symbol(unit) or '1'}]"
    period = np.inf
    if found.plain and len(readings) == 1:
        column = joint_column(machine, diagnosis.recording, readings[0])
        curve, period = _evaluated(diagnosis, terms, found, shift.port, readings[0], scale)
    else:
        column, curve = _by_rows(diagnosis, terms, shift, scale, y_title)
    whole = replace(
        curve,
        measured=column.values,
        x_title=column.title,
        y_title=y_title,
        title=port_words(machine, shift.port),
        rows=scale * shift.rows,
    )
    return _folded(whole, period) if np.isfinite(period) else whole


def _by_rows(
    diagnosis: Diagnosis, terms: Sequence[PlacedEffect], shift: PortShift, scale: float, y_title: str
) -> tuple[Column, Curve]:
    """What was fitted in each row, against its driver; where several joints drive it, against itself."""
    column = _driver(diagnosis, terms, shift)
    if column is None:
        column = Column("", f"fitted {y_title}", scale * shift.fitted)
        return column, _itself(column.values, scale * shift.std)
    curve = _through(column.values, scale * shift.fitted, scale * shift.std)
    return column, curve if len(curve.x) else replace(curve, fitted=scale * shift.fitted)


def port_words(machine: Machine, port: str) -> str:
    """A port in words: ``displacement of q2``, ``error motion rx of q3``."""
    kind = machine.ports[port].kind if port in machine.ports else ""
    if kind == "displacement":
        return f"displacement of {machine.ports[port].of}"
    if kind == "motion":
        return f"error motion {port.rpartition('.')[2]} of {machine.ports[port].of}"
    return f"reading {machine.ports[port].of}" if kind else port


def _evaluated(
    diagnosis: Diagnosis, terms: Sequence[PlacedEffect], found: Formula, port: str, reading: str, scale: float
) -> tuple[Curve, float]:
    """The formula between the readings too, with its 1-sigma; over one period, in the units of x, where more were measured.

    The period is infinite where it is drawn over all that was measured.
    """
    recording, fit = diagnosis.recording, diagnosis.after
    measured = recording.moved[:, recording.joints.index(reading)]
    shift = found.shifts[port]
    inputs, slopes_by = [found.q[reading], found.coefficients], ca.jacobian(shift, found.coefficients)
    values = BatchFunction("shift", inputs, [shift])
    both = BatchFunction("shift_and_slopes", inputs, [shift, slopes_by])

    def value(q: Array) -> Array:
        return values(q[:, None], found.amplitudes)[0].ravel()

    period = _period(diagnosis.nominal, terms, reading, value)
    if not np.ptp(measured) > FOLDED * period:
        period = float("inf")
    x = np.linspace(measured.min(), min(measured.max(), measured.min() + period), POINTS)
    y, slopes = (out[:, 0] for out in both(x[:, None], found.amplitudes))
    y = y[:, 0]
    place = {fit.prior.names[int(k)]: j for j, k in enumerate(fit.prior.free)}
    names = [name for term in terms for name in term.parameter_names]
    free = [k for k, name in enumerate(names) if name in place]
    at = [place[names[k]] for k in free]
    own = slopes[:, free]
    std = np.sqrt(np.maximum(np.einsum("nk,kl,nl->n", own, fit.covariance_among(np.array(at)), own), 0.0))
    factor, _ = reading_unit(diagnosis.nominal, reading)
    return Curve(factor * x, scale * y, scale * std, measured, "", ""), factor * period


def _driver(diagnosis: Diagnosis, terms: Sequence[PlacedEffect], shift: PortShift) -> Column | None:
    """The logged driver that a shift follows most, or the load that it carries; None where joints drive it."""
    logged = [Driver.of(name).now.name for term in terms for name in term.drivers]
    columns = [column_of(diagnosis.nominal, diagnosis.recording, name) for name in dict.fromkeys(logged)]
    driven = [column for column in columns if column is not None and np.ptp(column.values) > 0]
    if driven:
        return max(driven, key=lambda c: _goes_with(c.values, shift.fitted))
    return _load(diagnosis, shift.port) if any(term.needs_load for term in terms) else None


def _load(diagnosis: Diagnosis, port: str) -> Column | None:
    """Gravity's load at a port in each row."""
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


def _through(x: Array, y: Array, std: Array) -> Curve:
    """A line through fitted values where they are a function of x; else nothing but what rows say."""
    ok = np.isfinite(x) & np.isfinite(y)
    order = np.argsort(x[ok], kind="stable")
    a, b, s = x[ok][order], y[ok][order], std[ok][order]
    first = np.concatenate([[True], np.diff(a) > 0]) if len(a) else np.zeros(0, dtype=bool)
    spread = np.ptp(b) if len(b) else 0.0
    jumps = np.abs(np.diff(b)[~first[1:]])  # of rows from the row before at the same x
    steps = np.abs(np.diff(b, 2)) if len(b) > 2 else np.zeros(1)
    if not spread or max(float(np.max(jumps, initial=0.0)), float(np.median(steps))) > STEADY * spread:
        empty = np.zeros(0)
        return Curve(empty, empty, empty, x, "", "")
    return Curve(a[first], b[first], s[first], x, "", "")


def _itself(fitted: Array, std: Array) -> Curve:
    """The line on which each row says what was fitted."""
    ok = np.flatnonzero(np.isfinite(fitted))
    order = ok[np.argsort(fitted[ok], kind="stable")]
    return Curve(fitted[order], fitted[order], std[order], fitted, "", "")


def _folded(curve: Curve, period: float) -> Curve:
    """What was measured, moved by whole periods onto the one that is drawn."""
    start = curve.x[0]
    phase = start + np.mod(curve.measured - start, period)
    title = curve.x_title.replace(" [", f", folded over {period:.4g} [", 1)
    return replace(curve, measured=phase, x_title=title)


def _period(
    machine: Machine, terms: Sequence[PlacedEffect], reading: str, value: Callable[[Array], Array]
) -> float:
    """The shortest period that a function of a reading has, of those that its orders offer; infinite without one."""
    actuator = machine.mechanism.actuator(reading)
    turn = {"rad": 2 * np.pi, "turn": 1.0}.get(actuator.reading_unit, actuator.screw_pitch or np.inf)
    orders = {v for term in terms for v in term.settings_map.values() if v > 0} | {1.0}
    x = np.linspace(0.0, turn, POINTS) if np.isfinite(turn) else np.zeros(1)
    here = value(x)
    for period in sorted(turn / order for order in orders):
        if np.isfinite(period) and np.max(np.abs(value(x + period) - here)) < SAME * np.ptp(here):
            return float(period)
    return float("inf")


__all__ = ["Curve", "all_curves", "curves"]
