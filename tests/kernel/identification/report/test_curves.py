"""Laws of what a finding's pictures show: the formula and what rows say agree, folded over a period, by its own driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.effect_machines import ARM, GOUGH, STAGE
from support.effects import with_effect
from support.exact_fits import fit_at, read
from support.moving_machines import record, written
from support.reports import gear_finding, synthetic
from truepose.arrays import Array
from truepose.identification.diagnosis.result import Diagnosis
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.report.curves import Curve, all_curves, curves
from truepose.identification.report.partial_residuals import all_port_shifts
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine.machine import Machine

ROWS = 90
TURN = 2 * np.pi


def found(machine: Machine, terms: Sequence[PlacedEffect], q: Array, **more: Any) -> Diagnosis:
    """Terms that were found, a finding each, from exact readings at q (n, nq)."""
    recording = read(machine, record(machine, q, **more), terms)
    fit = fit_at(machine, recording, terms)
    findings = tuple(replace(gear_finding(), effect=t.effect.slug, place=t.place) for t in terms)
    return replace(synthetic(machine), recording=recording, after=fit, terms=tuple(terms), findings=findings)


def drawn(machine: Machine, term: PlacedEffect, q: Array, **more: Any) -> list[Curve]:
    """What is drawn of a term that was found."""
    diagnosis = found(machine, [term], q, **more)
    return curves(diagnosis, diagnosis.findings[0])


def largest(every: Sequence[Curve]) -> Curve:
    """The port that shifts farthest."""
    return max(every, key=lambda c: float(np.nanmax(np.abs(np.asarray(c.rows)))))


def turning(joints: int, turns: float = 1.0, rows: int = ROWS) -> Array:
    """The first joint over so many turns, the others somewhere."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, (rows, joints))
    q[:, 0] = np.linspace(-0.5 * turns * TURN, 0.5 * turns * TURN, rows)
    return q


def on_the_line(curve: Curve, atol: float) -> None:
    """Rows stand on the drawn function, wherever they were folded to."""
    assert curve.rows is not None
    known = np.isfinite(curve.rows)
    assert known.any()
    phase = curve.measured[known]
    assert curve.x[0] - 1e-9 <= phase.min() and phase.max() <= curve.x[-1] + 1e-9
    expected = np.interp(phase, curve.x, curve.y)
    np.testing.assert_allclose(curve.rows[known], expected, atol=atol)


@pytest.mark.parametrize("order", [2.0, 3.0, 7.0, 121.0, 242.0])
def test_periods_are_folded_onto_one(machine: Machine, order: float) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": order}, a=3e-4, b=-1e-4)
    q = turning(2)
    (curve,) = drawn(machine, term, q)
    period = 360.0 / order
    assert curve.x_title == f"q1, folded over {period:.4g} [°]"
    assert curve.x[-1] - curve.x[0] == pytest.approx(period)
    whole = (np.degrees(q[:, 0]) - curve.measured) / period
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-9)
    assert len(np.unique(np.round(whole))) >= min(order, ROWS // 2)
    x = order * np.radians(curve.x)
    np.testing.assert_allclose(curve.y, 1e6 * (3e-4 * np.sin(x) - 1e-4 * np.cos(x)), atol=1e-6)
    on_the_line(curve, atol=0.02)


def test_an_order_of_one_is_drawn_over_all_that_was_measured(machine: Machine) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 1.0}, a=3e-4, b=-1e-4)
    (curve,) = drawn(machine, term, turning(2))
    assert curve.x_title == "q1 [°]"
    assert (curve.x[0], curve.x[-1]) == pytest.approx((-180.0, 180.0))
    on_the_line(curve, atol=0.02)


@pytest.mark.parametrize(("turns", "folded"), [(0.3, False), (0.49, False), (0.51, True), (0.9, True)])
def test_little_more_than_a_period_is_not_folded(machine: Machine, turns: float, folded: bool) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    (curve,) = drawn(machine, term, turning(2, turns))
    assert ("folded" in curve.x_title) is folded
    assert curve.x[-1] - curve.x[0] == pytest.approx(120.0 if folded else 360.0 * turns)
    on_the_line(curve, atol=0.02)


