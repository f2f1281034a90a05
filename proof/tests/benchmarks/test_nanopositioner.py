"""The nanopositioner: an independent simulator, identification from one beam, the inverse model, the demo.

Inside: mm, rad; dL of the simulator in um. The paper is Bettahar et al., IEEE T-ASE 19(1), 2022.
"""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from proof_support import BENCHMARKS
from support import MACHINES, ROOT
from support.texts import assert_same_to_the_last_digit
from truepose.cli import app
from truepose.errors import InputError
from truepose.identification.compensation.inverse import PoseSolver, Reach, inverse
from truepose.identification.diagnosis import diagnose as engine
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

BUNDLED = ROOT / "models" / "machines" / "nanopositioner"
PACKAGE = BENCHMARKS / "nanopositioner"
Array = NDArray[np.float64]
ROUNDING = 1e-12
"""mm and rad: sums of a dozen terms of about 1 mm in double precision."""
tables, geometry, plan, recordings, reflection, study, drift, trajectories = (
    import_module(f"nanopositioner.{name}")
    for name in ("tables", "geometry", "plan", "recordings", "reflection", "study", "drift", "trajectories")
)


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load_machine(BUNDLED / "machine.yaml")


@pytest.fixture(scope="module")
def identified() -> Array:
    """Constants from the strict plan, one reading a motion."""
    return np.asarray(study.identify(study.recorded(plan.paper_plan(), 1)).p)


def _values(machine: Machine, table: Any) -> Array:
    """(np,) the machine's parameters with those of a day's tables."""
    stated = tables.parameter_values(table.intrinsic, table.extrinsic)
    return np.array([stated.get(p.name, p.nominal) for p in machine.parameters])


def _wild(machine: Machine, seed: int = 3) -> tuple[Array, Any]:
    """Every constant of the machine off by 1 um or 1 deg, not only those the paper frees, for both codes."""
    rng = np.random.default_rng(seed)
    p = _values(machine, tables.DAY_0)
    own = [k for k, q in enumerate(machine.parameters) if not q.name.startswith(("base.", "tool."))]
    units = [machine.parameters[k].unit for k in own]
    p[own] += np.array([1e-3 if unit == "mm" else np.radians(1.0) for unit in units]) * rng.normal(
        size=len(own)
    )
    value = dict(zip((q.name for q in machine.parameters), p, strict=True))
    rows = np.array([[value[f"{joint}.{name}"] for name in tables.ROW] for joint in tables.JOINTS])
    beam = np.array([value[f"beam.{name}"] for name in ("x", "y", "z", "rx", "rz")])
    mirror = np.array([value["mirror.z"], value["mirror.rx"], value["mirror.ry"]])
    return p, geometry.Constants(rows, beam, mirror)


def _readings(count: int, seed: int = 4) -> Array:
    return np.asarray(np.random.default_rng(seed).uniform(plan.LOW, plan.HIGH, (count, 6)))


# The simulator against the library, and against the paper


def test_library_and_simulator_are_the_same_machine(machine: Machine) -> None:
    p, constants = _wild(machine)
    q = _readings(40)
    poses, good = PoseSolver(machine, p).forward(q)
    assert good.all()
    assert np.abs(poses - geometry.end_effector(constants, q)).max() < ROUNDING
    assert (
        np.abs(reflection.mirror_poses(machine, poses, p) - geometry.mirror_pose(constants, q)).max()
        < ROUNDING
    )
    found, (world, own) = reflection.reflections(machine, poses, p), geometry.reflection(constants, q)
    assert np.abs(found.length - geometry.lengths(constants, q)).max() < ROUNDING
    assert np.abs(found.world - world).max() < ROUNDING
    assert np.abs(found.mirror - own).max() < ROUNDING


