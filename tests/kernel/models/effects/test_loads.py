"""What gives way under weight: joints, mounts and legs, under masses that are stated or unknown."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from support.effect_machines import READINGS, STRAIGHT, Machines, read_machines
from support.effects import Campaign, Solved, bare, position, shift_slopes, with_effect
from truepose.errors import InputError
from truepose.models.effects.base import effects
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine, Mass

# -- stated masses -------------------------------------------------------------------------------------


def test_a_compliant_joint_of_a_horizontal_arm_gives_way_downwards(machines: Machines) -> None:
    arm, level = machines["arm"], [0.0, 0.0, 0.0]
    c = 1e-6
    moved = position(arm, level, with_effect(arm, "joint-compliance", ("q2",), c=c)) - position(arm, level)
    torque = 9.80665 * (20 * 0.3 + 4 * 1.0)  # 20 kg at 0.3 m, the payload of 4 kg at 0.7 + 0.3 m
    assert moved[2] == pytest.approx(-c * torque * 1000, rel=1e-4)


def test_a_sagging_base_turns_the_arm_downwards(machines: Machines) -> None:
    arm, level, c = machines["arm"], [0.0, 0.0, 0.0], 1e-6
    start = position(arm, level)
    moved = position(arm, level, with_effect(arm, "gravity-sag", ("base",), c=c)) - start
    moment = 9.80665 * (20 * 0.5 + 4 * 1.2)  # levers from the base's origin: 50 + 150 mm more than from q2
    assert moved[2] == pytest.approx(-c * moment * start[0], rel=1e-2)
    assert moved[0] > 0  # the tool stands above the mount and tips forward


def test_a_gear_that_stiffens_gives_way_until_its_teeth_bear(machines: Machines) -> None:
    """A small load meets the soft gear, a large one moves it by what its knee allows."""
    arm = machines["arm"]
    straight = shift_slopes(arm, with_effect(arm, "joint-compliance", ("q2",)))["q2.displacement"][0]
    for knee, expected in ((1e6, straight), (1e-3, np.sign(straight) * 1e-3)):
        placed = with_effect(arm, "joint-compliance", ("q2",), {"knee": knee})
        stiff, soft = shift_slopes(arm, placed)["q2.displacement"]
        assert (stiff, soft) == (pytest.approx(straight), pytest.approx(expected, rel=1e-4))


def test_a_sharp_knee_needs_the_load_of_its_knee(machines: Machines) -> None:
    placed = with_effect(machines["arm"], "joint-compliance", ("q2",), {"sharp": 1.0})
    with pytest.raises(InputError, match="joint-compliance at q2: found sharp without knee"):
        shift_slopes(machines["arm"], placed)


def test_files_of_earlier_versions_bend_by_odd_powers_of_the_load(machines: Machines) -> None:
    arm = machines["arm"]
    straight = shift_slopes(arm, with_effect(arm, "joint-compliance", ("q2",)))["q2.displacement"][0]
    for bend in (2.0, 3.0):
        placed = with_effect(arm, "joint-compliance", ("q2",), {"bend": bend})
        bent = shift_slopes(arm, placed)["q2.displacement"][0]
        assert bent == pytest.approx(straight * (abs(straight) / 100.0) ** (bend - 1.0))


# -- unknown masses ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("case", "body"), [(0, "link2"), (1, "link3")])
@pytest.mark.parametrize("joint", ["q1", "q2"])
def test_compliance_times_a_mass_is_that_mass_on_that_compliance(
    machines: Machines, joint: str, case: int, body: str
) -> None:
    unweighed, c, kg, q = machines["unweighed"], 2e-6, 7.0, READINGS["arm"]
    weighed = replace(unweighed, masses=(Mass("arm", kg, (0.0, 0.0, 0.0), body),))
    product = with_effect(unweighed, "joint-compliance", (joint,), {"carries": float(case)}, c_kg=c * kg)
    assert product.coefficients[0].unit == "rad/(N*m)*kg"
    found = position(unweighed, q, product)
    expected = position(weighed, q, with_effect(weighed, "joint-compliance", (joint,), c=c))
    np.testing.assert_allclose(found, expected, atol=1e-9)
    if (joint, body) == ("q2", "link3"):
        assert position(unweighed, q)[2] - found[2] > 1e-3  # it gives way downwards


def test_candidates_of_unknown_masses_are_the_bodies_beyond_the_joint(
    machines: Machines,
) -> None:
    unweighed, effect = machines["unweighed"], effects.get("joint-compliance", "test")()
    assert effect.places(unweighed) == [("q1",), ("q2",), ("q3",)]
    found = [[s["carries"] for s in effect.settings(unweighed, (f"q{k}",), Campaign())] for k in (1, 2, 3)]
    assert found == [[0, 1, 2], [1, 2], [2]]  # a body's origin lies on its own joint's axis
    last = with_effect(unweighed, "joint-compliance", ("q2",))  # as a user may write it
    assert [c.name for c in last.coefficients] == ["c_kg"]
    named = with_effect(unweighed, "joint-compliance", ("q2",), {"carries": 2.0})
    slopes = [shift_slopes(unweighed, placed)["q2.displacement"] for placed in (last, named)]
    np.testing.assert_array_equal(slopes[0], slopes[1])
    with pytest.raises(InputError, match="found carries = 5, expected 0 to 2"):
        with_effect(unweighed, "joint-compliance", ("q2",), {"carries": 5.0})
    # where masses are stated nobody asks which body carries
    stated = with_effect(machines["arm"], "joint-compliance", ("q2",), {"carries": 2.0})
    assert [c.name for c in stated.coefficients] == ["c"]
    # stated masses: the whole load, and gears that give way by more at first
    straight, *knees = effect.settings(machines["arm"], ("q2",), Campaign())
    assert straight == {} and all("knee" in one for one in knees)
    assert "masses are not stated" in effect.explain(unweighed, ("q2",), {})
    assert "masses are not stated" not in effect.explain(machines["arm"], ("q2",), {})


@pytest.mark.parametrize("name", ["telescope", "gough"])
def test_closed_loops_and_weightless_machines_have_no_probes(machines: Machines, name: str) -> None:
    machine = replace(machines[name], masses=())
    floating = replace(machines["unweighed"], gravity=None)
    for weightless in (machine, floating, replace(floating, gravity=(0.0, 0.0, 0.0))):
        assert weightless.load_cases == ()
        assert not effects.get("joint-compliance", "test")().places(weightless)


@pytest.mark.parametrize(
    ("slug", "place"), [("joint-compliance", "q2"), ("gravity-sag", "base"), ("link-bending", "link2")]
)
def test_an_effect_of_weight_on_a_machine_without_weight_is_refused_by_name(
    machines: Machines, slug: str, place: str
) -> None:
    """A file may ask for it: before its masses are stated, or on a machine that floats."""
    placed = with_effect(machines["arm"], slug, (place,))
    floating = replace(machines["arm"], gravity=None)
    for weightless in (floating, replace(floating, masses=())):
        with pytest.raises(InputError, match=f"effect of weight at {place}.*expected gravity and masses"):
            symbolic_model(weightless, [placed])


@pytest.mark.parametrize(
    ("masses", "places"),
    [
        ((Mass("rotor", 5.0, (0.0, 0.0, 0.0), "link2"),), [("base",)]),
        ((Mass("gripper", 5.0, (0.0, 0.0, 0.0), "tool"),), [("base",), ("tool",)]),
        ((Mass("payload", 5.0, (0.0, 0.0, 0.0), "link3"),), [("base",), ("tool",)]),
        (
            (Mass("rotor", 5.0, (0.0,) * 3, "link2"), Mass("gripper", 1.0, (0.0,) * 3, "tool")),
            [("base",), ("tool",)],
        ),
        ((), []),
    ],
)
def test_a_mount_sags_where_it_carries_something(
    machines: Machines, masses: tuple[Mass, ...], places: list[tuple[str]]
) -> None:
    """The base carries every mass, the tool's mount what is on the tool and the payload, wherever that is written."""
    loaded = replace(machines["arm"], masses=masses)
    assert effects.get("gravity-sag", "test")().places(loaded) == places


