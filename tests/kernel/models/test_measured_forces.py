"""Measured forces as loads: torques of cross products, virtual work, frames, exact derivatives, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from support.closed_kinematics import readings
from support.moving_machines import FRAMED, HEAD, POSE, PUS, UPS
from support.pushed_arm import COLUMNS, RANGES, SENSOR, TOOL, held, placed, sensor_turn, text, torques
from support.simulated import machine_from
from support.structures import structure
from support.telescope_models import LOADED, TRAVEL
from support.telescope_models import machine_of as machine_of_telescope
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.identification.recording.load import load_recording
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
JOINTS = [f"q{k}" for k in range(1, 7)]
GRAVITY = np.array([0.5, -0.3, -9.8])


def machine_of(folder: Path, written: str) -> Machine:
    return machine_from(folder, written, "pushed")


def drawn(n: int, seed: int = 3) -> tuple[Array, Array]:
    """(n, 6) joints and wrenches: N, N m."""
    rng = np.random.default_rng(seed)
    low, high = np.radians(RANGES).T
    return rng.uniform(low, high, (n, 6)), rng.uniform(-1, 1, (n, 6)) * [80, 80, 80, 9, 9, 9]


def rows(q: Array, wrench: Array, columns: tuple[str, ...] = COLUMNS) -> dict[str, Array]:
    return dict(zip(JOINTS, np.degrees(q).T, strict=True)) | dict(zip(columns, wrench.T, strict=True))


def loads(machine: Machine, q: Array, wrench: Array, case: str = "") -> Array:
    """(n, 6) N m."""
    recording = load_recording(machine, rows(q, wrench), need_observations=False)
    predictor = Predictor(machine, recording, ports=True)
    found = predictor.loads(predictor.model.p_home, np.zeros((len(q), 0)))
    return np.column_stack([found[f"{case}{name}.displacement"] for name in JOINTS])


def compliant(machine: Machine, c: Array) -> list[PlacedEffect]:
    effect = effects.get("joint-compliance", "test")()
    return [PlacedEffect.at(effect, machine, (n,), {}, {"c": v}) for n, v in zip(JOINTS, c, strict=True)]


@pytest.mark.parametrize("gravity", ["", str(GRAVITY.tolist())], ids=["no gravity", "gravity"])
def test_loads_of_joints_are_lever_times_force(tmp_path: Path, gravity: str) -> None:
    machine, (q, wrench) = machine_of(tmp_path, text(gravity=gravity)), drawn(5)
    weight = GRAVITY if gravity else None
    expected = [torques(a, w, weight).real for a, w in zip(q, wrench, strict=True)]
    np.testing.assert_allclose(loads(machine, q, wrench), expected, rtol=1e-9, atol=1e-9)
    if gravity:
        alone = [torques(a, 0 * w, weight).real for a, w in zip(q, wrench, strict=True)]
        np.testing.assert_allclose(loads(machine, q, wrench, "weight|"), alone, rtol=1e-9, atol=1e-9)


def _in_base(q: Array, wrench: Array) -> Array:
    """The same wrenches, about the same point, along the base's axes."""
    turns = [placed(row).turns[5].real @ sensor_turn() for row in q]
    return np.array([[*(t @ w[:3]), *(t @ w[3:])] for t, w in zip(turns, wrench, strict=True)])


def _at_tool(q: Array, wrench: Array) -> Array:
    """The same along the tool's axes (the flange's), about the tool's origin."""
    turn, lever = sensor_turn(), (SENSOR - TOOL) / 1000
    return np.array([[*(turn @ w[:3]), *(turn @ w[3:] + np.cross(lever, turn @ w[:3]))] for w in wrench])