def test_two_waves_have_the_period_that_both_share(machine: Machine) -> None:
    """A third of a turn is the period of one alone, half a turn of the other; the whole turn is of both."""
    terms = [
        with_effect(machine, "transmission-error", ("q1",), {"order": k}, a=3e-4, b=-1e-4) for k in (2.0, 3.0)
    ]
    diagnosis = found(machine, terms, turning(2, 3.0))
    (curve,) = curves(diagnosis, diagnosis.findings[0])
    assert curve.x_title == "q1, folded over 360 [°]"
    assert curve.x[-1] - curve.x[0] == pytest.approx(360.0)
    on_the_line(curve, atol=0.05)  # of the bend between points, half a degree apart: 0.04


def test_a_screw_is_folded_over_its_pitch(tmp_path: Path) -> None:
    machine = written(tmp_path, STAGE)
    term = with_effect(machine, "screw-periodic", ("s1",), {"harmonic": 1.0}, a=2e-3, b=1e-3)
    q = turning(3)
    q[:, 0] = np.linspace(-40.0, 40.0, ROWS)
    q[:, 1:] *= 0.01
    (curve,) = drawn(machine, term, q)
    assert curve.x_title == "s1, folded over 5 [mm]"
    on_the_line(curve, atol=1e-3)


def test_growth_by_heat_is_drawn_against_its_own_thermometer(tmp_path: Path) -> None:
    machine = written(tmp_path, ARM)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": 0.0}, alpha=2e-5)
    warm = np.random.default_rng(1).permutation(np.linspace(18.0, 35.0, ROWS))
    other = np.random.default_rng(2).uniform(18.0, 35.0, ROWS)
    every = drawn(machine, term, turning(3), drivers={"temperature.link2": warm, "temperature.base": other})
    curve = largest(every)
    assert curve.x_title == "temperature.link2 [°C]"
    assert np.array_equal(curve.measured, warm)
    by = float(np.polyfit(curve.x, curve.y, 1)[0]) * 1e-3  # um
    lengths = {p.name: p.nominal for p in machine.parameters}
    assert by == pytest.approx(2e-5 * lengths[curve.title], rel=1e-6)
    share = curve.std / np.abs(curve.y)  # how well the one coefficient is known
    assert share.min() > 0.0 and np.ptp(share) < 1e-6 * share.max()
    on_the_line(curve, atol=1e-3)


def test_giving_way_is_drawn_against_the_load(tmp_path: Path) -> None:
    machine = written(tmp_path, ARM)
    term = with_effect(machine, "joint-compliance", ("q2",), {}, c=2e-6)
    recording = read(machine, record(machine, turning(3)), [term])
    (curve,) = drawn(machine, term, recording.q)
    assert curve.x_title == "load [N·m]"
    bare = Predictor(machine, recording, ports=True)
    load = bare.loads(bare.model.p_home, np.zeros((ROWS, 0)))["q2.displacement"]
    np.testing.assert_allclose(curve.measured, load, rtol=1e-3, atol=1e-3 * np.ptp(load))
    assert float(np.polyfit(curve.x, curve.y, 1)[0]) == pytest.approx(2e-6 * 1e6, rel=1e-3)
    on_the_line(curve, atol=1.0)


def test_what_several_joints_drive_is_drawn_against_itself(machine: Machine) -> None:
    term = with_effect(machine, "sensor-scale", ("sensor",), None, s=1e-4)
    every = drawn(machine, term, turning(2))
    assert 1 <= len(every) <= 3
    for curve in every:
        assert curve.x_title.startswith("fitted shift") and np.array_equal(curve.x, curve.y)
        on_the_line(curve, atol=1e-6 * float(np.ptp(curve.y)))


