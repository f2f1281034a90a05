"""Sizes that effects state against those they expect, what they find worth looking for, and what they say they found."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from support.effect_machines import READINGS, read_machines
from support.effects import Campaign, Solved, position, with_effect
from truepose.models.effects.base import Effect, effects
from truepose.models.effects.common import ARCSEC, centre_and_half, own_offset, piezo_like
from truepose.models.effects.piezo_hysteresis import THRESHOLDS
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]


def effect(slug: str) -> Effect:
    return effects.get(slug, "test")()


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "effect_sizes")


def opening(threshold: float) -> float:
    """Of a stop operator's loop over the whole range, as a part of it: largest way up less way down."""
    half = np.linspace(-1.0, 1.0, 401)
    way, s, states = np.concatenate([half, half[::-1], half, half[::-1]]), 0.0, []
    for step in np.diff(way, prepend=way[0]):
        s = float(np.clip(s + step, -threshold, threshold))
        states.append(s)
    up, down = states[802:1203], states[1203:][::-1]
    return float(np.max(np.subtract(up, down)) / 2.0)


def test_a_piezos_loops_are_of_the_size_that_is_stated(machines: Mapping[str, Machine]) -> None:
    """2 % of the travel for small moves to 15 %: no operator makes more by itself, all together can."""
    hysteresis, stage = effect("piezo-hysteresis"), machines["stage"]
    coefficients = hysteresis.coefficients(stage, ("s3",), {})
    loops = [c.scale * opening(t) for c, t in zip(coefficients, THRESHOLDS, strict=True)]
    assert loops[0] < 0.02 and 0.10 < max(loops) < 0.19 and sum(loops) > 0.15
    assert loops == sorted(loops)
    assert all(c.lower == 0.0 for c in coefficients)


def test_a_piezos_gain_may_have_been_read_at_once_or_after_some_hours(
    machines: Mapping[str, Machine],
) -> None:
    """In steps of half a decade, each of which changes the gain by half of what a decade of creep does."""
    tried = [
        s["since"]
        for s in effect("piezo-creep").settings(machines["stage"], ("s3",), Campaign())
        if "since" in s
    ]
    assert tried[0] == 0.0
    np.testing.assert_allclose(np.diff(np.log10(tried[1:])), 0.5)
    assert tried[1] <= 1.0 and 2.0 < tried[-1] / 3600.0 < 5.0


def test_single_rails_are_wrong_alone_and_several_together(machines: Mapping[str, Machine]) -> None:
    """All rails tilted alike say no more than one rail tilted where there is one rail."""
    telescope = machines["telescope"]
    for legs in (1, 2, 6):
        machine = replace(
            telescope, mechanism=replace(telescope.mechanism, limbs=telescope.mechanism.limbs[:legs])
        )
        together = [place for place in effect("wrong-constant").places(machine) if len(place) > 1]
        assert [len(place) for place in together] == ([] if legs == 1 else [2 * legs])


@pytest.mark.parametrize(
    ("unit", "span", "small"),
    [("mm", 4.9, True), ("mm", 5.1, False), ("rad", 0.19, True), ("rad", 0.21, False)],
)
def test_a_piezo_moves_by_no_more_than_5_mm_or_a_fifth_of_a_radian(
    machines: Mapping[str, Machine], unit: str, span: float, small: bool
) -> None:
    cavity = {a.unit: a for a in machines["cavity"].mechanism.actuators}
    one = replace(cavity[unit], range=(-0.25 * span, 0.75 * span))
    assert piezo_like(one) is small
    assert not piezo_like(replace(one, range=None)) and not piezo_like(replace(one, screw_pitch=2.0))
    assert not piezo_like(replace(one, reading_unit="turn"))
    centre, half = centre_and_half(one)
    assert (centre - half, centre + half) == pytest.approx(one.range)
    assert centre_and_half(replace(one, range=None)) == (0.0, 1.0)


def test_air_stretches_a_path_by_as_many_ppm_as_stated(machines: Mapping[str, Machine]) -> None:
    """-0.92 ppm/K and +0.27 ppm/hPa of the range from the sensor's origin, at 20 degC and 1013.25 hPa."""
    arm, q = machines["arm"], READINGS["arm"]
    air = with_effect(arm, "air-refraction", ("sensor",), share=1.0)
    model = symbolic_model(arm, (air,))

    def reading(warm: float, pressure: float) -> Array:
        return Solved(model, q, **{"temperature.air": warm, "pressure": pressure}).readings

    seen = reading(20.0, 1013.25)
    np.testing.assert_allclose(seen, position(arm, q), atol=1e-9)
    length = np.linalg.norm(seen)
    stated = [float(v) for v in re.findall(r"[+-][0-9.]+(?= ppm)", effect("air-refraction").size)]
    for at, ppm in zip(((21.0, 1013.25), (20.0, 1014.25)), stated, strict=True):
        assert 1e6 * (np.linalg.norm(reading(*at)) / length - 1.0) == pytest.approx(ppm, abs=0.006)


def test_more_refraction_than_there_is_is_doubted_at_three_sigma() -> None:
    """One and a half times all of it is what a thermometer beside the beam may make."""
    for share, doubted in ((1.79, False), (1.81, True), (1.95, True)):
        assert ("thermometer" in effect("air-refraction").found({"share": share}, {"share": 0.1})) is doubted


def test_single_causes_of_refraction_are_half_as_likely_as_the_weather() -> None:
    air = effect("air-refraction")
    assert air.weight({}) == air.weight({"temperature": 1.0, "pressure": 1.0}) == 1.0
    for one in ({"temperature": 0.0}, {"pressure": 0.0}, {"temperature": 1.0, "pressure": 0.0}):
        assert air.weight(one) == 0.5


