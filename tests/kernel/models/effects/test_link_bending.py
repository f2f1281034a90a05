"""Links that bend and twist under what they carry: closed forms of the cantilever."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.effect_machines import Machines
from support.effects import with_effect
from support.simulated import machine_from
from support.structures import G, structure, turn_between
from support.tool_pose import HEAD, pose
from truepose.errors import InputError
from truepose.models.machine.kinematics import symbolic_model
from truepose.models.machine.machine import Machine, Mass

UPRIGHT = """
mechanism:
  type: serial
  joints:
    - {{name: q1, kind: revolute, alpha: 90, range: [-180, 180]}}
    - {{name: q2, kind: revolute, alpha: -90, d: 600, r: {offset}, range: [-180, 180]}}
sensor: {{type: pose, sigma: {{xyz: 0.001, rot: 0.0003}}}}
masses: {{tip: {{kg: 10, com: [0, 0, 0], in: tool}}}}
"""


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Machines:
    folder = tmp_path_factory.mktemp("machines")
    return {name: structure(folder, name) for name in ("beam", "arm")}


def test_a_link_is_a_cantilever(machines: Machines) -> None:
    """A level beam of one link with 12 kg at its end: F L^3 / 3EI down, and F L^2 / 2EI about its axis."""
    beam, c, length, force = machines["beam"], 1e-12, 800.0, 12 * G
    still, bent = (pose(beam, [0.0], *t) for t in ((), (with_effect(beam, "link-bending", ("link1",), c=c),)))
    np.testing.assert_allclose(bent[:3, 3] - still[:3, 3], [0, 0, -c * force * length**3 / 3], atol=1e-6)
    np.testing.assert_allclose(turn_between(still, bent), [0, c * force * length**2 / 2, 0], atol=1e-9)


@pytest.mark.parametrize("angle", [-2.0, 0.4, 1.1, np.pi / 2])
def test_only_the_weight_across_a_link_bends_it(machines: Machines, angle: float) -> None:
    beam, c = machines["beam"], 1e-12
    still, bent = (
        pose(beam, [angle], *t) for t in ((), (with_effect(beam, "link-bending", ("link1",), c=c),))
    )
    sideways = -c * 12 * G * np.cos(angle) * 800**3 / 3
    expected = sideways * np.array([-np.sin(angle), 0, np.cos(angle)])
    np.testing.assert_allclose(bent[:3, 3] - still[:3, 3], expected, atol=1e-5)


@pytest.mark.parametrize("a", [100.0, 400.0, 799.0])
def test_a_mass_on_the_link_bends_it_up_to_there(machines: Machines, a: float) -> None:
    beam, c, length = machines["beam"], 1e-12, 800.0
    loaded = replace(beam, masses=(Mass("own", 5.0, (a, 0.0, 0.0), "link1"),))
    still, bent = (
        pose(loaded, [0.0], *t) for t in ((), (with_effect(loaded, "link-bending", ("link1",), c=c),))
    )
    down = c * 5 * G * a**2 * (3 * length - a) / 6
    assert bent[2, 3] - still[2, 3] == pytest.approx(-down, rel=1e-3)
    assert turn_between(still, bent)[1] == pytest.approx(c * 5 * G * a**2 / 2, rel=1e-3)


def test_a_load_beyond_the_end_bends_by_its_moment_too(machines: Machines) -> None:
    beam, c, length, lever = machines["beam"], 1e-12, 800.0, 250.0
    for body, at in (("tool", lever), ("link1", length + lever)):
        far = replace(beam, masses=(Mass("far", 7.0, (at, 0.0, 0.0), body),))
        still, bent = (
            pose(far, [0.0], *t) for t in ((), (with_effect(far, "link-bending", ("link1",), c=c),))
        )
        down = c * 7 * G * (length**3 / 3 + lever * length**2 / 2)
        assert bent[2, 3] - still[2, 3] == pytest.approx(-down, rel=1e-3)


@pytest.mark.parametrize(
    ("body", "at", "share"), [("tool", 0.0, 1.0), ("link1", 800.0, 1.0), ("link1", 300.0, 0.375)]
)
def test_a_load_beside_a_link_twists_it_as_a_round_tube(
    machines: Machines, body: str, at: float, share: float
) -> None:
    """T L / (G J) about its length, up to where the load acts, G J = E I / 1.3; its centre line stays where it was."""
    c, length, aside = 1e-12, 800.0, 60.0
    beside = replace(machines["beam"], masses=(Mass("beside", 9.0, (at, 0.0, aside), body),))
    stiff, soft = (
        pose(beside, [0.0], with_effect(beside, "link-bending", ("link1",), settings, c=c))
        for settings in ({}, {"twist": 1.0})
    )
    assert turn_between(stiff, soft)[0] == pytest.approx(1.3 * c * 9 * G * aside * share * length, rel=1e-3)
    np.testing.assert_allclose(turn_between(stiff, soft)[1:], 0.0, atol=1e-9)
    np.testing.assert_allclose(soft[:3, 3], stiff[:3, 3], atol=1e-6)


@pytest.mark.parametrize("offset", [-150.0, 0.0, 250.0])
def test_a_link_ends_where_the_next_joint_starts_not_at_its_offset(tmp_path: Path, offset: float) -> None:
    """A level link of 600 mm, the next axis upright at its end: how far up that axis the load stands bends no more."""
    machine = machine_from(tmp_path, HEAD.format(name="upright") + UPRIGHT.format(offset=offset))
    c, length, force = 1e-12, 600.0, 10 * G
    still, bent = (
        pose(machine, [0.0, 0.3], *t) for t in ((), (with_effect(machine, "link-bending", ("link1",), c=c),))
    )
    slope = c * force * length**2 / 2
    np.testing.assert_allclose(turn_between(still, bent), [0, slope, 0], atol=1e-8)
    expected = [slope * offset, 0, -c * force * length**3 / 3]
    # a small turn is a straight move but for its square
    np.testing.assert_allclose(bent[:3, 3] - still[:3, 3], expected, atol=slope**2 * 600.0)


def test_a_wrong_link_is_named(machines: Machines) -> None:
    with pytest.raises(InputError, match=r"link-bending: found link 'link9', expected one of link1"):
        symbolic_model(machines["arm"], [with_effect(machines["arm"], "link-bending", ("link9",))])


MEETING = """
schema: truepose/machine/1
name: wrist
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints:
    - {name: q1, kind: revolute, range: [-180, 180]}
    - {name: q2, kind: revolute, alpha: -90, range: [-180, 180]}
    - {name: q3, kind: revolute, alpha: 90, range: [-180, 180]}