def test_thinning_leaves_the_line_and_takes_the_same_rows_of_all(machine: Machine) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    (curve,) = drawn(machine, term, turning(2))
    rows = np.array([3, 17, 40], dtype=np.intp)
    some = curve.thinned(rows)
    assert some.x is curve.x and some.y is curve.y
    assert curve.rows is not None and some.rows is not None
    assert np.array_equal(some.measured, curve.measured[rows]) and np.array_equal(some.rows, curve.rows[rows])


# -- how well it is known ----------------------------------------------------------------------------


def test_the_band_is_that_of_the_formula_with_the_fit_s_covariance(machine: Machine) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    diagnosis = found(machine, [term], turning(2))
    (curve,) = curves(diagnosis, diagnosis.findings[0])
    fit = diagnosis.after
    at = [list(fit.prior.free).index(len(fit.p) - 2 + k) for k in (0, 1)]
    c = fit.covariance[np.ix_(at, at)]
    x = 3.0 * np.radians(curve.x)
    by = np.column_stack([np.sin(x), np.cos(x)])
    expected = 1e6 * np.sqrt(np.einsum("nc,cd,nd->n", by, c, by))  # a tooth's a sin + b cos, in urad
    np.testing.assert_allclose(curve.std, expected, rtol=1e-6)
    assert curve.y_title == "shift [µrad]" and curve.title == "displacement of q1" and len(curve.x) == 721


def test_a_coefficient_that_is_held_adds_nothing_to_the_band(machine: Machine) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    diagnosis = found(machine, [term], turning(2))
    fit = diagnosis.after
    sigma = fit.prior.sigma.copy()
    sigma[-1] = 0.0
    held = replace(
        fit, prior=fit.prior.with_sigma(sigma), factor=np.delete(fit.factor, len(fit.prior.free) - 1, 1)
    )
    (curve,) = curves(replace(diagnosis, after=held), diagnosis.findings[0])
    still = np.abs(np.sin(3.0 * np.radians(curve.x))) < 1e-9
    assert still.any() and curve.std[~still].min() > 0.0
    np.testing.assert_allclose(curve.std[still], 0.0, atol=1e-6 * curve.std.max())


# -- which are drawn ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("count", "ports"), [(1, 3), (6, 3), (7, 1)])
def test_of_seven_findings_or_more_each_has_its_largest_port_alone(
    machine: Machine, count: int, ports: int
) -> None:
    """The largest beside what a row can say of it comes first; of fewer findings three ports are drawn."""
    term = with_effect(machine, "axis-wobble", ("q1",), None, **{})
    term = term.with_values([1e-4 * (k + 1) for k in range(len(term.coefficients))])
    diagnosis = found(machine, [term], turning(2))
    findings = list(diagnosis.findings) * count
    every = all_curves(diagnosis, findings)
    assert len(every) == count
    most = curves(diagnosis, findings[0])
    for own in every:
        assert [curve.title for curve in own] == [curve.title for curve in most[:ports]]
    assert 1 < len(most) <= 3


def test_ports_come_by_how_large_they_are_beside_what_a_row_can_say(machine: Machine) -> None:
    """Rows scatter; what shifts far, but is hardly seen, comes after what shifts less and is seen well."""
    term = with_effect(machine, "axis-wobble", ("q1",), None)
    term = term.with_values([1e-4, -3e-4])
    diagnosis = found(machine, [term], turning(2))
    fit = diagnosis.after
    noisy = fit.residual + np.random.default_rng(9).normal(size=fit.residual.shape)
    seen = replace(diagnosis.recording, observations=_shifted(diagnosis.recording.observations, noisy))
    own = replace(diagnosis, recording=seen)
    named = [port for port in machine.ports if port.startswith("q1.")]
    ((*shifts,),) = all_port_shifts(fit, seen, [([term], named)])
    worth = {
        s.port: np.nanmax(np.abs(s.fitted)) / np.nanmedian(np.abs(s.rows - s.fitted))
        for s in shifts
        if np.nanmax(np.abs(s.fitted)) > 0.0
    }
    assert len(worth) > 1
    best = [
        f"error motion {port.rpartition('.')[2]} of q1"
        for port in sorted(worth, key=lambda port: -worth[port])
    ]
    assert [curve.title for curve in curves(own, own.findings[0])] == best[:3]


