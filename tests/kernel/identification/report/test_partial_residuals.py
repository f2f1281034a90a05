"""Laws of partial residuals: with exact readings every row says what the effect's formula says, at each port by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import truepose.models
from support.effect_machines import read_machines
from support.effects import with_effect
from support.exact_fits import fit_at, formula_of, posed, read
from truepose.identification.fit.estimated import Estimate
from truepose.identification.recording.load import load_recording
from truepose.identification.recording.recording import Recording
from truepose.identification.report.partial_residuals import PortShift
from truepose.identification.report.partial_residuals import port_shifts as shifts_of
from truepose.models.effects.base import PlacedEffect
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
BUNDLED = Path(truepose.models.__path__[0]) / "machines"


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "partial")


Told = tuple[str, str, tuple[str, ...], dict[str, float], dict[str, float]]
EFFECTS: list[Told] = [
    ("arm", "transmission-error", ("q1",), {"order": 3.0}, {"a": 3e-4, "b": -1e-4}),
    ("arm", "axis-wobble", ("q1",), {}, {"a": 2e-4, "b": 1e-4}),
    ("arm", "thermal-expansion", ("link2",), {"lag": 0.0}, {"alpha": 2e-5}),
    ("arm", "joint-compliance", ("q2",), {}, {"c": 2e-6}),
    ("arm", "sensor-scale", ("sensor",), {}, {"s": 5e-5}),
    ("telescope", "thermal-expansion", ("leg2",), {"lag": 0.0}, {"alpha": 2e-5}),
    ("telescope", "screw-periodic", ("rho4",), {"harmonic": 1.0}, {"a": 2e-3, "b": 1e-3}),
    ("telescope", "leg-compliance", ("leg1",), {}, {"c": 1e-4}),
    ("gough", "leg-compliance", ("leg1", "leg2", "leg3", "leg4", "leg5", "leg6"), {}, {"c": 1e-4}),
    ("graph", "joint-compliance", ("shoulder",), {}, {"c": 2e-6}),
    ("camera", "transmission-error", ("q2",), {"order": 2.0}, {"a": 3e-4, "b": -1e-4}),
]


def placed(machines: Mapping[str, Machine], told: Told) -> tuple[Machine, PlacedEffect]:
    name, slug, place, settings, values = told
    machine = machines[name]
    return machine, with_effect(machine, slug, place, settings, **values)


def port_shifts(
    fit: Estimate, recording: Recording, terms: Sequence[PlacedEffect], rows: NDArray[np.intp] | None = None
) -> list[PortShift]:
    """Of one group of terms."""
    return shifts_of(fit, recording, [terms], rows)[0]


def agree(shifts: Sequence[PortShift], truth: Mapping[str, Array]) -> None:
    assert shifts and {shift.port for shift in shifts} <= truth.keys()
    for shift in shifts:
        expected = truth[shift.port]
        size = float(np.max(np.abs(expected)))
        said = np.isfinite(shift.fitted)
        assert said.any()
        # loads change a little with what they bend
        np.testing.assert_allclose(shift.fitted[said], expected[said], rtol=1e-4, atol=1e-9 * size)
        np.testing.assert_allclose(shift.rows[said], shift.fitted[said], rtol=1e-6, atol=1e-6 * size)
        assert np.array_equal(np.isnan(shift.rows), ~said)
        assert ((shift.std[said] > 0.0) == (shift.fitted[said] != 0.0)).all()


@pytest.mark.parametrize("told", EFFECTS, ids=lambda told: f"{told[1]} at {told[2][0]} of {told[0]}")
def test_rows_say_what_the_formula_says(machines: Mapping[str, Machine], told: Told) -> None:
    machine, term = placed(machines, told)
    recording = read(machine, posed(machine), [term])
    truth = formula_of(machine, recording, [term])
    shifts = port_shifts(fit_at(machine, recording, [term]), recording, [term])
    agree(shifts, truth)


def test_rows_say_the_truth_where_the_fit_misses_it(machines: Mapping[str, Machine]) -> None:
    """To first order: the fitted value is wrong, and each row's residual mends it."""
    machine, term = placed(machines, EFFECTS[0])
    recording = read(machine, posed(machine), [term])
    truth = formula_of(machine, recording, [term])["q1.displacement"]
    away = np.zeros(len(machine.parameters) + 2)
    away[-2:] = (2e-5, 1e-5)
    (shift,) = port_shifts(fit_at(machine, recording, [term], away), recording, [term])
    assert np.max(np.abs(shift.fitted - truth)) > 5e-6
    np.testing.assert_allclose(shift.rows, truth, atol=2e-9)


def test_two_terms_at_one_port_are_added(machines: Mapping[str, Machine]) -> None:
    machine, one = placed(machines, EFFECTS[0])
    two = with_effect(machine, "transmission-error", ("q1",), {"order": 1.0}, a=-2e-4, b=4e-4)
    recording = read(machine, posed(machine), [one, two])
    fit = fit_at(machine, recording, [one, two])
    (both,) = port_shifts(fit, recording, [one, two])
    single = [port_shifts(fit, recording, [term])[0] for term in (one, two)]
    np.testing.assert_allclose(both.fitted, single[0].fitted + single[1].fitted, atol=1e-15)
    truth = formula_of(machine, recording, [one])["q1.displacement"]
    np.testing.assert_allclose(single[0].rows, truth, atol=1e-9)


