"""Laws that every physics effect keeps on every machine, and a user's own effect."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import casadi as ca
import numpy as np
import pytest

from support.effect_machines import READINGS, Machines
from support.effects import Solved, bare, candidates, shift_slopes, with_effect
from truepose.errors import InputError
from truepose.models.effects.base import (
    Coefficient,
    Effect,
    Place,
    PlacedEffect,
    Settings,
    Shifts,
    Site,
    effects,
)
from truepose.models.effects.common import OF_ROWS
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine
from truepose.models.machine.placed import check_settings
from truepose.models.units import parse_unit

EFFECTS = list(effects)
PLACED = [slug for slug in effects if slug not in OF_ROWS]
"""Those that act at places of a machine; the others act on rows of a recording."""
TWINNED = [slug for slug in effects if effects.get(slug, "test").twins is not Effect.twins]


def where_it_acts(machines: Machines, slug: str) -> list[tuple[str, list[PlacedEffect]]]:
    """Machines (by name) on which an effect has a place, and the effect there; never none."""
    found = [(name, candidates(machine, slug)) for name, machine in machines.items()]
    acting = [(name, placed) for name, placed in found if placed]
    assert acting, f"no machine of these tests has a place for {slug}"
    return acting


# -- laws of every effect ------------------------------------------------------------------------------


@pytest.mark.parametrize("slug", PLACED)
def test_zero_coefficients_leave_the_machine_and_slopes_follow_the_ports(
    machines: Machines, slug: str
) -> None:
    for name, placed in where_it_acts(machines, slug):
        machine = machines[name]
        reference = bare(machine)
        solved = Solved(symbolic_model(machine, placed), READINGS[name])
        np.testing.assert_allclose(solved.pose, reference.pose, atol=1e-10, err_msg=name)
        np.testing.assert_allclose(solved.readings, reference.readings, atol=1e-10, err_msg=name)
        column = len(machine.parameters)
        place_of = {port: k for k, port in enumerate(reference.model.names)}
        for effect in placed:
            slopes = shift_slopes(machine, effect)
            by_port = reference.jacobian[:, [place_of[port] for port in slopes]]
            expected = by_port @ np.array(list(slopes.values()))
            found = solved.jacobian[:, column : column + len(effect.coefficients)]
            title = f"{effect.label} on {name}"
            np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-9, err_msg=title)
            column += len(effect.coefficients)


@pytest.mark.parametrize("slug", PLACED)
def test_an_effect_that_states_one_driver_has_it_in_every_form(machines: Machines, slug: str) -> None:
    stated = effects.get(slug, "test").driven_by
    kinds = {one.kind for _, placed in where_it_acts(machines, slug) for one in placed}
    assert stated is None or kinds == {stated}


@pytest.mark.parametrize("slug", EFFECTS)
def test_every_effect_is_described(slug: str) -> None:
    kind = effects.get(slug, "test")
    assert kind.slug == slug
    assert all((kind.title, kind.formula, kind.size, kind.look_alikes, kind.experiment, kind.source))
    assert slug not in kind.look_alikes


@pytest.mark.parametrize("slug", PLACED)
def test_units_bounds_and_explanations(machines: Machines, slug: str) -> None:
    for name, acting in where_it_acts(machines, slug):
        for placed in acting:
            names = [c.name for c in placed.coefficients]
            assert len(set(names)) == len(names) > 0
            for c in placed.coefficients:
                assert parse_unit(c.unit, c.unit, "test") == c.unit
                assert 0 < c.scale < np.inf
                assert c.lower <= 0 < c.upper
            assert 0 < placed.effect.weight(placed.settings_map) < np.inf
            sentence = placed.effect.explain(machines[name], placed.place, placed.settings_map)
            assert sentence.endswith(".")
            assert 20 < len(sentence) < 200


@pytest.mark.parametrize("slug", PLACED)
def test_places_are_distinct_and_settings_default(machines: Machines, slug: str) -> None:
    for name, _ in where_it_acts(machines, slug):
        machine, effect = machines[name], effects.get(slug, "test")()
        places = list(effect.places(machine))
        assert len(set(places)) == len(places)
        # a user may name a place without settings
        symbolic_model(machine, [PlacedEffect.at(effect, machine, places[0])])


@pytest.mark.parametrize("slug", EFFECTS)
def test_settings_are_named_and_bounded(machines: Machines, slug: str) -> None:
    """What a diagnosis may write into a machine file can be read from it; another name, or a number of no use, cannot."""
    known = effects.get(slug, "test").setting_ranges
    assert known is not None
    for _, acting in where_it_acts(machines, slug) if slug in PLACED else ():
        for placed in acting:
            check_settings(slug, known, placed.settings_map, "test")
    with pytest.raises(InputError, match="has no setting 'nonsense'"):
        check_settings(slug, known, {"nonsense": 1.0}, "test")
    for name, allowed in known.items():
        for value in (allowed.low - abs(allowed.low) - 1.0, allowed.high * 2.0 + 1.0, np.nan):
            with pytest.raises(InputError, match=f"found {name}"):
                check_settings(slug, known, {name: float(value)}, "test")


@pytest.mark.parametrize("slug", PLACED)
def test_what_a_load_drives_reads_a_load(machines: Machines, slug: str) -> None:
    """The driver is that of the setting: what no load is read for is not said to follow the load, unless flexures make it."""
    for name, placed in where_it_acts(machines, slug):
        for effect in placed:
            read = {machines[name].drives(driver) for driver in effect.drivers}
            pushed = "flexures" in effect.settings_map
            by_load = effect.effect.reads_load(effect.settings_map) or "load" in read or pushed
            assert effect.kind != "load" or by_load, f"{effect.label} on {name}"


def test_a_leg_and_its_actuator_are_one_place(machines: Machines) -> None:
    machine = machines["telescope"]
    joint_effects = ("actuator-scale", "backlash", "screw-periodic", "zero-shift", "axis-straightness")
    for slug in (*joint_effects, "leg-compliance"):
        slopes = [shift_slopes(machine, with_effect(machine, slug, (name,))) for name in ("leg2", "rho2")]
        assert slopes[0].keys() == slopes[1].keys()
        assert all(np.array_equal(slopes[0][port], slopes[1][port]) for port in slopes[0])


@pytest.mark.parametrize(("slug", "wrong"), [("actuator-scale", "rho7"), ("leg-compliance", "leg0")])
def test_unknown_places_are_told(machines: Machines, slug: str, wrong: str) -> None:
    with pytest.raises(InputError, match=rf"found '{wrong}' on telescope, expected .* did you mean"):
        symbolic_model(machines["telescope"], [with_effect(machines["telescope"], slug, (wrong,))])


@pytest.mark.parametrize("slug", TWINNED)
def test_twins_are_the_same_function(machines: Machines, slug: str) -> None:
    """What a twin does at a place, whatever its settings, the effect can do there too."""
    checked = 0
    for name, acting in where_it_acts(machines, slug):
        for placed in acting:
            for twin, relative in placed.twins.items():
                assert 0 < relative <= 1
                assert twin != slug
                checked += compare_twins(machines[name], placed, twin)
    assert checked


def compare_twins(machine: Machine, placed: PlacedEffect, twin: str) -> int:
    """The twin's slopes at the same place are among the effect's own; the number of ports compared."""
    own = shift_slopes(machine, placed)
    same = [other for other in candidates(machine, twin) if other.place == placed.place]
    compared = [item for other in same for item in shift_slopes(machine, other).items()]
    for port, slopes in compared:
        np.testing.assert_allclose(np.min(abs(slopes[:, None] - own[port]), axis=1), 0, atol=1e-12)
    assert compared
    return len(compared)


# -- a user's own effect -------------------------------------------------------------------------------


def test_what_a_sensor_sees_may_move_readings_only(machines: Machines) -> None:
    """A machine moved by its own measured place would have to know where it is before it is there."""
    arm = machines["arm"]
    column = next(iter(arm.sensors[0].columns))

    class Follows(Effect):
        slug: ClassVar[str] = "follows"

        def places(self, machine: Machine) -> Sequence[Place]:
            return [("tool.motion.y",), (f"{column}.reading",)]

        def coefficients(self, machine: Machine, place: Place, settings: Settings) -> tuple[Coefficient, ...]:
            return (Coefficient("k", "mm/mm", 0.1),)

        def shifts(self, site: Site) -> Shifts:
            return {site.place[0]: site.c["k"] * site.states[f"seen.{column}"]}

    effect = Follows()
    moved, read = (PlacedEffect.at(effect, arm, place) for place in effect.places(arm))
    model = symbolic_model(arm, [read])
    slope = ca.jacobian(model.reading_shift[0], model.p[-1])
    state = ca.Function(
        "state", [model.q, model.x, model.p, model.z], [slope, model.states[f"seen.{column}"]]
    )
    found, seen = state([0.3, 0.2, 0.1], model.home, model.p_home, model.z_home)
    assert float(found) == pytest.approx(float(seen), rel=1e-12)  # mm for each mm seen
    assert abs(float(seen)) > 1.0
    with pytest.raises(InputError, match=rf"found a shift of the machine that depends on 'seen\.{column}'"):
        symbolic_model(arm, [moved])