def _shifted(observations: Mapping[str, Array], residual: Array) -> dict[str, Array]:
    """Readings x, y, z with as many hundredths of a mm more."""
    return {name: values + 0.01 * residual[:, k] for k, (name, values) in enumerate(observations.items())}


def test_the_first_twenty_findings_are_drawn(machine: Machine) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    diagnosis = found(machine, [term], turning(2))
    every = all_curves(diagnosis, list(diagnosis.findings) * 22, np.arange(5))
    assert [len(own) for own in every] == [1] * 20 + [0] * 2


def test_what_is_not_in_the_fit_is_not_drawn(machine: Machine) -> None:
    """Beside what is; nor a finding without terms."""
    one = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    other = with_effect(machine, "transmission-error", ("q2",), {"order": 2.0}, a=3e-4, b=-1e-4)
    diagnosis = found(machine, [one], turning(2))
    findings = [replace(gear_finding(), place=(name,)) for name in ("q2", "q1")]
    assert [len(own) for own in all_curves(diagnosis, findings)] == [0, 1]
    unfitted = replace(diagnosis, terms=(other, one))
    assert [len(own) for own in all_curves(unfitted, findings)] == [0, 1]
    assert all_curves(diagnosis, []) == []


def test_some_rows_say_what_they_say_among_all(machine: Machine) -> None:
    term = with_effect(machine, "transmission-error", ("q1",), {"order": 3.0}, a=3e-4, b=-1e-4)
    diagnosis = found(machine, [term], turning(2))
    rows = np.array([2, 11, 50], dtype=np.intp)
    ((some,),) = all_curves(diagnosis, diagnosis.findings, rows)
    (whole,) = curves(diagnosis, diagnosis.findings[0])
    assert some.rows is not None and whole.rows is not None
    np.testing.assert_allclose(some.rows[rows], whole.rows[rows], rtol=1e-9)
    assert np.isnan(np.delete(some.rows, rows)).all()
    np.testing.assert_array_equal(some.y, whole.y)


# -- against what ------------------------------------------------------------------------------------


@pytest.mark.parametrize("levels", [3, 7, ROWS])
def test_a_driver_that_takes_a_few_values_again_and_again_is_drawn_as_a_line(
    tmp_path: Path, levels: int
) -> None:
    """The fitted value is the same wherever the driver is: each value is a point of the line."""
    machine = written(tmp_path, ARM)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": 0.0}, alpha=2e-5)
    values = np.linspace(18.0, 35.0, levels)
    warm = np.random.default_rng(1).permutation(np.resize(values, ROWS))
    every = drawn(machine, term, turning(3), drivers={"temperature.link2": warm})
    curve = largest(every)
    np.testing.assert_array_equal(curve.x, values)
    assert curve.fitted is None and len(curve.y) == len(curve.std) == levels
    on_the_line(curve, atol=1e-3)