@pytest.mark.parametrize(
    ("force", "moved"),
    [
        ("in: sensor, axes: base", _in_base),
        ("in: tool", _at_tool),
        (f"in: flange, at: {TOOL.tolist()}, axes: tool", _at_tool),
        ("in: sensor, sign: 1", lambda q, wrench: wrench),
        ("in: sensor, sign: -1", lambda q, wrench: -wrench),
    ],
    ids=["base axes", "tool", "point of the flange", "is pushed by", "pushes with"],
)
def test_one_wrench_is_one_load_however_it_is_written(tmp_path: Path, force: str, moved: object) -> None:
    assert callable(moved)
    q, wrench = drawn(4)
    expected = loads(machine_of(tmp_path, text()), q, wrench)
    other = loads(machine_of(tmp_path, text(force=force)), q, moved(q, wrench))
    np.testing.assert_allclose(other, expected, rtol=1e-9, atol=1e-9)


def test_virtual_work(tmp_path: Path) -> None:
    """Castigliano: force times what the compliant joints let the tool move is twice their energy, sum of c tau^2 / 2."""
    q, wrench = drawn(6)
    wrench[:, 3:] = 0.0
    machine = machine_of(tmp_path, text(force="in: tool, axes: base"))
    c = 1e-9 * np.arange(1.0, 7.0)  # so stiff that what is quadratic in it plays no part
    recording = load_recording(machine, rows(q, wrench), need_observations=False)
    ends = []
    for parts in ([], compliant(machine, c)):
        predictor = Predictor(machine, recording, parts)
        ends.append(predictor.poses(predictor.model.p_home)[0][:, :3, 3])
    work = np.einsum("ni,ni->n", ends[1] - ends[0], wrench[:, :3]) / 1000  # N m
    np.testing.assert_allclose(work, loads(machine, q, wrench) ** 2 @ c, rtol=1e-5)


@pytest.mark.parametrize("gravity", ["", str(GRAVITY.tolist())], ids=["no gravity", "gravity"])
def test_derivatives_of_the_reading_are_those_of_complex_steps(tmp_path: Path, gravity: str) -> None:
    machine, (q, wrench) = machine_of(tmp_path, text(gravity=gravity, tolerance=0.1)), drawn(3)
    weight, c = GRAVITY if gravity else None, 1e-5 * np.array([2.0, 3.0, 4.0, 5.0, 6.0, 7.0])
    predictor = Predictor(
        machine, load_recording(machine, rows(q, wrench), need_observations=False), compliant(machine, c)
    )
    p = predictor.model.p_home
    _, values, slopes, _ = predictor.columns(p, np.zeros((3, 0)))
    names = list(predictor.model.names)
    lengths = [f"{j}.{x}" for j in ("q2", "q3", "q6") for x in ("d", "r", "alpha", "theta")]

    def tool(row: int, changes: dict[str, complex], at: NDArray[np.complex128]) -> NDArray[np.complex128]:
        tau = torques(q[row], wrench[row], weight, changes)
        return placed(q[row] + at * tau, changes).tool

    for row in range(3):
        np.testing.assert_allclose(values[row], tool(row, {}, c.astype(complex)).real, atol=1e-9)
        for name in (*lengths, "tool.x", "tool.z"):
            expected = tool(row, {name: 1e-30j}, c.astype(complex)).imag / 1e-30
            np.testing.assert_allclose(slopes[row][:, names.index(name)], expected, rtol=1e-8, atol=1e-8)
        for k, joint in enumerate(JOINTS):
            expected = tool(row, {}, c + 1e-30j * np.eye(6)[k]).imag / 1e-30
            found = slopes[row][:, names.index(f"joint-compliance@{joint}:c")]
            np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-6)


# -- a force as large as a weight does what the weight does --------------------------------------------

PUSHED = "forces: {hung: {columns: [fx, fy, fz], in: tool, at: [50, -20, 40], axes: base}}\n"
HUNG = 2.0


def _without_payload(written: str) -> str:
    return "\n".join(line for line in written.splitlines() if not line.startswith("  payload:")) + "\n"


def _pair(folder: Path, written: str) -> tuple[Machine, Machine]:
    """A machine with a payload of 2 kg at [50, -20, 40] of the tool, and the same without it, pushed at."""
    pushed = _without_payload(written) + PUSHED
    return machine_from(folder, written, "hung"), machine_from(folder, pushed, "pushed")


