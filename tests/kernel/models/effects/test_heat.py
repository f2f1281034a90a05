"""Thermal expansion: the parts that stretch together, their lags and their thermometers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from support.effect_machines import READINGS, Machines
from support.effects import Campaign, position, shift_slopes, with_effect
from truepose.models.effects.base import effects


def test_parts_of_a_graph_heat_up_together(machines: Machines) -> None:
    def parts(name: str) -> dict[str, set[str]]:
        lengths = machines[name].mechanism.lengths
        return {part: {port.rsplit(".", 1)[0] for port in ports} for part, ports in lengths.items()}

    assert parts("hybrid")["platform"] == {"mount1", "mount2", "mount3", "q4"}
    assert parts("hybrid")["leg2"] == {"u2b", "q2", "s2"}  # its base point belongs to the base
    crank = {f"a{k}": {f"b{k}", f"p{k}"} for k in (1, 2, 3)}
    # the corner told from the limb's side is part of the platform all the same
    assert parts("planar") == {
        **crank,
        "base": {"a1", "a2", "a3"},
        "platform": {"mount1", "mount2", "mount3"},
    }
    assert parts("graph") == {
        "base": {"waist"},
        "trunk": {"shoulder"},
        "arm": {"boom"},
        "carriage": {"bracket"},
    }
    assert machines["hybrid"].mechanism.limbs[1].platform_point == ("mount2.x", "mount2.y", "mount2.z")


def test_heat_stretches_its_own_place_and_counts_from_20_degrees(machines: Machines) -> None:
    arm, hexapod, alpha = machines["arm"], machines["telescope"], 2e-5
    q = READINGS["arm"]
    cold = position(arm, q)
    for place in effects.get("thermal-expansion", "test")().places(arm):
        heated = with_effect(arm, "thermal-expansion", place, alpha=alpha)
        np.testing.assert_allclose(position(arm, q, heated, temperature=20.0), cold, atol=1e-10)
    ports = {
        place: shift_slopes(arm, with_effect(arm, "thermal-expansion", (place,)))
        for place in ("base", "link1", "link2", "tool")
    }
    assert {place: set(slopes) for place, slopes in ports.items()} == {
        "base": {"q1.r", "q1.d"},
        "link1": {"q2.d"},
        "link2": {"q2.r", "q3.d"},
        "tool": {"tool.x", "tool.y", "tool.z"},
    }
    assert ports["base"]["q1.r"] == pytest.approx(7 * 400)
    base = shift_slopes(hexapod, with_effect(hexapod, "thermal-expansion", ("base",)))
    assert base["leg1.a.x"] == pytest.approx(7 * 391.3)
    rho = shift_slopes(machines["gough"], with_effect(machines["gough"], "thermal-expansion", ("leg1",)))
    assert rho["m1.displacement"] == pytest.approx(7 * (500 + 5 * READINGS["gough"][0]))


def test_lags_and_thermometers_follow_the_recording(machines: Machines) -> None:
    effect, machine = effects.get("thermal-expansion", "test")(), machines["telescope"]
    legs = tuple(f"leg{k}" for k in range(1, 7))
    assert [s["lag"] for s in effect.settings(machine, ("base",), Campaign())] == [0, 300, 900, 1800, 3600]
    assert [s["lag"] for s in effect.settings(machine, ("base",), Campaign(("temperature",)))] == [0]
    lagging = with_effect(machine, "thermal-expansion", ("base",), {"lag": 900.0})
    assert lagging.drivers == ("temperature.base~900",)
    own = effect.settings(machine, legs, Campaign())[0]
    assert effect.drivers(machine, legs, own) == tuple(f"temperature.{leg}" for leg in legs)
    stated = replace(machine, drivers=("time", "temperature.leg3"))  # named by the machine file's drivers
    assert with_effect(stated, "thermal-expansion", legs).drivers == ("temperature.leg3",)
    shared = effect.settings(machine, legs, Campaign(("temperature.leg2",)))[0]
    assert effect.drivers(machine, legs, shared) == ("temperature.leg2",)