@pytest.mark.parametrize(("lag", "line"), [(40.0, True), (94.0, False)])
def test_a_lag_up_to_a_twentieth_of_the_range_is_drawn_as_a_line(
    tmp_path: Path, lag: float, line: bool
) -> None:
    """Warmed up and cooled down at one rate, a part is late by rate times lag on either way: 3 and 7 % of the range apart."""
    machine = written(tmp_path, ARM)
    up = np.linspace(20.0, 30.0, ROWS // 2)
    drivers, time = {"temperature.link2": np.concatenate([up, up[::-1]])}, 60.0 * np.arange(ROWS)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": lag}, alpha=2e-5)
    every = drawn(machine, term, turning(3), drivers=drivers, time=time)
    curve = largest(every)
    assert (len(curve.x) > 0) is line and (curve.fitted is None) is line


def test_each_leg_is_drawn_against_its_own_thermometer(tmp_path: Path) -> None:
    """Of those that vary, however little, the one that it follows most; another leg's may stand still."""
    machine = written(tmp_path, GOUGH)
    legs = tuple(limb.name for limb in machine.mechanism.limbs)
    rng = np.random.default_rng(6)
    warm = {f"temperature.{leg}": 22.0 + 0.4 * rng.random(ROWS) for leg in legs}
    warm["temperature.leg6"] = np.full(ROWS, 20.0)  # at which nothing grows
    term = with_effect(machine, "thermal-expansion", legs, {"lag": 0.0, "thermometer": 0.0}, alpha=2e-5)
    every = drawn(machine, term, rng.uniform(-0.5, 0.5, (ROWS, 6)), drivers=warm)
    assert len(every) == 3
    for curve in every:
        leg = curve.title.replace("displacement of m", "leg")
        assert curve.x_title == f"temperature.{leg} [°C]"
        np.testing.assert_array_equal(curve.measured, warm[f"temperature.{leg}"])
        assert np.array_equal(curve.x, np.sort(curve.measured))
        on_the_line(curve, atol=0.01)


def test_play_has_two_ends(machine: Machine) -> None:
    side = np.where(np.random.default_rng(8).random(ROWS) < 0.5, -1.0, 1.0)
    term = with_effect(machine, "backlash", ("q1",), {}, b=4e-4)
    (curve,) = drawn(machine, term, turning(2), drivers={"approach.q1": side})
    assert curve.x_title == "approach.q1 [±1]" and curve.fitted is None
    assert curve.x.tolist() == [-1.0, 1.0]
    np.testing.assert_allclose(curve.y, [200.0, -200.0])
    assert curve.std[0] == pytest.approx(curve.std[1]) and curve.std[0] > 0.0
    on_the_line(curve, atol=0.01)


def test_what_lags_behind_its_driver_is_no_function_of_it(tmp_path: Path) -> None:
    """The fit's value in each row stands there instead, beside what the row says."""
    machine = written(tmp_path, ARM)
    time = 60.0 * np.arange(ROWS)
    warm = 25.0 + 5.0 * np.sin(time / 400.0)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": 900.0}, alpha=2e-5)
    curve = largest(drawn(machine, term, turning(3), drivers={"temperature.link2": warm}, time=time))
    assert len(curve.x) == len(curve.y) == len(curve.std) == 0
    assert curve.x_title == "temperature.link2 [°C]" and np.array_equal(curve.measured, warm)
    assert curve.fitted is not None and curve.rows is not None
    np.testing.assert_allclose(curve.fitted, curve.rows, atol=1e-3)
    assert np.ptp(curve.fitted) > 50.0  # um
    few = curve.thinned(np.array([4, 9], dtype=np.intp))
    assert few.fitted is not None and few.rows is not None
    np.testing.assert_array_equal(few.fitted, curve.fitted[[4, 9]])
    np.testing.assert_array_equal(few.rows, curve.rows[[4, 9]])


def test_a_joint_read_in_turns_has_a_period_of_one(tmp_path: Path) -> None:
    machine = written(tmp_path, GOUGH)
    motor = machine.mechanism.readings[0]
    term = with_effect(machine, "screw-periodic", (motor,), {"harmonic": 1.0}, a=2e-3, b=1e-3)
    rng = np.random.default_rng(5)
    q = rng.uniform(-0.1, 0.1, (ROWS, 6))
    q[:, 0] = np.linspace(-3.0, 3.0, ROWS)
    (curve,) = drawn(machine, term, q)
    assert curve.x_title == f"{motor}, folded over 1 [turn]"
    assert curve.x[-1] - curve.x[0] == pytest.approx(1.0)