def test_predicted_changes_are_those_of_the_simulator(machine: Machine) -> None:
    motions = plan.fresh_motions(50, np.random.default_rng(5))
    recording = study.recorded(motions, 3, sigma=0.0)
    p, true = _values(machine, tables.DAY_0), geometry.Constants.tabled(tables.DAY_0)
    predictor = Predictor(machine, recording)
    names, values, _, _ = predictor.columns(p, predictor.assemble(p)[0])
    length = geometry.lengths(true, motions.sampled(3).reshape(-1, 6)).reshape(50, 4)
    predicted = values[:, names.index("dL")].reshape(50, 4)
    # the recording's joints are written to 1e-9 um and deg: light on 0.15 mm, below 1e-9 mm
    assert np.abs(predicted - (length - length[:, :1])).max() < 1e-9


def test_light_mirror_and_joints_are_laid_as_in_the_paper(machine: Machine) -> None:
    """Section III: the stages move along Z_w, Y_w, X_w, the rotary joints turn about X_w, Z_w, Y_w."""
    constants = geometry.Constants.of({}, tables.DRAWING)
    home = geometry.end_effector(constants, np.zeros((1, 6)))[0]
    step = 1e-6
    for k, axis in enumerate((2, 1, 0, 0, 2, 1)):
        moved = geometry.end_effector(constants, step * np.eye(6)[k : k + 1])[0]
        change = (moved - home) / step
        spin = change[:3, :3] @ home[:3, :3].T
        found = change[:3, 3] if k < 3 else np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        assert np.allclose(found, np.eye(3)[axis], atol=1e-5)  # the next order is step / 2
    assert np.allclose(reflection.light_frame(machine)[:3, 2], [0, -1, 0], atol=ROUNDING)
    assert np.allclose(home[:3, 2], [0, 1, 0], atol=ROUNDING)


def test_the_printed_equation_10_is_no_rotation_and_ours_is() -> None:
    """C12 reads S(beta) C(theta) + ... C(beta) S(theta) in print; it is S(beta) S(theta) + ... C(theta)."""
    beta, alpha, theta = 0.3, -0.7, 1.1
    turned = geometry.rotation(1, beta) @ geometry.rotation(0, alpha) @ geometry.rotation(2, theta)
    assert np.allclose(turned[:3, :3] @ turned[:3, :3].T, np.eye(3), atol=ROUNDING)
    right = np.sin(beta) * np.sin(theta) + np.sin(alpha) * np.cos(beta) * np.cos(theta)
    printed = np.sin(beta) * np.cos(theta) + np.sin(alpha) * np.cos(beta) * np.sin(theta)
    assert turned[2, 1] == pytest.approx(right, abs=ROUNDING)
    assert abs(turned[2, 1] - printed) > 0.1


def test_printed_reflection_points_do_not_lie_on_the_printed_light() -> None:
    """Equation (28) with equation (13): the light has no x component, so wP_rx must be x_wf."""
    for table in tables.SEQUENCE:
        origin, along = geometry.light(geometry.Constants.tabled(table))
        assert along[0] == 0.0
        assert abs(table.point[0] - 1e3 * origin[0]) > 30


# The plan and the bundle


def test_the_plan_is_that_of_section_v() -> None:
    motions = plan.paper_plan()
    moving = motions.start != motions.end
    assert len(motions) == 69
    assert (moving.sum(axis=1) == 1).all()
    assert moving.sum(axis=0).tolist() == [8, 8, 8, 15, 15, 15]
    span = np.abs(motions.end - motions.start)[moving]
    assert set(np.round(span, 9)) == set(np.round(np.append(plan.HIGH - plan.LOW, []), 9))
    assert len(np.unique(motions.start[:45, :3], axis=0)) == 15
    assert len(np.unique(motions.start[45:, 3:], axis=0)) == 8


@pytest.mark.parametrize("name", sorted(recordings.files()))
def test_bundled_files_are_what_the_simulator_makes(name: str) -> None:
    kept = (BUNDLED / name).read_text(encoding="utf-8")
    assert_same_to_the_last_digit(recordings.files()[name], kept)


