"""Laws of what a finding's pictures show: the formula and what rows say agree, folded over a period, by its own driver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.effect_machines import ARM, STAGE
from support.effects import with_effect
from support.exact_fits import fit_at, read
from support.moving_machines import record, written
from support.reports import arm, gear_finding, synthetic
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.report.curves import Curve, curves
from truepose.models.effects.base import PlacedEffect
from truepose.models.machine import Machine

Array = NDArray[np.float64]
ROWS = 90
TURN = 2 * np.pi


def drawn(machine: Machine, term: PlacedEffect, q: Array, **more: Any) -> list[Curve]:
    """What is drawn of a term that was found, from exact readings at q (n, nq)."""
    recording = read(machine, record(machine, q, **more), [term])
    fit = fit_at(machine, recording, [term])
    finding = replace(gear_finding(), effect=term.effect.slug, place=term.place)
    diagnosis = synthetic(machine)
    return curves(
        replace(diagnosis, recording=recording, after=fit, terms=(term,), findings=(finding,)), finding
    )


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


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return arm(tmp_path_factory.mktemp("machine"))


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


def test_a_screw_is_folded_over_its_pitch(tmp_path: Path) -> None:
    machine = written(tmp_path, STAGE)
    term = with_effect(machine, "screw-periodic", ("s1",), {"order": 1.0}, a=2e-3, b=1e-3)
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
    found = drawn(machine, term, turning(3), drivers={"temperature.link2": warm, "temperature.base": other})
    curve = max(found, key=lambda c: float(np.ptp(c.y)))
    assert curve.x_title == "temperature.link2 [°C]"
    assert np.array_equal(curve.measured, warm)
    by = float(np.polyfit(curve.x, curve.y, 1)[0]) * 1e-3  # um
    lengths = {p.name: p.nominal for p in machine.parameters}
    assert by == pytest.approx(2e-5 * lengths[curve.title], rel=1e-6)
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
    found = drawn(machine, term, turning(2))
    assert 1 <= len(found) <= 3
    for curve in found:
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
