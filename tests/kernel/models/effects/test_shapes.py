"""Parts that are not straight or not stiff: bent guideways and rails, and the platform that bends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from support.effect_machines import READINGS, Machines
from support.effects import Campaign, bare, position, shift_slopes, with_effect
from truepose.errors import InputError
from truepose.models.effects.base import PlacedEffect, Settings, effects
from truepose.models.machine.kinematics import symbolic_model

# -- guideways and rails -------------------------------------------------------------------------------


def test_a_bent_guideway_of_an_arm(machines: Machines) -> None:
    stage = machines["stage"]
    bent = with_effect(stage, "axis-straightness", ("s1",), {"degree": 2.0}, x2=0.01, rz1=1e-4)
    assert [c.name for c in bent.coefficients] == ["x2", "y2", "z2", "rx1", "ry1", "rz1"]
    start, end = (position(stage, [s, 13, 0], bent) - position(stage, [s, 13, 0]) for s in (0, 150))
    np.testing.assert_allclose(start, 0, atol=1e-12)
    assert end[0] - 0.01 == pytest.approx(-1e-4 * position(stage, [0, 13, 0])[1], rel=1e-2)
    known = bent.effect.settings(stage, ("s1",), Campaign())
    assert [*known] == [
        *({"degree": n} for n in (2.0, 3.0, 4.0)),
        *({"waves": n} for n in (2.0, 3.0, 4.0, 6.0)),
    ]
    assert not effects.get("axis-straightness", "test")().places(machines["gough"])


@pytest.mark.parametrize(
    ("wave", "at"), [(1, {0: 1}), (2, {-75: 1, 0: 0, 75: -1}), (3, {-100: 1, 0: -1, 100: 1})]
)
def test_half_waves_stand_between_the_ends_of_the_range(
    machines: Machines, wave: int, at: Mapping[float, float]
) -> None:
    stage, size = machines["stage"], 0.02
    bent = with_effect(stage, "axis-straightness", ("s1",), {"waves": 3.0}, **{f"yw{wave}": size})
    assert [c.name for c in bent.coefficients[:6]] == ["xw1", "yw1", "zw1", "rxw1", "ryw1", "rzw1"]
    for s, expected in {-150: 0, 150: 0, **at}.items():
        moved = position(stage, [s, 13, 0], bent) - position(stage, [s, 13, 0])
        np.testing.assert_allclose(moved, [0, size * expected, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({"degree": 3.0}, ["e2", "e3"]),
        ({"degree": 4.0}, ["e2", "e3", "e4"]),
        ({"waves": 2.0}, ["ew1", "ew2"]),
    ],
)
def test_a_bent_rail_shows_only_along_its_leg(
    machines: Machines, settings: Settings, names: Sequence[str]
) -> None:
    """Sideways of the leg the slide may go where it likes; the first shapes are the largest to expect."""
    machine, reference = machines["telescope"], bare(machines["telescope"])
    rail = with_effect(machine, "axis-straightness", ("rho1",), settings)
    assert [c.name for c in rail.coefficients] == names
    assert (np.diff([c.scale for c in rail.coefficients]) < 0).all()
    moved = shift_slopes(machine, rail)
    motion = np.array([moved[f"rho1.motion.{axis}"] for axis in "xyz"])  # (axis, coefficient)
    leg = np.array([173.6 - 391.3, -179.9 + 83.2, 0])
    leg /= np.linalg.norm(leg)
    np.testing.assert_allclose(motion, np.outer(leg, leg @ motion), atol=1e-12)
    columns = [reference.model.names.index(f"rho1.motion.{axis}") for axis in "xyz"]
    seen = reference.jacobian[:, columns]
    assert np.linalg.norm(seen @ leg) > 0.1
    assert np.linalg.norm(seen @ [-leg[1], leg[0], 0]) < 0.05 * np.linalg.norm(seen @ leg)


def test_rails_tilt_alike_towards_their_legs(machines: Machines) -> None:
    machine = machines["telescope"]
    effect = effects.get("wrong-constant", "test")()
    together = max(effect.places(machine), key=len)
    assert len(together) == 12
    slopes = shift_slopes(machine, PlacedEffect.at(effect, machine, together))
    leg = np.array([173.6 - 391.3, -179.9 + 83.2])
    np.testing.assert_allclose(
        [slopes["leg1.u.x"][0], slopes["leg1.u.y"][0]], leg / np.linalg.norm(leg), atol=1e-9
    )
    one = with_effect(machine, "wrong-constant", ("leg3.length",), value=2.0)
    assert one.coefficients[0].unit == "mm"
    assert shift_slopes(machine, one) == {"leg3.length": np.array([1.0])}
    assert ("leg3.gain",) not in effect.places(machine)  # exactly known
    with pytest.raises(InputError, match=r"found no port 'leg9\.length'"):
        symbolic_model(machine, [with_effect(machine, "wrong-constant", ("leg9.length",))])


# -- the platform --------------------------------------------------------------------------------------


def test_a_bending_platform_moves_its_leg_ends(machines: Machines) -> None:
    machine = machines["telescope"]
    rho = np.array(READINGS["telescope"])
    common = shift_slopes(machine, with_effect(machine, "platform-deformation", ("platform",)))
    np.testing.assert_allclose([common[f"leg{k}.b.z"][0] for k in range(1, 7)], rho)
    full = with_effect(machine, "platform-deformation", ("platform",), {"form": 2.0})
    assert len(full.coefficients) == 36
    assert (full.coefficients[0].name, full.coefficients[35].name) == ("K[1,1]", "K[6,6]")
    np.testing.assert_allclose(shift_slopes(machine, full)["leg2.b.z"][6:12], rho)
    rigid = replace(machine, mechanism=replace(machine.mechanism, flexure_length=None))
    balls, flexures = (
        [s["form"] for s in full.effect.settings(m, ("platform",), Campaign())] for m in (rigid, machine)
    )
    assert balls == [4, 5]  # ball joints pass no moment on; weights bend either
    assert flexures == [0, 1, 3, 2, 4, 5]


def test_the_symmetric_platform_repeats_its_first_row_round_the_ring(machines: Machines) -> None:
    machine = machines["telescope"]
    placed = with_effect(machine, "platform-deformation", ("platform",), {"form": 3.0})
    slopes = shift_slopes(machine, placed)
    names = [c.name for c in placed.coefficients]
    assert sorted(names) == [f"K[1,{k}]" for k in range(1, 7)]
    rho = READINGS["telescope"]
    neighbour = names.index("K[1,6]")  # legs 1 and 6 hold one side of the platform, so do 2 and 3, 4 and 5
    for leg, other in ((1, 6), (6, 1), (2, 3), (3, 2), (4, 5), (5, 4)):
        assert slopes[f"leg{leg}.b.z"][neighbour] == pytest.approx(rho[other - 1])
        assert slopes[f"leg{leg}.b.z"][names.index("K[1,1]")] == pytest.approx(rho[leg - 1])