# -- closed loops --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["telescope", "gough", "hybrid"])
def test_legs_shorten_under_a_platform_they_carry_and_grow_where_it_hangs(
    machines: Machines, name: str
) -> None:
    standing = machines[name]
    hanging = replace(standing, gravity=(0.0, 0.0, 9.80665))
    legs = tuple(limb.name for limb in standing.mechanism.limbs)
    for machine, sign in ((standing, -1), (hanging, 1)):
        soft = with_effect(machine, "leg-compliance", legs, c=1e-3)
        before, after = (position(machine, STRAIGHT.get(name, [0.0] * 6), *e) for e in ((), (soft,)))
        assert sign * (after - before)[2] > 0
        assert sign * sum(float(slope[0]) for slope in shift_slopes(machine, soft).values()) > 0


def test_limbs_of_the_hybrid_share_a_centred_weight(machines: Machines) -> None:
    weighed = replace(machines["hybrid"], masses=(Mass("ring", 12.0, (0.0, 0.0, 30.0), "platform"),))
    solved = Solved(symbolic_model(weighed, ports=True), STRAIGHT["hybrid"])
    lean = np.sqrt(730.0**2 - (340.0 - 165.0) ** 2) / 730.0  # cosine: the limbs lean inwards
    for k in (1, 2, 3):
        assert solved.load[f"q{k}.displacement"] == pytest.approx(-12 * 9.80665 / 3 / lean, rel=1e-9)


