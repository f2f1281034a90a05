"""Laws of the independent telescope simulator, and the bundled demo against it. mm, N, rad."""

from __future__ import annotations

import json
import re
from importlib import import_module

import numpy as np
import numpy.typing as npt
import pytest
import yaml

from challenge.simulator.telescope_ring import beams, ring, rotations, simulation, statics
from proof_support import BENCHMARKS, PROOF
from support import ROOT
from support.texts import assert_same_to_the_last_digit

BUNDLED = ROOT / "models" / "machines" / "telescope"
PACKAGE = BENCHMARKS / "telescope_simulator"
MECHANICS = PROOF / "challenge" / "simulator" / "telescope_ring"
Array = npt.NDArray[np.float64]


api, bundle = import_module("telescope_simulator"), import_module("telescope_simulator.bundle")
BAR = beams.Section(ea=7.0e6, ei_y=3.0e8, ei_z=5.0e8, gj=2.0e8)


def _rigid_modes(points: Array) -> Array:
    """(6n, 6) displacements of nodes at `points` (n, 3) under unit translations and rotations."""
    blocks = []
    for p in points:
        top = np.hstack([np.eye(3), -rotations.hat(p)])
        blocks += [top, np.hstack([np.zeros((3, 3)), np.eye(3)])]
    return np.vstack(blocks)


def test_beam_element_is_symmetric_with_exactly_six_rigid_modes() -> None:
    start, end = np.array([10.0, -20.0, 5.0]), np.array([40.0, 15.0, 30.0])
    K = beams.global_stiffness(BAR, start, end, ring.UP)
    assert np.allclose(K, K.T, rtol=0, atol=1e-9 * np.abs(K).max())
    values = np.linalg.eigvalsh(K)
    assert np.sum(np.abs(values) < 1e-9 * values.max()) == 6
    assert np.all(values > -1e-9 * values.max())
    assert np.abs(K @ _rigid_modes(np.array([start, end]))).max() < 1e-9 * np.abs(K).max()


@pytest.mark.parametrize("elements", [1, 5])
def test_cantilever_meets_the_textbook(elements: int) -> None:
    length, force, moment = 120.0, 3.0, 40.0
    nodes = np.linspace([0, 0, 0], [length, 0, 0], elements + 1)
    K = beams.assemble(nodes, [(i, i + 1, BAR) for i in range(elements)], ring.UP)
    C = np.linalg.inv(K[6:, 6:])[-6:, -6:]
    tip = C @ np.array([force, force, force, moment, 0, 0])
    expected = [
        force * length / BAR.ea,
        force * length**3 / (3 * BAR.ei_z),
        force * length**3 / (3 * BAR.ei_y),
        moment * length / BAR.gj,
        -force * length**2 / (2 * BAR.ei_y),
        force * length**2 / (2 * BAR.ei_z),
    ]
    assert np.allclose(tip, expected, rtol=1e-9)
    assert C[4, 4] == pytest.approx(length / BAR.ei_y, rel=1e-9)


def test_sections_meet_the_textbook() -> None:
    bar = beams.Section.round_bar(6.0, 110_000.0)
    assert bar.ei_y == pytest.approx(110_000 * np.pi * 6**4 / 64)
    assert bar.gj == pytest.approx(110_000 / 2.6 * np.pi * 6**4 / 32)
    square = beams.Section.rectangle(10.0, 10.0, 70_000.0)
    assert square.gj == pytest.approx(70_000 / 2.6 * 0.1406 * 10**4, rel=2e-3)
    flat = beams.Section.rectangle(30.0, 5.0, 70_000.0)
    assert (flat.ei_y, flat.ei_z) == pytest.approx((70_000 * 30 * 125 / 12, 70_000 * 5 * 27_000 / 12))


def test_flexure_energy_is_the_beam_element_to_second_order() -> None:
    """The co-rotating measures reproduce eqs. 20-21 at rest: their derivative is the natural modes."""
    length, step = 30.0, 1e-6
    derivative = np.zeros((6, 12))
    for k in range(12):
        for sign in (1, -1):
            h = np.zeros(12)
            h[k] = sign * step
            R1, R2 = rotations.exp_so3(h[3:6]), rotations.exp_so3(h[9:])
            x2 = np.array([length, 0, 0]) + h[6:9]
            measures = statics.flexure_measures(R1, h[:3], R2, x2, length)
            derivative[:, k] += sign * measures / (2 * step)
    assert np.allclose(derivative, beams.natural_modes(length), atol=1e-9)


def test_bent_flexure_keeps_the_length_of_its_arc() -> None:
    """A uniformly bent bar spans the chord of its arc (eq. 12 of the paper, to the order of the model)."""
    length, angle = 30.0, 0.01
    radius = length / angle
    end = np.array([radius * np.sin(angle), radius * (1 - np.cos(angle)), 0])
    turned = rotations.exp_so3(np.array([0, 0, angle]))
    measures = statics.flexure_measures(np.eye(3), np.zeros(3), turned, end, length)
    assert np.allclose(measures, [0, 0, 0, angle, 0, 0], atol=1e-8)


