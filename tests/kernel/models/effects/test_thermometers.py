"""Thermometers of other places: which of them say something of their own, and what stands for air that nobody measured."""

from __future__ import annotations

import numpy as np
import pytest

from support.effect_machines import Machines
from support.effects import position, shift_slopes, with_effect
from truepose.models.effect_text import parse_effect
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.effects.sights import others

CLOCK = np.linspace(0.0, 7200.0, 40)
WARM, COOL = 25 + 3 * np.sin(CLOCK / 900), 21 + CLOCK / 7200


def test_thermometers_that_say_the_same_are_one(machines: Machines) -> None:
    seen = {
        "time": CLOCK,
        "temperature.air": COOL,
        "temperature.leg1": WARM,
        "temperature.leg2": 2 * WARM - 7,
        "temperature.base": COOL + 1,
        "temperature.tool": np.full(40, 20.0),
        "payload": WARM,
    }
    machine = machines["telescope"]
    assert others(machine, [], seen) == ["temperature.leg1", "temperature.base"]
    assert others(machine, ["temperature.leg1"], seen) == ["temperature.base"]
    effect = effects.get("thermal-expansion", "test")()
    settings = effect.elsewhere(machine, ("leg1",), seen)
    assert [s["lag"] for s in settings] == [0.0, 900.0, 3600.0]
    assert {key for s in settings for key in s} == {"lag", "from.temperature.base"}
    assert all(s["from.temperature.base"] == pytest.approx(np.mean(COOL) + 1, abs=1e-3) for s in settings)
    # a place without a thermometer is served by the air's, and the others are elsewhere
    apart = effect.elsewhere(machine, ("leg3",), {**seen, "temperature.base": 30 - COOL**2})
    assert {tuple(s) for s in apart} == {("lag", "from.temperature.leg1")}
    assert not effect.elsewhere(machine, ("leg1",), {"time": CLOCK, "temperature.leg1": WARM})


def test_heat_from_elsewhere_counts_from_its_setting(machines: Machines) -> None:
    arm, q = machines["arm"], np.array([0.3, -0.4, 0.5])
    proxy = {"lag": 900.0, "from.temperature.base": 24.0}
    heated = with_effect(arm, "thermal-expansion", ("link2",), proxy, alpha=3e-5)
    assert heated.drivers == ("temperature.base~900",) and heated.kind == "temperature"
    cold = position(arm, q)
    np.testing.assert_allclose(position(arm, q, heated, temperature=24.0), cold, atol=1e-10)
    own = with_effect(arm, "thermal-expansion", ("link2",), alpha=3e-5)
    there = position(arm, q, heated, temperature=31.0)
    np.testing.assert_allclose(there, position(arm, q, own, temperature=27.0), atol=1e-10)
    said = heated.effect.explain(arm, heated.place, heated.settings_map)
    assert "temperature.base, a thermometer elsewhere, 900 s behind it" in said
    named = parse_effect("thermal-expansion@link2:alpha=3e-5,from.temperature.base=24,lag=900", arm)
    assert (named.label, named.drivers) == (heated.label, heated.drivers)


def test_air_is_known_by_any_temperature_or_by_its_path_alone(machines: Machines) -> None:
    machine, effect = machines["telescope"], effects.get("air-refraction", "test")()
    (sensor, *_) = effect.places(machine)
    seen = {"time": CLOCK, "temperature.leg1": WARM}
    settings = effect.elsewhere(machine, sensor, seen)
    assert [effect.drivers(machine, sensor, s) for s in settings] == [
        ("temperature.leg1",),
        ("temperature.leg1", "pressure"),
        (),
    ]
    assert not effect.elsewhere(machine, sensor, {**seen, "temperature.air": COOL})
    assert (
        all(PlacedEffect.at(effect, machine, sensor, s).borrows for s in settings)
        and effect.weight(settings[-1]) < 1.0
    )
    # weather that stands still is a scale of the sensor
    still = shift_slopes(machine, with_effect(machine, "air-refraction", sensor, settings[-1]))
    scale = shift_slopes(machine, with_effect(machine, "sensor-scale", sensor))
    assert still.keys() == scale.keys()
    for port, slope in still.items():
        np.testing.assert_allclose(slope, scale[port])