@pytest.mark.parametrize("form", [PUS, UPS], ids=["6-pus", "6-ups"])
def test_legs_carry_a_force_as_they_carry_a_weight(tmp_path: Path, form: str) -> None:
    hung, pushed = _pair(tmp_path, HEAD.format(name="m") + FRAMED + form + POSE)
    q = readings(hung, np.random.default_rng(4), 3)
    down = HUNG * np.array([0.5, -0.3, -9.80665])
    joints = dict(zip(hung.mechanism.readings, q.T, strict=True))
    table = joints | {f"f{a}": np.full(3, v) for a, v in zip("xyz", down, strict=True)}
    effect = effects.get("leg-compliance", "test")()
    legs = tuple(limb.name for limb in hung.mechanism.limbs)
    poses, tensions = [], []
    for machine, columns in ((hung, joints), (pushed, table)):
        recording = load_recording(machine, columns, need_observations=False)
        soft = Predictor(machine, recording, [PlacedEffect.at(effect, machine, legs, {}, {"c": 1e-3})])
        x, good = soft.assemble(soft.model.p_home)
        assert good.all()
        poses.append(soft.poses(soft.model.p_home, x)[0])
        tensions.append(x[:, -6:])
    np.testing.assert_allclose(tensions[1], tensions[0], rtol=1e-7, atol=1e-6)
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-8)


def test_elastic_legs_carry_a_force_as_they_carry_a_weight(tmp_path: Path) -> None:
    hung = machine_of_telescope(tmp_path, "stiffness", *LOADED)
    push = "forces: {hung: {columns: [fx, fy, fz], in: platform, axes: base}}\ntolerances:"
    pushed = machine_of_telescope(tmp_path, "stiffness", ("tolerances:", push))
    weight = {"fx": np.zeros(4), "fy": np.zeros(4), "fz": np.full(4, -20 * 9.80665)}
    joints = dict(zip(hung.mechanism.readings, TRAVEL[:4].T, strict=True))
    poses = []
    for machine, more in ((hung, {}), (pushed, weight), (pushed, {})):
        recording = load_recording(machine, joints | more, need_observations=False)
        predictor = Predictor(machine, recording)
        found, good = predictor.poses(predictor.model.p_home)
        assert good.all()
        poses.append(found)
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-9)
    assert np.abs(poses[2] - poses[0]).max() > 1e-4


# -- what is wrong is told -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("force", "found"),
    [
        (
            "in: sensr, axes: sensor",
            "forces.process.in: found 'sensr', expected a body, or a frame that one carries; did you mean 'sensor'",
        ),
        ("in: tool, axes: world", "forces.process.axes: found 'world'"),
        ("in: tool, sign: 0", "forces.process.sign"),
        ("in: tool, frame: base", "forces.process.frame: unknown field"),
    ],
)
def test_a_wrong_entry_is_refused(tmp_path: Path, force: str, found: str) -> None:
    with pytest.raises(InputError) as told:
        machine_of(tmp_path, text(force=force))
    assert found in str(told.value)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ("ft.x, ", "", "forces.process.columns: expected 3 names of columns"),
        ("ft.x, ft.y", "ft.y, ft.y", "(force) or 6 (force, then moment), all different"),
        ("ft.x, ", "q1, ", "found 'q1', a joint"),
    ],
)
def test_wrong_columns_are_refused(tmp_path: Path, old: str, new: str, found: str) -> None:
    with pytest.raises(InputError) as told:
        machine_of(tmp_path, text().replace(old, new))
    assert found in str(told.value)


def test_a_file_without_the_force_is_free_of_it_and_half_a_force_is_refused(tmp_path: Path) -> None:
    machine, (q, wrench) = machine_of(tmp_path, text()), drawn(3)
    table = rows(q, wrench)
    free = {name: table[name] for name in JOINTS}
    recording = load_recording(machine, [table, free], need_observations=False)
    values = recording.driver("ft.x")
    assert values is not None
    np.testing.assert_allclose(values, [*wrench[:, 0], 0.0, 0.0, 0.0])
    (note,) = [n for n in recording.notes if "forces.process" in n]
    assert "this force counts as 0 there" in note
    with pytest.raises(
        InputError, match=r"missing column 'ft.mz', expected all or none of forces.process.columns"
    ):
        load_recording(machine, {n: v for n, v in table.items() if n != "ft.mz"}, need_observations=False)