def test_the_machine_file_is_table_i_and_frees_what_the_paper_identifies(machine: Machine) -> None:
    drawn = tables.parameter_values({}, tables.DRAWING)
    free = {p.name: p.nominal for p in machine.parameters if p.free}
    assert free == pytest.approx(drawn, abs=ROUNDING)
    assert all(p.nominal == 0.0 or p.name in drawn for p in machine.parameters)
    (channel,) = Predictor(machine, load_recording(machine, [BUNDLED / "recording.csv"])).channels
    assert channel.sigma == pytest.approx(1e-3 * recordings.SIGMA)


def test_truth_is_tables_ii_and_iii_within_reach_of_the_tolerances(machine: Machine) -> None:
    truth = json.loads((BUNDLED / "truth.json").read_text(encoding="utf-8"))["parameters"]
    assert len(truth) == 21
    for name, entry in truth.items():
        off = abs(entry["value"] - entry["nominal"])
        assert 0 < off < 2 * machine.geometry[name].tolerance  # 2-sigma: what a drawing may be off by


def test_simulator_shares_no_code_with_truepose() -> None:
    importing = re.compile(r"^\s*(from|import)\s+(truepose|challenge(?!\.simulator))", re.MULTILINE)
    for name in ("__init__", "tables", "geometry", "plan", "recordings"):
        assert not importing.search((PACKAGE / f"{name}.py").read_text(encoding="utf-8")), name


# Identification


def test_the_strict_plan_predicts_dl_better_than_the_paper(identified: Array) -> None:
    """69 readings with 10 nm, from nominal: 7 um of error fall below 50 nm on motions never seen."""
    before, after = study.nominal_score(), study.score(identified)
    assert before.length > 5000
    assert after.length < study.TARGET_LENGTH
    assert after.normal < 0.1 * before.normal


def test_the_continuous_record_reaches_both_targets(machine: Machine) -> None:
    """The bundled recording, 100 readings along each of the 69 motions."""
    recording = load_recording(machine, [BUNDLED / "recording.csv"])
    fit = study.identify(recording)
    assert fit.chi2_per_dof == pytest.approx(1.0, abs=0.06)  # 3.5 sigma of chi2 with 6900 readings
    assert study.score(fit.p).better


def test_what_one_beam_on_one_mirror_cannot_see() -> None:
    """Five directions of 21 leave every reading alone: three exactly, by the simulator, and the fit finds five."""
    day, q = tables.DAY_0, _readings(30)
    lengths = geometry.lengths(geometry.Constants.tabled(day), q)

    def changed(intrinsic: dict[str, float], extrinsic: dict[str, float]) -> float:
        moved = geometry.Constants.of({**day.intrinsic, **intrinsic}, {**day.extrinsic, **extrinsic})
        change = geometry.lengths(moved, q) - lengths
        return float(np.abs(change - change.mean()).max())

    assert changed({}, {"theta_wf": 30.0}) < ROUNDING  # the beam's turn about itself
    _, along = geometry.light(geometry.Constants.tabled(day))
    slid = {f"{a}_wf": day.extrinsic[f"{a}_wf"] + 50 * along[k] for k, a in enumerate("xyz")}
    assert changed({}, slid) < ROUNDING  # the fibre's end along the light
    assert changed({}, {"y_wf": day.extrinsic["y_wf"] + 5}) > 1e-7  # not along the light: seen
    # d4 shifts all that follows as a whole, which the fibre's end can follow
    before = geometry.end_effector(geometry.Constants.tabled(day), np.zeros((1, 6)))[0, :3, 3]
    longer = {"q4.d": day.intrinsic["q4.d"] + 5}
    shifted = geometry.Constants.of({**day.intrinsic, **longer}, day.extrinsic)
    shift = 1e3 * (geometry.end_effector(shifted, np.zeros((1, 6)))[0, :3, 3] - before)
    followed = {f"{a}_wf": day.extrinsic[f"{a}_wf"] + shift[k] for k, a in enumerate("xyz")}
    assert changed(longer, followed) < ROUNDING
    fit = study.identify(study.recorded(plan.paper_plan(), 20))
    assert (len(fit.prior.free), fit.rank) == (21, 16)