def test_a_wrist_on_a_parallel_machine_carries_what_it_holds(machines: Machines) -> None:
    """4 kg, 50 mm aside along x and 20 mm along -y of the wrist that stands straight: only gravity's levers count."""
    hybrid = machines["hybrid"]
    solved = Solved(symbolic_model(hybrid, ports=True), STRAIGHT["hybrid"])
    torques = [solved.load[f"q{k}.displacement"] / 1000 for k in (4, 5, 6)]
    np.testing.assert_allclose(torques, np.array([0.0, 50.0, 20.0]) * 4 * 9.80665 / 1000, atol=1e-9)
    soft = with_effect(hybrid, "joint-compliance", ("q5",), c=1e-3)
    bent = position(hybrid, STRAIGHT["hybrid"], soft) - position(hybrid, STRAIGHT["hybrid"])
    assert bent[0] == pytest.approx(
        1e-3 * torques[1] * 210, rel=1e-2
    )  # the tool, 210 mm up, tips with the load


def test_a_limb_that_is_a_slide_gives_way_in_one_place(machines: Machines) -> None:
    """Joint and leg are the same port there: a diagnosis looks for one of the two."""
    hybrid, effect = machines["hybrid"], effects.get("joint-compliance", "test")()
    joint = shift_slopes(hybrid, with_effect(hybrid, "joint-compliance", ("q1",)))
    leg = shift_slopes(hybrid, with_effect(hybrid, "leg-compliance", ("leg1",)))
    np.testing.assert_allclose(joint["q1.displacement"], leg["q1.displacement"])
    assert [effect.screened(hybrid, place) for place in effect.places(hybrid)] == 3 * [False] + 3 * [True]


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Machine]:
    return read_machines(tmp_path_factory.getbasetemp() / "effects")


def test_leg_forces_balance_the_weight(machines: Mapping[str, Machine]) -> None:
    machine = machines["telescope"]
    reference = bare(machine)
    values = dict(zip(reference.model.names, reference.model.p_home, strict=True))
    pose = reference.pose  # of the tool, 30 mm above the platform
    up = 0.0
    for k, limb in enumerate(machine.mechanism.limbs):
        end = np.array([values[n] for n in limb.platform_point]) - [0, 0, 30]
        top = pose[:3, :3] @ end
        foot = np.add([values[n] for n in limb.base_point], [0, 0, READINGS["telescope"][k]])
        leg = pose[:3, 3] + top - foot
        up -= reference.load[limb.length] * leg[2] / np.linalg.norm(leg)
    assert up == pytest.approx(9.80665 * (8 + 4), rel=1e-9)