def _written(machine: Machine, q: Array) -> Array:
    """Readings (n, nq) in mm and deg."""
    return np.asarray(np.where([a.unit == "rad" for a in machine.mechanism.actuators], np.degrees(q), q))


def test_a_link_bends_under_a_force_as_under_a_weight(tmp_path: Path) -> None:
    """The link's own weight still acts where it is along the link, whichever way the force points."""
    arm = structure(tmp_path, "arm")
    assert arm.file is not None
    document = arm.file.path.read_text(encoding="utf-8")
    q = readings(arm, np.random.default_rng(5), 3)
    at, g = (12.0, -5.0, 30.0), np.array(arm.gravity)
    pushing = f"forces: {{hung: {{columns: [fx, fy, fz], in: tool, at: {list(at)}, axes: base}}}}\n"
    joints = dict(zip(arm.mechanism.readings, _written(arm, q).T, strict=True))
    poses = []
    for kg, pushed in ((7.0, False), (0.0, True)):
        tail = pushing if pushed else ""
        path = tmp_path / f"arm-{pushed}.yaml"
        path.write_text(document + tail, encoding="utf-8")
        machine = load_machine(path)
        heavy = [replace(m) for m in machine.masses]
        if kg:
            heavy.append(replace(heavy[-1], name="hung", kg=kg, com=at, body="tool"))
        machine = replace(machine, masses=tuple(heavy))
        columns = joints | (
            {f"f{a}": np.full(3, 7.0 * v) for a, v in zip("xyz", g, strict=True)} if pushed else {}
        )
        effect = effects.get("link-bending", "test")()
        links = [
            PlacedEffect.at(effect, machine, place, {}, {"c": 1e-12}) for place in effect.places(machine)
        ]
        predictor = Predictor(machine, load_recording(machine, columns, need_observations=False), links)
        poses.append(predictor.poses(predictor.model.p_home)[0])
    np.testing.assert_allclose(poses[1], poses[0], atol=1e-9)


def test_an_arm_in_balance_is_predicted_to_second_order(tmp_path: Path) -> None:
    """Loads are those of the arm as it reads; what that leaves out is quadratic in the yielding."""
    machine, (q, wrench) = machine_of(tmp_path, text(gravity=str(GRAVITY.tolist()))), drawn(8)
    errors = []
    for c in (np.full(6, 2e-6), np.full(6, 1e-6)):
        recording = load_recording(machine, rows(q, wrench), need_observations=False)
        predictor = Predictor(machine, recording, compliant(machine, c))
        found = predictor.poses(predictor.model.p_home)[0][:, :3, 3]
        truth = [placed(held(a, c, w, GRAVITY)).tool.real for a, w in zip(q, wrench, strict=True)]
        errors.append(np.linalg.norm(found - truth))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)


def test_units_of_columns_and_file_play_no_part(tmp_path: Path) -> None:
    q, wrench = drawn(4)
    expected = loads(machine_of(tmp_path, text()), q, wrench)
    declared = "drivers: [" + ", ".join(f"{{name: {c}, unit: kN}}" for c in COLUMNS[:3]) + "]\n"
    scaled = wrench * [1e-3, 1e-3, 1e-3, 1e3, 1e3, 1e3]
    table = pd.DataFrame(rows(q, scaled)).rename(columns={c: f"{c} [N*mm]" for c in COLUMNS[3:]})
    machine = machine_of(tmp_path, text() + declared)
    predictor = Predictor(machine, load_recording(machine, table, need_observations=False), ports=True)
    found = predictor.loads(predictor.model.p_home, np.zeros((4, 0)))
    np.testing.assert_allclose([found[f"{n}.displacement"] for n in JOINTS], expected.T, rtol=1e-9, atol=1e-9)