frames: {tool: {in: flange, xyz: [400, 30, 60]}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.0003}}
masses: {tip: {kg: 8, com: [20, -10, 5], in: tool}}
"""
"""Three axes that meet at the base's origin: links 1 and 2 have no length."""
RAM = """
schema: truepose/machine/1
name: ram
gravity: [0, 0, -9.80665]
mechanism:
  type: serial
  joints: [{name: q1, kind: prismatic, beta: 90, r: 120, range: [-100, 600]}]
frames: {tool: {in: flange, xyz: [0, 0, 80]}}
sensor: {type: pose, sigma: {xyz: 0.001, rot: 0.0003}}
masses: {tip: {kg: 12, com: [0, 0, 0], in: tool}}
"""
"""A beam that slides out along x, 200 mm beyond its guide at reading 0."""


def _loaded(folder: Path, text: str) -> Machine:
    return machine_from(folder, text, "machine")


def _axes(q: list[float]) -> list[np.ndarray]:
    """Axes of the three joints of MEETING in the base frame, before each turns."""
    turned, out = Rotation.identity(), []
    for alpha, angle in zip((0.0, -90.0, 90.0), q, strict=True):
        turned = turned * Rotation.from_euler("x", alpha, degrees=True)
        out.append(turned.apply([0.0, 0.0, 1.0]))
        turned = turned * Rotation.from_euler("z", angle)
    return [*out, turned.as_matrix()]


@pytest.mark.parametrize("link", [1, 2])
def test_a_link_whose_axes_meet_gives_way_across_its_joint(tmp_path: Path, link: int) -> None:
    """About both axes across, by c times gravity's moment about the point where they meet; never about its own axis."""
    machine, c = _loaded(tmp_path, MEETING), 2e-6
    for q in np.random.default_rng(4).uniform(-2.5, 2.5, (6, 3)).tolist():
        *axes, turned = _axes(q)
        tip = turned @ np.array([400.0, 30.0, 60.0])
        centre = turned @ np.array([420.0, 20.0, 65.0])
        moment = np.cross(centre, [0.0, 0.0, -8 * G]) / 1000.0  # N m
        across = c * (moment - (moment @ axes[link - 1]) * axes[link - 1])
        yielding = with_effect(machine, "link-bending", (f"link{link}",), c=c)
        still, bent = (pose(machine, q, *t) for t in ((), (yielding,)))
        np.testing.assert_allclose(
            turn_between(still, bent), across, atol=3e-9
        )  # of 1e-4: small turns do not add
        np.testing.assert_allclose(bent[:3, 3] - still[:3, 3], np.cross(across, tip), atol=2e-6)


def test_across_an_upright_first_joint_is_what_a_mount_does(tmp_path: Path) -> None:
    """Twins: nothing but a base of its own tells a first joint's bearings from the floor below it."""
    machine, c = _loaded(tmp_path, MEETING), 2e-6
    for q in ([0.3, -0.7, 0.2], [2.0, 0.5, -1.0]):
        mount, bearing = (
            pose(machine, q, with_effect(machine, slug, (place,), c=c))
            for slug, place in (("gravity-sag", "base"), ("link-bending", "link1"))
        )
        np.testing.assert_allclose(mount, bearing, atol=1e-7)


@pytest.mark.parametrize("reading", [-50.0, 0.0, 300.0])
def test_a_ram_bends_with_the_third_power_of_its_overhang(tmp_path: Path, reading: float) -> None:
    machine, c, force = _loaded(tmp_path, RAM), 1e-12, 12 * G
    ram = with_effect(machine, "link-bending", ("link1",), {"overhang": 1.0}, c=c)
    still, bent = (pose(machine, [reading], *t) for t in ((), (ram,)))
    length = 200.0 + reading
    assert bent[2, 3] - still[2, 3] == pytest.approx(-c * force * length**3 / 3, rel=1e-6)
    assert abs(turn_between(still, bent)[1]) == pytest.approx(c * force * length**2 / 2, rel=1e-6)