def test_std_is_that_of_the_formula_and_scales_with_the_noise(machines: Mapping[str, Machine]) -> None:
    machine, term = placed(machines, EFFECTS[0])
    recording = read(machine, posed(machine), [term])
    fit = fit_at(machine, recording, [term])
    (shift,) = port_shifts(fit, recording, [term])
    at = [list(fit.prior.free).index(k) for k in (len(fit.p) - 2, len(fit.p) - 1)]
    c = fit.covariance[np.ix_(at, at)]
    q = recording.q[:, 0]
    f = np.column_stack([np.sin(3 * q), np.cos(3 * q)])
    np.testing.assert_allclose(shift.std, np.sqrt(np.einsum("nk,kl,nl->n", f, c, f)), rtol=1e-6)
    wider = replace(fit)
    object.__setattr__(wider, "root", 3.0 * fit.root)  # covariance: nine times as wide
    (three,) = port_shifts(wider, recording, [term])
    np.testing.assert_allclose(three.std, 3.0 * shift.std)
    assert np.array_equal(three.rows, shift.rows)


def test_lost_readings_say_nothing_and_the_rest_of_a_row_still_does(machines: Mapping[str, Machine]) -> None:
    machine, term = placed(machines, EFFECTS[0])
    recording = read(machine, posed(machine), [term])
    truth = formula_of(machine, recording, [term])["q1.displacement"]
    gone = {name: values.copy() for name, values in recording.observations.items()}
    for values in gone.values():
        values[5] = np.nan
    gone["x"][9] = np.nan
    part = replace(recording, observations=gone)
    (shift,) = port_shifts(fit_at(machine, part, [term]), part, [term])
    assert np.flatnonzero(np.isnan(shift.rows)).tolist() == [5]
    assert np.isnan([shift.fitted[5], shift.std[5]]).all()
    np.testing.assert_allclose(shift.rows[9], truth[9], rtol=1e-5)


def test_of_many_rows_some_are_asked(
    machines: Mapping[str, Machine],
) -> None:
    machine, term = placed(machines, EFFECTS[0])
    recording = read(machine, posed(machine), [term])
    fit = fit_at(machine, recording, [term])
    (every,) = port_shifts(fit, recording, [term])
    wanted = np.array([0, 3, 4, 9, len(recording) - 1])
    (some,) = port_shifts(fit, recording, [term], wanted)
    known = np.isfinite(some.rows)
    assert np.flatnonzero(known).tolist() == wanted.tolist()
    for name in ("fitted", "std", "rows"):
        np.testing.assert_allclose(getattr(some, name)[known], getattr(every, name)[known], rtol=1e-9)
        assert np.array_equal(np.isfinite(getattr(some, name)), known)


def test_a_port_that_is_seen_by_rounding_alone_is_left_out(machines: Mapping[str, Machine]) -> None:
    """A ball joint that is off across its limb moves nothing else."""
    machine = machines["hybrid"]
    term = with_effect(machine, "joint-runout", ("s1",), {"first": 0.0})
    term = term.with_values([0.03 * c.scale for c in term.coefficients])
    recording = read(machine, posed(machine, 8), [term])
    shifts = port_shifts(fit_at(machine, recording, [term]), recording, [term])
    for shift in shifts:
        known = np.isfinite(shift.rows)
        np.testing.assert_allclose(shift.rows[known], shift.fitted[known], atol=1e-6)
    assert 0 < len(shifts) < 3


def test_a_sensor_that_compares_rows_is_asked_of_each_row_by_itself() -> None:
    """The nanopositioner reads the change of one length since an earlier row: a shift of both leaves it as it is."""
    machine = load_machine(BUNDLED / "nanopositioner" / "machine.yaml")
    whole = load_recording(machine, BUNDLED / "nanopositioner" / "recording.csv")
    assert all(sensor.compares for sensor in machine.sensors)
    term = with_effect(machine, "actuator-scale", ("q2",), None, s=1e-3)
    recording = read(machine, whole, [term])
    fit = fit_at(machine, recording, [term])
    assert np.max(np.abs(fit.residual)) < 1e-6
    (shift,) = port_shifts(fit, recording, [term])
    told = np.flatnonzero(np.isfinite(shift.rows))
    assert recording.from_row is not None
    assert np.isnan(shift.rows[recording.from_row == np.arange(len(recording))]).all()
    assert len(told) > 0.9 * len(recording)
    np.testing.assert_allclose(shift.fitted[told], 1e-3 * recording.q[told, 1], rtol=1e-9)
    np.testing.assert_allclose(shift.rows[told], 1e-3 * recording.q[told, 1], atol=1e-9)
    one = int(told[100])
    moved = {name: values.copy() for name, values in recording.observations.items()}
    moved["dL"][one] -= 1e-5  # q2 runs along the light
    part = replace(recording, observations=moved)
    (other,) = port_shifts(fit_at(machine, part, [term]), part, [term])
    changed = other.rows - shift.rows
    # whoever refers to this row says the contrary
    assert abs(changed[one]) == pytest.approx(1e-5, rel=0.01)
