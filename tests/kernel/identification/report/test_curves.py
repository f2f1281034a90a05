"""Laws of what a finding's pictures show: the formula and what rows say agree, folded over a period, by its own driver."""

from __future__ import annotations

from collections.abc import Sequence
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
from truepose.identification.report.curves import Curve, all_curves
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
    """What is drawn of a term that was found; rows say what was fitted."""
    diagnosis = found(machine, [term], q, **more)
    (curves,) = all_curves(diagnosis, diagnosis.findings)
    for curve in curves:
        known = np.isfinite(curve.rows)
        size = float(np.ptp(curve.fitted[known]))
        assert known.any()
        np.testing.assert_allclose(curve.rows[known], curve.fitted[known], atol=1e-4 * size + 1e-9)
        assert (np.diff(curve.x[curve.line]) > 0.0).all()
    return curves


def largest(every: Sequence[Curve]) -> Curve:
    """The port that shifts farthest."""
    return max(every, key=lambda c: float(np.nanmax(np.abs(c.rows))))


def tooth(machine: Machine, order: float) -> PlacedEffect:
    return with_effect(machine, "transmission-error", ("q1",), {"order": order}, a=3e-4, b=-1e-4)


def turning(joints: int, turns: float = 1.0, rows: int = ROWS) -> Array:
    """The first joint over so many turns, the others somewhere."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-0.5, 0.5, (rows, joints))
    q[:, 0] = np.linspace(-0.5 * turns * TURN, 0.5 * turns * TURN, rows)
    return q


@pytest.mark.parametrize("order", [2.0, 3.0, 7.0, 121.0, 242.0])
def test_periods_are_folded_onto_one(machine: Machine, order: float) -> None:
    q = turning(2)
    (curve,) = drawn(machine, tooth(machine, order), q)
    period = 360.0 / order
    assert curve.x_title == f"q1, folded over {period:.4g} [°]"
    assert (curve.title, curve.y_title) == ("displacement of q1", "shift [µrad]")
    assert np.ptp(curve.x) <= period
    whole = (np.degrees(q[:, 0]) - curve.x) / period
    np.testing.assert_allclose(whole, np.round(whole), atol=1e-9)
    assert len(np.unique(np.round(whole))) >= min(order, ROWS // 2)
    x = order * np.radians(curve.x)
    np.testing.assert_allclose(curve.fitted, 1e6 * (3e-4 * np.sin(x) - 1e-4 * np.cos(x)), atol=1e-6)
    assert len(curve.line) == len(np.unique(curve.x))


@pytest.mark.parametrize(
    ("order", "turns", "folded"),
    [(3.0, 0.3, False), (3.0, 0.49, False), (3.0, 0.51, True), (3.0, 0.9, True), (1.0, 1.0, False)],
)
def test_little_more_than_a_period_is_not_folded(
    machine: Machine, order: float, turns: float, folded: bool
) -> None:
    (curve,) = drawn(machine, tooth(machine, order), turning(2, turns))
    assert ("folded" in curve.x_title) is folded
    assert np.ptp(curve.x) <= 120.0 if folded else np.ptp(curve.x) == pytest.approx(360.0 * turns)


def test_two_waves_have_the_period_that_both_share(machine: Machine) -> None:
    """A third of a turn is the period of one alone, half a turn of the other; the whole turn is of both."""
    diagnosis = found(machine, [tooth(machine, 2.0), tooth(machine, 3.0)], turning(2, 3.0))
    ((curve,),) = all_curves(diagnosis, diagnosis.findings[:1])
    assert curve.x_title == "q1, folded over 360 [°]" and 350.0 < np.ptp(curve.x) <= 360.0


@pytest.mark.parametrize(
    ("file", "joint", "reach", "title"),
    [(STAGE, 0, 40.0, "s1, folded over 5 [mm]"), (GOUGH, 0, 3.0, "m1, folded over 1 [turn]")],
)
def test_a_screw_is_folded_over_its_pitch(
    file: str, joint: int, reach: float, title: str, tmp_path: Path
) -> None:
    """Of a joint that is read in turns that is one turn."""
    machine = written(tmp_path, file)
    readings = machine.mechanism.readings
    term = with_effect(machine, "screw-periodic", (readings[joint],), {"harmonic": 1.0}, a=2e-3, b=1e-3)
    q = np.random.default_rng(5).uniform(-0.005, 0.005, (ROWS, len(readings)))
    q[:, joint] = np.linspace(-reach, reach, ROWS)
    (curve,) = drawn(machine, term, q)
    assert curve.x_title == title


def test_growth_by_heat_is_drawn_against_its_own_thermometer(tmp_path: Path) -> None:
    machine = written(tmp_path, ARM)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": 0.0}, alpha=2e-5)
    warm = np.random.default_rng(1).permutation(np.linspace(18.0, 35.0, ROWS))
    other = np.random.default_rng(2).uniform(18.0, 35.0, ROWS)
    every = drawn(machine, term, turning(3), drivers={"temperature.link2": warm, "temperature.base": other})
    curve = largest(every)
    assert curve.x_title == "temperature.link2 [°C]" and np.array_equal(curve.x, warm)
    by = float(np.polyfit(curve.x, curve.fitted, 1)[0]) * 1e-3  # um
    lengths = {p.name: p.nominal for p in machine.parameters}
    assert by == pytest.approx(2e-5 * lengths[curve.title], rel=1e-6)
    share = curve.std / np.abs(curve.fitted)  # how well the one coefficient is known
    assert share.min() > 0.0 and np.ptp(share) < 1e-6 * share.max()


def test_giving_way_is_drawn_against_the_load(tmp_path: Path) -> None:
    machine = written(tmp_path, ARM)
    term = with_effect(machine, "joint-compliance", ("q2",), {}, c=2e-6)
    recording = read(machine, record(machine, turning(3)), [term])
    (curve,) = drawn(machine, term, recording.q)
    assert curve.x_title == "load [N·m]"
    bare = Predictor(machine, recording, ports=True)
    load = bare.loads(bare.model.p_home, np.zeros((ROWS, 0)))["q2.displacement"]
    np.testing.assert_allclose(curve.x, load, rtol=1e-3, atol=1e-3 * np.ptp(load))
    assert float(np.polyfit(curve.x, curve.fitted, 1)[0]) == pytest.approx(2e-6 * 1e6, rel=1e-3)


def test_what_several_joints_drive_is_drawn_against_itself(machine: Machine) -> None:
    every = drawn(machine, with_effect(machine, "sensor-scale", ("sensor",), None, s=1e-4), turning(2))
    assert 1 <= len(every) <= 3
    for curve in every:
        assert curve.x_title.startswith("fitted shift") and np.array_equal(curve.x, curve.fitted)


def test_a_coefficient_that_is_held_adds_nothing_to_the_band(machine: Machine) -> None:
    diagnosis = found(machine, [tooth(machine, 3.0)], turning(2))
    fit = diagnosis.after
    sigma = fit.prior.sigma.copy()
    sigma[-1] = 0.0
    held = replace(
        fit, prior=fit.prior.with_sigma(sigma), factor=np.delete(fit.factor, len(fit.prior.free) - 1, 1)
    )
    ((curve,),) = all_curves(replace(diagnosis, after=held), diagnosis.findings)
    by = np.abs(np.sin(3.0 * np.radians(curve.x)))
    np.testing.assert_allclose(curve.std / curve.std.max(), by / by.max(), atol=1e-6)


@pytest.mark.parametrize(("count", "ports"), [(1, 3), (6, 3), (7, 1)])
def test_of_seven_findings_or_more_each_has_its_largest_port_alone(
    machine: Machine, count: int, ports: int
) -> None:
    """The largest beside what a row can say of it comes first; of fewer findings three ports are drawn."""
    term = with_effect(machine, "axis-wobble", ("q1",), None)
    diagnosis = found(machine, [term.with_values([1e-4, -3e-4])], turning(2))
    read_, rng = diagnosis.recording, np.random.default_rng(9)
    noisy = {name: values + 0.01 * rng.normal(size=ROWS) for name, values in read_.observations.items()}
    diagnosis = replace(diagnosis, recording=replace(read_, observations=noisy))
    worth = [
        np.nanmax(np.abs(curve.fitted)) / np.nanmedian(np.abs(curve.rows - curve.fitted))
        for curve in all_curves(diagnosis, diagnosis.findings)[0]
    ]
    assert 1 < len(worth) <= 3 and worth == sorted(worth, reverse=True)
    every = all_curves(diagnosis, list(diagnosis.findings) * count)
    assert [len(own) for own in every] == [min(ports, len(worth))] * count


def test_the_first_twenty_findings_are_drawn(machine: Machine) -> None:
    diagnosis = found(machine, [tooth(machine, 3.0)], turning(2))
    every = all_curves(diagnosis, list(diagnosis.findings) * 22, np.arange(5))
    assert [len(own) for own in every] == [1] * 20 + [0] * 2


def test_what_is_not_in_the_fit_is_not_drawn(machine: Machine) -> None:
    """Beside what is; nor a finding without terms."""
    other = with_effect(machine, "transmission-error", ("q2",), {"order": 2.0}, a=3e-4, b=-1e-4)
    diagnosis = found(machine, [tooth(machine, 3.0)], turning(2))
    findings = [replace(gear_finding(), place=(name,)) for name in ("q2", "q1")]
    assert [len(own) for own in all_curves(diagnosis, findings)] == [0, 1]
    unfitted = replace(diagnosis, terms=(other, *diagnosis.terms))
    assert [len(own) for own in all_curves(unfitted, findings)] == [0, 1]
    assert all_curves(diagnosis, []) == []


@pytest.mark.parametrize("levels", [3, 7, ROWS])
def test_a_driver_that_takes_a_few_values_again_and_again_is_drawn_as_a_line(
    tmp_path: Path, levels: int
) -> None:
    """The fitted value is the same wherever the driver is: each value is a point of the line."""
    machine = written(tmp_path, ARM)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": 0.0}, alpha=2e-5)
    values = np.linspace(18.0, 35.0, levels)
    warm = np.random.default_rng(1).permutation(np.resize(values, ROWS))
    curve = largest(drawn(machine, term, turning(3), drivers={"temperature.link2": warm}))
    np.testing.assert_array_equal(curve.x[curve.line], values)


@pytest.mark.parametrize(("lag", "line"), [(40.0, True), (94.0, False)])
def test_a_lag_up_to_a_twentieth_of_the_range_is_drawn_as_a_line(
    tmp_path: Path, lag: float, line: bool
) -> None:
    """Warmed up and cooled down at one rate, a part is late by rate times lag on either way: 3 and 7 % of the range apart."""
    machine = written(tmp_path, ARM)
    up = np.linspace(20.0, 30.0, ROWS // 2)
    drivers, time = {"temperature.link2": np.concatenate([up, up[::-1]])}, 60.0 * np.arange(ROWS)
    term = with_effect(machine, "thermal-expansion", ("link2",), {"lag": lag}, alpha=2e-5)
    curve = largest(drawn(machine, term, turning(3), drivers=drivers, time=time))
    assert (len(curve.line) > 0) is line


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
        np.testing.assert_array_equal(curve.x, warm[f"temperature.{leg}"])
        assert np.array_equal(curve.line, np.argsort(curve.x))


def test_play_has_two_ends(machine: Machine) -> None:
    side = np.where(np.random.default_rng(8).random(ROWS) < 0.5, -1.0, 1.0)
    term = with_effect(machine, "backlash", ("q1",), {}, b=4e-4)
    (curve,) = drawn(machine, term, turning(2), drivers={"approach.q1": side})
    assert curve.x_title == "approach.q1 [±1]"
    assert curve.x[curve.line].tolist() == [-1.0, 1.0]
    np.testing.assert_allclose(curve.fitted[curve.line], [200.0, -200.0])