def test_flexures_are_looked_for_where_there_are_some(machines: Mapping[str, Machine]) -> None:
    shift = effect("flexure-shift")
    for name, bent in (("telescope", True), ("gough", False)):
        machine = machines[name]
        places = shift.places(machine)
        assert all(shift.screened(machine, place) is bent for place in places)
        assert places or not bent
    telescope = machines["telescope"]
    (k,) = shift.coefficients(telescope, ("leg1",), {})
    assert k.scale == 6.0 * (30.0 / 12.0)  # a flexure of constant section lies well within it


def test_a_shift_of_flexures_is_told_as_the_length_of_one() -> None:
    """k = l / 12; what is shorter than a millimetre is no length to speak of."""
    shift = effect("flexure-shift")
    assert "30 mm long" in shift.found({"k": 30.0 / 12.0}, {"k": 0.1})
    assert "1 mm long" in shift.found({"k": 1.01 / 12.0}, {"k": 0.1})
    for k in (0.99 / 12.0, -2.5):
        assert shift.found({"k": k}, {"k": 0.1}) == ""


def test_an_orders_amplitude_is_told_where_it_stands_out_by_two_sigma() -> None:
    gear = effect("transmission-error")
    values, std = {"order": 1.0}, {"order": 1.0}
    for k, arcsec in enumerate((3.0, 40.0, 10.0, 20.0, 1.9, 60.0, 8.0, 5.0, 30.0), start=1):
        values |= {f"a{k}": 0.6 * arcsec / ARCSEC, f"b{k}": -0.8 * arcsec / ARCSEC}
        std |= {f"a{k}": 1.0 / ARCSEC, f"b{k}": 1.0 / ARCSEC}
    said = gear.found(values, std)
    told = [(int(k), int(size)) for k, size in re.findall(r"(\d+) \((\d+) arcsec\)", said)]
    assert told == [(6, 60), (2, 40), (9, 30), (4, 20), (3, 10), (7, 8)]  # the six strongest
    weak = {name: 0.1 * value for name, value in values.items()}
    assert [int(k) for k in re.findall(r"(\d+) \(", gear.found(weak, std))] == [6, 2, 9]
    assert gear.found({name: 0.01 * value for name, value in values.items()}, std) == ""


def test_amplitudes_are_told_whatever_their_phase() -> None:
    for phase in (0.0, 1.0, 2.5, 4.0):
        a, b = np.cos(phase), np.sin(phase)
        wobble = {"a": 30.0 / ARCSEC * a, "b": 30.0 / ARCSEC * b}
        assert effect("axis-wobble").found(wobble, wobble) == "The axis tilts by 30 arcsec."
        more = wobble | {"a2": 1.0, "b2": 1.0}
        assert effect("axis-wobble").found(more, more) == "The axis tilts by 30 arcsec once a turn."
        pin = {"a": 0.012 * a, "b": 0.012 * b}
        assert "radius of 12 um" in effect("joint-runout").found(pin, pin)


def test_effects_are_looked_for_where_the_machine_can_have_them(machines: Mapping[str, Machine]) -> None:
    telescope, gough, stage, arm = (machines[name] for name in ("telescope", "gough", "stage", "arm"))
    windup = effect("screw-windup")
    assert windup.screened(stage, ("s1",)) and not windup.screened(stage, ("s3",))
    deformed = effect("platform-deformation")
    place = next(iter(deformed.places(telescope)))
    assert deformed.screened(telescope, place)  # flexures bend it, with or without loads
    assert deformed.screened(replace(telescope, masses=()), place)
    assert not deformed.screened(replace(gough, masses=()), place)
    runout = effect("joint-runout")
    for machine, seen in ((telescope, False), (gough, True)):
        ends = [place for place in runout.places(machine) if place[0] in machine.mechanism.rod_ends]
        assert all(runout.screened(machine, place) is seen for place in ends)
    scale = effect("actuator-scale")
    assert scale.screened(arm, ("q1",))
    wobble = effect("axis-wobble")
    q1 = arm.mechanism.actuators[0]
    for span, wide in ((0.78, False), (0.79, True)):  # an eighth of a turn
        turned = replace(q1, range=(0.1, 0.1 + span))
        mechanism = replace(arm.mechanism, actuators=(turned, *arm.mechanism.actuators[1:]))
        assert wobble.screened(replace(arm, mechanism=mechanism), ("q1",)) is wide


def test_finer_shapes_are_expected_to_be_shallower() -> None:
    runout, wobble = effect("joint-runout"), effect("axis-wobble")
    for order in (1.0, 2.0, 5.0):
        assert runout.weight({"order": order}) * order == runout.weight({"order": -order}) * order == 1.0
        assert wobble.weight({"orders": order}) * order == 1.0
    assert runout.weight({}) == wobble.weight({}) == 1.0
    gear, give = effect("transmission-error"), effect("joint-compliance")
    assert gear.weight({"orders": 60.0}) == 10.0 * gear.weight({"order": 7.0})
    assert give.weight({"bend": 1.0}) == 0.2 * give.weight({})


def test_lengths_along_the_last_axis_go_with_the_link_that_it_moves(machines: Mapping[str, Machine]) -> None:
    joints = {joint.name: joint for joint in machines["arm"].mechanism.joints}
    for name, joint in joints.items():
        own = own_offset(joint)
        steps = [step for step in joint.placement if step.parameter in own]
        assert all(step.kind == "tz" for step in steps)
        assert any(name in parameter for parameter in own) == bool(own)
    tilted = replace(joints["q3"], axis=(0.0, 1.0, 0.0))
    assert own_offset(joints["q3"]) and own_offset(tilted) == ()