def test_extrinsics_again_suffice_for_a_day_and_not_for_a_week() -> None:
    """Tables IV to VII: beta_4 moves with the extrinsics."""
    motions = plan.paper_plan()
    first = study.identify(study.recorded(motions, 5, tables.DAY_0)).p
    left = {}
    for table in (tables.DAY_1, tables.DAY_7):
        again = study.recorded(motions, 5, table, seed=1)
        left[table.day] = study.score(study.identify_extrinsic(again, first).p, table).length
        assert study.score(study.identify(again).p, table).length < 10
    assert left[1] < study.TARGET_LENGTH < left[7]


# The inverse model and the reflection point


@pytest.mark.parametrize(
    "path",
    [
        BUNDLED / "machine.yaml",
        ROOT / "models" / "machines" / "telescope" / "machine.yaml",
        MACHINES / "serial.yaml",
        MACHINES / "ups.yaml",
    ],
    ids=lambda path: path.parent.name if path.stem == "machine" else path.stem,
)
def test_inverse_undoes_forward_with_every_constant_off(path: Path) -> None:
    machine = load_machine(path)
    rng = np.random.default_rng(6)
    scale = np.array([min(p.tolerance, 1e-2) if p.free else 0.0 for p in machine.parameters])
    solver = PoseSolver(machine)
    solver = PoseSolver(machine, solver.p + scale * rng.normal(size=len(scale)))
    ranges = np.array([a.range or (-1.0, 1.0) for a in machine.mechanism.actuators])
    q = rng.uniform(ranges[:, 0], ranges[:, 1], (60, len(ranges)))
    poses, good = solver.forward(q)
    found = solver.inverse(poses)
    assert good.all() and found.solved.all()
    again, _ = solver.forward(found.q)
    missed = np.abs(again - poses)
    counted = missed if len(ranges) >= 6 else missed[:, solver.task.along, 3]
    assert counted.max() < 1e-9 * solver.size


def test_inverse_says_why_a_pose_is_not_met(machine: Machine) -> None:
    solver = PoseSolver(machine)
    within, beyond = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.5]), np.array([0.2, 0.0, 0.0, 0.1, 0.0, 0.5])
    found = inverse(machine, solver.forward(np.array([within, beyond]))[0])
    assert found.status.tolist() == [Reach.SOLVED, Reach.JOINT_RANGE]
    assert np.allclose(found.q[1], beyond, atol=1e-12)
    assert (found.saturated(0), found.saturated(1)) == ((), ("q1", "q4"))
    arm = load_machine(MACHINES / "serial.yaml")
    far = np.eye(4)[None].copy()
    far[0, :3, 3] = 5000.0
    lost = inverse(arm, far)
    assert lost.status.tolist() == [Reach.UNREACHABLE]
    assert lost.position[0] > 1000


@pytest.mark.parametrize(
    ("bad", "said"),
    [
        (np.eye(4), "shape"),
        (np.diag([1.0, 1.0, -1.0, 1.0])[None], r"poses\[0\].*rotation"),
        (np.full((1, 4, 4), np.nan), r"poses\[0\]"),
    ],
)
def test_inverse_refuses_what_is_no_pose(machine: Machine, bad: Array, said: str) -> None:
    with pytest.raises(InputError, match=said):
        inverse(machine, bad)


def test_a_redundant_arm_is_solved_too(tmp_path: Path) -> None:
    joints = "".join(
        f"    - {{name: q{k}, kind: revolute, alpha: {90 * (-1) ** k}, d: {20 * k}, r: {50 + 10 * k}, range: [-170, 170]}}\n"
        for k in range(1, 8)
    )
    text = "schema: truepose/machine/1\nname: seven\nmechanism:\n  type: serial\n  joints:\n"
    (tmp_path / "seven.yaml").write_text(f"{text}{joints}sensor: {{type: pose, sigma: {{xyz: 1, rot: 1}}}}\n")
    solver = PoseSolver(load_machine(tmp_path / "seven.yaml"))
    poses, _ = solver.forward(np.random.default_rng(7).uniform(-2, 2, (30, 7)))
    found = solver.inverse(poses)
    assert found.solved.all()
    assert np.abs(solver.forward(found.q)[0] - poses).max() < 1e-9 * solver.size