def test_flexure_measures_do_not_see_rigid_motion() -> None:
    rng = np.random.default_rng(3)
    R1, R2 = rotations.exp_so3(rng.normal(0, 0.01, (2, 3)))
    x2 = np.array([30.0, 0.2, -0.1])
    Q, t = rotations.exp_so3(np.array([1.0, -0.6, 0.4])), np.array([5.0, 6.0, 7.0])
    here = statics.flexure_measures(R1, np.zeros(3), R2, x2, 30.0)
    there = statics.flexure_measures(Q @ R1, t, Q @ R2, Q @ x2 + t, 30.0)
    assert np.allclose(here, there, atol=1e-12)


def test_ring_compliance_is_reciprocal_and_positive() -> None:
    C = ring.leg_end_compliance(ring.Ring())
    scale = np.sqrt(np.outer(np.diag(C), np.diag(C)))
    assert np.abs((C - C.T) / scale).max() < 1e-9
    assert np.linalg.eigvalsh((C + C.T) / scale / 2).min() > 0


def test_ring_is_fine_enough_and_softest_between_legs_1_and_6() -> None:
    z = 6 * np.arange(6) + 2
    C = ring.leg_end_compliance(ring.Ring())
    finer = ring.leg_end_compliance(ring.Ring(elements_per_sector=16, elements_per_spoke=8))
    assert np.allclose(C[z, z], finer[z, z], rtol=5e-3)
    bending = C[3::6, 3::6].diagonal() + C[4::6, 4::6].diagonal()
    assert min(bending[[0, 5]]) > max(bending[1:5])


def _leg_length_errors(machine: object, poses: object, travel: Array) -> Array:
    """(n, 6) |p + R b - c| - length, each leg end where the ring has moved it."""
    tip = machine.upper_centres + poses.leg_end_displacement  # type: ignore[attr-defined]
    placed = poses.position[:, None] + np.einsum("nij,nkj->nki", poses.rotation, tip)  # type: ignore[attr-defined]
    gap = np.linalg.norm(placed - machine.lower_centres(travel), axis=-1)  # type: ignore[attr-defined]
    return np.asarray(gap - machine.lengths)  # type: ignore[attr-defined]


def test_rigid_platform_with_ideal_joints_closes_every_leg() -> None:
    machine, rho = api.draw_machine(5), api.paper_poses()[1]
    poses = simulation.solve(machine, rho, ring_stiffness=np.inf)
    assert np.abs(_leg_length_errors(machine, poses, rho)).max() < 1e-9
    assert np.allclose(poses.rotation @ np.swapaxes(poses.rotation, 1, 2), np.eye(3), atol=1e-12)


def test_flexures_act_as_spherical_joints_up_to_their_known_shift() -> None:
    """Rigid platform: real flexures move the pose by the shift of eq. 13 and of shear, some um at most."""
    machine, rho = api.draw_machine(5), api.paper_poses()[1]
    ideal = simulation.solve(machine, rho, ring_stiffness=np.inf)
    real = simulation.solve(machine, rho, ring_stiffness=np.inf, joints="flexure")
    assert 0 < np.abs(real.position - ideal.position).max() < 5e-3
    assert not real.leg_end_displacement.any()
    shorter = statics.Flexure(length=3.0, diameter=0.6)  # ten times shorter: the shift nearly vanishes
    near = simulation.solve(machine, rho, ring_stiffness=np.inf, joints="flexure", flexure=shorter)
    assert np.abs(near.position - ideal.position).max() < 2e-4


def test_elastic_legs_close_on_the_displaced_leg_ends() -> None:
    """With the ring's displacements added to b, the legs close but for the flexures' shift (below 2 um)."""
    machine, rho = api.draw_machine(5), api.paper_poses()[1]
    poses = simulation.solve(machine, rho)
    assert np.abs(_leg_length_errors(machine, poses, rho)).max() < 2e-3


def test_stiffer_ring_tends_to_the_rigid_platform() -> None:
    machine, rho = api.draw_machine(5), api.paper_poses()[1][:6]
    rigid = simulation.solve(machine, rho, ring_stiffness=np.inf, joints="flexure")
    gaps = []
    for stiffness in (1e3, 1e4):
        poses = simulation.solve(machine, rho, ring_stiffness=stiffness)
        gaps.append(np.abs(poses.position - rigid.position).max())
    assert gaps[1] < 1e-4
    assert gaps[0] / gaps[1] == pytest.approx(10, rel=0.02)


def test_home_is_unstressed() -> None:
    machine = api.draw_machine(5)
    rest, home = simulation.solve(machine, np.zeros((1, 6))), statics.rigid_poses(machine, np.zeros((1, 6)))
    assert np.abs(rest.leg_end_displacement).max() < 1e-10
    assert np.allclose(rest.position, home.position, atol=1e-9)