def test_the_reflection_point_stays_still_until_a_joint_saturates(machine: Machine) -> None:
    """Figures 7 and 11, judged by the simulator with the controller's own constants: still to far below 1 nm."""
    p, true = _values(machine, tables.DAY_0), geometry.Constants.tabled(tables.DAY_0)
    control = reflection.ReflectionControl(machine, p)
    start = control.facing(np.zeros(6))
    along = geometry.light(true)[1]
    assert geometry.normals(true, start[None])[0] @ along == pytest.approx(-1.0, abs=ROUNDING)
    held = control.turn(start, 2, np.radians(np.linspace(0.0, -90.0, 91)))
    world, own = geometry.reflection(true, held.q[: held.within])
    assert np.ptp(world, axis=0).max() < 1e-9 and np.ptp(own, axis=0).max() < 1e-9  # mm: 1e-3 nm
    assert held.saturated == ("q1",)
    assert 40 < -np.degrees(held.steps[held.within]) < 90
    assert abs(held.q[held.within - 1, 0]) <= 0.15 < abs(held.q[held.within, 0])
    other = control.turn(start, 2, np.radians(np.linspace(0.0, 90.0, 91)))
    assert other.saturated == ("q6",)


def test_identified_constants_hold_the_true_cavity_still(identified: Array) -> None:
    """From the strict plan's constants: the true cavity moves by nanometres where nominal ones move it by fringes."""
    nominal = np.array([p.nominal for p in study.machine().parameters])
    assert trajectories.circle(nominal, tables.DAY_0).swing > 0.78  # um: more than one fringe
    assert trajectories.circle(identified, tables.DAY_0).swing < 0.01
    turned = trajectories.turn(identified, tables.DAY_0)
    assert np.ptp(turned.change[: turned.held.within]) < 0.01
    assert turned.swing > 0.39  # um: fringes begin where the joint stops


def test_steps_of_beta_et_tilt_the_travel_by_as_much(machine: Machine) -> None:
    """Figure 15: an error e of the mirror's angle leaves travel * tan(e)."""
    p = _values(machine, tables.DAY_0)
    for error in (0.002, 0.012):
        swing = trajectories.misaligned(p, tables.DAY_0, error).swing
        assert swing == pytest.approx(300 * np.tan(np.radians(error)), rel=0.01)  # cosines of 1 deg


def test_reflection_needs_a_beam_that_meets_the_mirror(machine: Machine) -> None:
    arm = load_machine(MACHINES / "serial.yaml")
    with pytest.raises(InputError, match="no distance sensor"):
        reflection.reflections(arm, np.eye(4)[None])
    turned = PoseSolver(machine).forward(np.array([[0, 0, 0, np.pi / 2, 0, 0]]))[0]
    with pytest.raises(InputError, match=r"poses\[0\].*along the mirror"):
        reflection.reflections(machine, turned)


# Diagnosis and the demo


def test_nothing_is_missing_from_the_strict_plan(machine: Machine) -> None:
    result = engine.diagnose(machine, study.recorded(plan.paper_plan(), 1, seed=8))
    assert (result.verdict, result.concealed, result.findings) == ("adequate", False, ())


def test_demo_takes_every_bundled_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: dict[str, Any] = {}

    def diagnose(machine: Any, recording: Any, **_: Any) -> Any:
        seen.update(name=machine.name, rows=len(recording))
        raise InputError("seen")  # ends the command where the work would begin

    monkeypatch.setattr(engine, "diagnose", diagnose)
    done = CliRunner().invoke(app, ["demo", "nanopositioner", "-o", str(tmp_path / "out")])
    assert done.exit_code == 2 and "seen" in done.output
    assert seen == {"name": "nanopositioner", "rows": 69 * 101}
    assert not (tmp_path / "out").exists()
    unknown = CliRunner().invoke(app, ["demo", "teapot"])
    assert unknown.exit_code == 2 and "telescope, " in unknown.output and "nanopositioner" in unknown.output