def test_actuator_scale_sensors_and_seeds() -> None:
    machine, rho = api.draw_machine(5), api.paper_poses()[1][:8]
    scaled = api.simulate(machine, rho, ring_stiffness=np.inf, actuator_scale=0.011)
    longer = api.simulate(machine, 1.011 * rho, ring_stiffness=np.inf)
    assert np.array_equal(scaled.rho, rho)
    assert np.allclose(scaled.exact_observations, longer.exact_observations, atol=1e-9)
    pose = api.PoseSensor(sigma_xyz=0.003, sigma_rot=0.01)
    one, same, other = (api.simulate(machine, rho, sensor=pose, seed=s) for s in (1, 1, 2))
    assert one.columns == ("x", "y", "z", "rx", "ry", "rz")
    assert np.array_equal(one.observations, same.observations)
    assert not np.array_equal(one.observations, other.observations)
    assert yaml.safe_load(api.machine_text(pose))["sensor"]["sigma"] == {"xyz": 0.003, "rot": 0.01}


@pytest.mark.parametrize("bad", [{"ring_stiffness": 0.0}, {"joints": "ball"}])
def test_bad_options_are_named(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        api.simulate(api.nominal_machine(), np.zeros((1, 6)), **bad)


def test_pose_tables_of_the_paper() -> None:
    roles, rho = api.paper_poses()
    units = np.round(rho / 1.3, 12)
    assert roles == ("calibration",) * 40 + ("validation",) * 6
    assert set(np.unique(units[:40])) == {-1.0, 0.0, 1.0}
    assert units[0].tolist() == [1, -1, -1, 1, 1, -1]
    assert units[39].tolist() == [1, -1, -1, -1, -1, 1]
    assert units[43].tolist() == [-0.5, 0.5, -1, 0.5, 0, 0]


@pytest.mark.parametrize("name", ["machine.yaml", "recording.csv", "truth.json"])
def test_bundled_files_are_what_the_simulator_makes(name: str) -> None:
    assert_same_to_the_last_digit(bundle.files()[name], (BUNDLED / name).read_text(encoding="utf-8"))


def test_bundled_machine_is_the_required_telescope() -> None:
    machine = yaml.safe_load((BUNDLED / "machine.yaml").read_text(encoding="utf-8"))
    legs = machine["mechanism"]["legs"]
    for key, radius, angles in (
        ("a", 400, (-12, 12, 108, 132, 228, 252)),
        ("b", 250, (-46, 46, 74, 166, 194, 286)),
    ):
        t = np.radians(angles)
        expected = radius * np.stack([np.cos(t), np.sin(t), 0 * t], axis=1)
        assert np.allclose([leg[key] for leg in legs], expected, atol=1e-4)
    assert {leg["length"] for leg in legs} == {500}
    assert machine["mechanism"]["flexure"] == {"length": 30}
    assert machine["mechanism"]["home"][2] == pytest.approx(439.67, abs=0.01)
    assert machine["sensor"]["sigma"] == {"xyz": 0.005}
    assert machine["tolerances"] == {"length": 0.1, "angle": 0.1}


def test_truth_is_of_the_size_the_paper_saw() -> None:
    truth = json.loads((BUNDLED / "truth.json").read_text(encoding="utf-8"))
    displacement = 1e3 * np.array(truth["leg_end_displacement"]["value"])  # um
    assert displacement.shape == (46, 6, 3)
    assert 40 < np.linalg.norm(displacement, axis=-1).max() < 80
    assert np.abs(displacement[..., :2]).max() < 0.2 * np.abs(displacement[..., 2]).max()
    K = np.array(truth["K"]["value"])
    for i, j in ((0, 5), (1, 2), (3, 4)):
        assert K[i, j] < -5e-3
        assert K[j, i] < -5e-3
    assert np.all(np.diag(K) > 5e-3)
    assert np.abs(K).max() < 0.025
    assert truth["K_residual"]["calibration_max"] < 1.0


def test_true_errors_are_of_the_size_of_the_tolerances() -> None:
    truth = json.loads((BUNDLED / "truth.json").read_text(encoding="utf-8"))["parameters"]
    lengths = [
        v["value"] - v["nominal"] for n, v in truth.items() if n.startswith("leg") and v["unit"] == "mm"
    ]
    assert len(lengths) == 48
    assert np.std(lengths) == pytest.approx(0.1, rel=0.35)
    assert all(abs(v["value"] - v["nominal"]) < 20 for v in truth.values())


def test_simulator_shares_no_code_with_truepose() -> None:
    sources = [*PACKAGE.glob("*.py"), *MECHANICS.glob("*.py")]
    assert len(sources) > 8
    importing = re.compile(r"^\s*(from|import)\s+(truepose|challenge(?!\.simulator))", re.MULTILINE)
    assert not [p.name for p in sources if importing.search(p.read_text(encoding="utf-8"))]
