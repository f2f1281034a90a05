"""The telescope's models: constant Jacobian, bent flexures, elastic legs, and their calibration. mm, N, rad."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from truepose.challenge.simulator.telescope_ring import beams
from truepose.codegen.c import generate
from truepose.errors import InputError
from truepose.identification.estimate import estimate
from truepose.identification.implicit import ClosurePredictor
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.identification.write_machine import write_calibrated
from truepose.models import lie
from truepose.models.effects.base import PlacedEffect, effects
from truepose.models.elastic import Ends, Flexibility, Segment, strain_energy
from truepose.models.flexure import SHAPE, gain
from truepose.models.kinematics import symbolic_model
from truepose.models.load import load_machine
from truepose.models.machine import Machine
from truepose.models.mechanism import ElasticChain

ROOT = Path(__file__).resolve().parent.parent
Array = NDArray[np.float64]
MODELS = ("spherical", "linear", "beam", "stiffness", "elastic")
NEAR_HOME = ("linear", "stiffness")
LENGTH = 30.0


def _benchmark(name: str) -> ModuleType:
    """A module of the studies, which are no part of the installed package."""
    folder = str(ROOT / "benchmarks")
    if folder not in sys.path:
        sys.path.append(folder)
    return importlib.import_module(name)


simulator = _benchmark("telescope_simulator")
campaigns, fits = _benchmark("telescope_models.campaign"), _benchmark("telescope_models.fits")


def machine_of(folder: Path, model: str, *edits: tuple[str, str], sensor: str = "pose") -> Machine:
    """The nominal telescope in a model, its text edited."""
    text = campaigns.model_text(model, sensor)
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    path = folder / f"{model}.yaml"
    path.write_text(text)
    return load_machine(path)


def recording_of(folder: Path, machine: Machine, rho: Array) -> Recording:
    """Travels (n, 6) with readings that mean nothing."""
    columns = [*machine.mechanism.readings, *(c for s in machine.sensors for c in s.columns)]
    rows = [[*row, *np.zeros(len(columns) - 6)] for row in rho]
    text = "\n".join(",".join(f"{v:.9g}" for v in row) for row in rows)
    (folder / "poses.csv").write_text(",".join(columns) + "\n" + text + "\n")
    return load_recording(machine, [folder / "poses.csv"])


def poses_of(folder: Path, machine: Machine, rho: Array, placed: tuple[PlacedEffect, ...] = ()) -> Array:
    """(n, 4, 4) poses of the tool."""
    predictor = Predictor(machine, recording_of(folder, machine, rho), placed)
    poses, good = predictor.poses(predictor.model.p_home)
    assert good.all()
    return poses


def apart(one: Array, other: Array) -> float:
    """Largest distance of tool positions, mm."""
    return float(np.max(np.linalg.norm(one[:, :3, 3] - other[:, :3, 3], axis=1)))


def bending(machine: Machine, values: dict[str, float], form: float = 2.0) -> PlacedEffect:
    kind = effects.get("platform-deformation", "test")()
    return PlacedEffect.at(kind, machine, ("platform",), {"form": form}, values)


TRAVEL = np.asarray(simulator.paper_poses()[1][:12])


# --- constant Jacobian -------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", NEAR_HOME)
def test_models_about_home_err_by_the_square_of_the_travel(tmp_path: Path, model: str) -> None:
    # soft flexures on stiff legs: only the directions that are kept at home separate them from ball joints
    soft = (("flexure: {length: 30", "flexure: {length: 30, beta: 0.25"),) if model == "linear" else ()
    near = machine_of(tmp_path, model, *soft)
    if model == "stiffness":
        near = machine_of(tmp_path, model, *hinged(near))
    exact = machine_of(tmp_path, "spherical")
    errors = [
        apart(poses_of(tmp_path, near, s * TRAVEL), poses_of(tmp_path, exact, s * TRAVEL))
        for s in (1.0, 0.5, 0.25)
    ]
    # a cubic term of the travel's share of the machine (1.3 of 400 mm, lever 1 to 2) bends the ratio by 1 %
    assert np.allclose(np.divide(errors[:-1], errors[1:]), 4.0, rtol=0.03)
    assert errors[0] > 1e-3


def test_the_linear_model_is_the_inverse_jacobian_of_home(tmp_path: Path) -> None:
    """Equations 8 and 9, written out in numpy, with a platform that bends."""
    machine = machine_of(tmp_path, "linear")
    k = 0.01 * np.random.default_rng(3).standard_normal((6, 6))
    placed = bending(machine, {f"K[{i + 1},{j + 1}]": float(k[i, j]) for i in range(6) for j in range(6)})
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL), (placed,))
    x, good = predictor.assemble(predictor.model.p_home)
    assert good.all()
    drawn = simulator.nominal_machine()
    home = x[0, 6:9]
    z = home + drawn.upper_centres - drawn.lower_centres(np.zeros(6))
    z /= np.linalg.norm(z, axis=1)[:, None]
    # home has no turn worth mentioning (1e-8 rad): modified Rodrigues parameters there are angle / 4
    moved = (x[:, :3] - home) @ z.T + 4 * (x[:, 3:6] - x[0, 9:]) @ np.cross(drawn.upper_centres, z).T
    assert np.allclose((moved + (TRAVEL @ k.T) * z[:, 2]) / z[:, 2], TRAVEL, rtol=0, atol=1e-7)


# --- flexures as beam theory bends them ------------------------------------------------------------------------


def number(value: ca.SX) -> float:
    return float(ca.evalf(value))


def grown(angle: float, shape: float = SHAPE) -> float:
    return number(gain(ca.SX(LENGTH), ca.SX(shape), ca.SX(np.cos(angle))))


@pytest.mark.parametrize("shape", [0.0, 0.1, 0.25, 0.4])
@pytest.mark.parametrize("angle", [0.001, 0.02, 0.3])
def test_the_tip_of_a_flexure_stays_on_its_circle(shape: float, angle: float) -> None:
    """Equation 15: (1 - beta) l from a point (1/2 - beta) l behind the middle, along the straight flexure."""
    reach = LENGTH / 2 + grown(angle, shape)
    tip = np.array([(0.5 - shape) * LENGTH + reach * np.cos(angle), reach * np.sin(angle)])
    assert np.linalg.norm(tip) == pytest.approx((1 - shape) * LENGTH, rel=1e-14)


def test_a_flexure_shortens_like_an_arc_of_its_length() -> None:
    for angle in np.radians([0.2, 0.6, 1.0]):
        arc = LENGTH * np.array([np.sin(angle), 1 - np.cos(angle)]) / angle
        reach = LENGTH / 2 + grown(float(angle))
        model = np.array([LENGTH / 2 + reach * np.cos(angle), reach * np.sin(angle)])
        # across, the tip of the arc lags by l d^3/24 (7 nm at 1 deg); along, both agree to the order d^4
        assert abs(model[0] - arc[0]) < 0.01 * LENGTH * angle**4 * 10
        assert abs(model[1] - arc[1]) == pytest.approx(LENGTH * angle**3 / 24, rel=0.01)
        ball = LENGTH / 2 * (1 + np.cos(angle))
        assert model[0] - ball == pytest.approx(LENGTH * angle**2 / 12, rel=1e-3)


def test_short_flexures_and_those_that_turn_about_their_middle_are_ball_joints(tmp_path: Path) -> None:
    ball = poses_of(tmp_path, machine_of(tmp_path, "spherical"), TRAVEL)
    bent = poses_of(tmp_path, machine_of(tmp_path, "beam"), TRAVEL)
    assert 1e-4 < apart(bent, ball) < 1e-3  # 0.5 um
    centred = (("flexure: {length: 30", "flexure: {length: 30, beta: 0.5"),)
    assert apart(poses_of(tmp_path, machine_of(tmp_path, "beam", *centred), TRAVEL), ball) < 1e-11
    short = (("flexure: {length: 30", "flexure: {length: 0.003"),)
    # the shift is proportional to the length
    assert apart(poses_of(tmp_path, machine_of(tmp_path, "beam", *short), TRAVEL), ball) < 1e-7


def test_bent_legs_are_as_long_as_equations_14_to_17_say(tmp_path: Path) -> None:
    poses = poses_of(tmp_path, machine_of(tmp_path, "beam"), TRAVEL)
    drawn = simulator.nominal_machine()
    home = poses_of(tmp_path, machine_of(tmp_path, "spherical"), np.zeros((1, 6)))[0]
    tool = drawn.frame("tool")

    def legs(pose: Array, rho: Array) -> Array:
        platform = pose @ np.linalg.inv(tool)
        return np.asarray(
            drawn.upper_centres @ platform[:3, :3].T + platform[:3, 3] - drawn.lower_centres(rho)
        )

    straight = legs(home, np.zeros(6))
    straight /= np.linalg.norm(straight, axis=1)[:, None]
    for pose, rho in zip(poses, TRAVEL, strict=True):
        leg = legs(pose, rho)
        z = leg / np.linalg.norm(leg, axis=1)[:, None]
        total = 500.0 - LENGTH
        for against in (straight, straight @ pose[:3, :3].T):
            c = 0.5 * np.sum(z * against, axis=1)
            total = total + LENGTH / 2 * (np.sqrt(2.0 + c**2) - c)
        # home is turned by 1e-8 rad, which R alone counts as bending
        assert np.allclose(np.linalg.norm(leg, axis=1), total, rtol=0, atol=1e-8)


# --- elastic rods ---------------------------------------------------------------------------------------------


def chain_stiffness(lengths: list[float], sections: list[Any]) -> Array:
    """(12, 12) of a chain along x, its inner nodes condensed (eqs. 20 to 27), by independent elements."""
    n = len(lengths) + 1
    k = np.zeros((6 * n, 6 * n))
    for i, (length, section) in enumerate(zip(lengths, sections, strict=True)):
        at = slice(6 * i, 6 * i + 12)
        k[at, at] += beams.element_stiffness(section, length)
    ends = np.r_[0:6, 6 * n - 6 : 6 * n]
    inner = np.setdiff1d(np.arange(6 * n), ends)
    inside = np.linalg.solve(k[np.ix_(inner, inner)], k[np.ix_(inner, ends)])
    return np.asarray(k[np.ix_(ends, ends)] - k[np.ix_(ends, inner)] @ inside)


FLEXURE = beams.Section.round_bar(6.2, 110e3)
BAR = beams.Section.round_bar(40.0, 200e3)
NAMES = ("flexure.bending", "flexure.tension", "flexure.torsion", "rod.bending", "rod.tension", "rod.torsion")
VALUES = {
    name: ca.SX(value)
    for name, value in zip(
        NAMES, (FLEXURE.ei_y, FLEXURE.ea, FLEXURE.gj, BAR.ei_y, BAR.ea, BAR.gj), strict=True
    )
} | {"leg.flexure": ca.SX(LENGTH)}
CHAIN = ElasticChain("leg.flexure", (NAMES[0], NAMES[1], NAMES[2]), (NAMES[3], NAMES[4], NAMES[5]), 1e4)


def frame(turn: Array, at: Array) -> ca.SX:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = lie.exp_so3(turn), at
    return ca.SX(ca.DM(out))


def test_the_energy_of_a_rod_is_that_of_its_condensed_elements() -> None:
    """Both ends displaced and turned at random; stiffness 20 to 27 from the simulator's own elements."""
    rng = np.random.default_rng(11)
    start, along = np.array([10.0, -20.0, 30.0]), np.array([0.3, -0.2, 0.9])
    along /= np.linalg.norm(along)
    far = start + 500.0 * along
    home = Ends(frame(rng.normal(size=3), start), frame(rng.normal(size=3), far), *ends_of(start, far))
    k = chain_stiffness([LENGTH, 500.0 - LENGTH, LENGTH], [FLEXURE, BAR, FLEXURE])
    local = np.kron(np.eye(4), beams.beam_frame(start, far, np.array([0.0, 0.0, 1.0])))
    for _ in range(5):
        shifts, turns = rng.normal(size=(2, 3)), 0.01 * rng.normal(size=(2, 3))
        rotations = lie.exp_so3(turns)
        frames = [
            turned(f, r, s) for f, r, s in zip((home.frame_a, home.frame_b), rotations, shifts, strict=True)
        ]
        now = Ends(frames[0], frames[1], *ends_of(start + shifts[0], far + shifts[1]))
        # the nodes lie half a flexure beyond the centres; small rotations are the skew part's vector
        beyond = LENGTH / 2 * np.outer((-1, 1), along)
        nodes = shifts + np.einsum("kij,kj->ki", rotations - np.eye(3), beyond)
        small = [np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / 2 for r in rotations]
        u = local.T @ np.concatenate([nodes[0], small[0], nodes[1], small[1]])
        energy = number(strain_energy(CHAIN, home, now, ca.SX(500.0), ca.SX(0.0), VALUES))
        assert energy == pytest.approx(0.5 * u @ k @ u, rel=1e-9)


def ends_of(a: Array, b: Array) -> tuple[ca.SX, ca.SX]:
    return ca.SX(ca.DM(a)), ca.SX(ca.DM(b))


def turned(home: ca.SX, rotation: Array, shift: Array) -> ca.SX:
    out = np.array(ca.evalf(home), dtype=float)
    out[:3, :3], out[:3, 3] = rotation @ out[:3, :3], out[:3, 3] + shift
    return ca.SX(ca.DM(out))


def test_a_chain_of_equal_pieces_is_a_cantilever() -> None:
    ei, ea, gj, length = 3e6, 5e5, 2e6, 120.0
    piece = [Segment(ca.SX(v), ca.SX(ei), ca.SX(ea), ca.SX(gj)) for v in (20.0, 70.0, 30.0)]
    found = Flexibility.of(piece)
    assert number(found.tip) == pytest.approx(length**3 / (3 * ei), rel=1e-12)
    assert number(found.slope) == pytest.approx(length**2 / (2 * ei), rel=1e-12)
    assert number(found.turn) == pytest.approx(length / ei, rel=1e-12)
    assert number(found.stretch) == pytest.approx(length / ea, rel=1e-12)
    assert number(found.twist) == pytest.approx(length / gj, rel=1e-12)


def test_the_printed_stiffness_matrix_holds_a_rod_against_turning_freely() -> None:
    """Equation 21 as printed: rows 5 and 6 of K12 and K21 have the wrong sign, so that a rigid turn costs force."""
    length, ei = LENGTH, FLEXURE.ei_y
    right = beams.element_stiffness(FLEXURE, length)
    printed = right.copy()
    for row, column in ((4, 2), (5, 1)):
        printed[row, 6 + column] *= -1
        printed[6 + row, column] *= -1
    turn = np.zeros(12)
    turn[5] = turn[11] = 1.0
    turn[7] = length  # about z at the near end: the far end moves along y
    assert np.abs(right @ turn).max() < 1e-9 * ei
    assert np.abs(printed @ turn).max() > ei / length
    assert np.allclose(right, right.T, rtol=1e-12) and not np.allclose(printed, printed.T, rtol=1e-3)


def hinged(machine: Machine) -> list[tuple[str, str]]:
    """Edits that make legs nearly rigid in tension and flexures nearly free to bend and twist."""
    value = {p.name: p.nominal for p in machine.parameters}

    def text(part: str, soft: float, stiff: float) -> str:
        b, t, w = (value[f"{part}.{name}"] for name in ("bending", "tension", "torsion"))
        return f"bending: {soft * b:.6g}, tension: {stiff * t:.6g}, torsion: {soft * w:.6g}"

    return [
        (text("flexure", 1.0, 1.0), text("flexure", 1e-6, 1e4)),
        (text("rod", 1.0, 1.0), text("rod", 1.0, 1e4)),
    ]


def test_hinged_stiff_legs_are_ball_joints(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "elastic")
    ball = poses_of(tmp_path, machine_of(tmp_path, "spherical"), TRAVEL)
    real = apart(poses_of(tmp_path, machine, TRAVEL), ball)
    free = apart(poses_of(tmp_path, machine_of(tmp_path, "elastic", *hinged(machine)), TRAVEL), ball)
    # ten orders of stiffness apart: what flexures do shrinks to the rounding of the printed numbers
    assert real > 1e-3 and free < 1e-9 * 500


def test_elastic_legs_meet_the_finite_element_simulator(tmp_path: Path) -> None:
    """Co-rotating elements and shortening there, small rotations here; ball joints are 1.7 um away."""
    truth = simulator.simulate(
        simulator.nominal_machine(), TRAVEL, ring_stiffness=np.inf, joints="flexure"
    ).pose_world_tool
    away = {model: apart(poses_of(tmp_path, machine_of(tmp_path, model), TRAVEL), truth) for model in MODELS}
    assert away["elastic"] < 0.8e-3
    assert 1.2e-3 < away["spherical"] < 2.5e-3
    assert away["stiffness"] > 5e-3  # the directions kept at home cost more than the flexures do


def test_the_platform_is_in_balance(tmp_path: Path) -> None:
    """Equation 19: loads at b' from the condensed stiffness, moments carried to the platform's centre, add to zero."""
    machine = machine_of(tmp_path, "stiffness")
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL))
    x, _ = predictor.assemble(predictor.model.p_home)
    drawn = simulator.nominal_machine()
    k = chain_stiffness([LENGTH, 500.0 - LENGTH, LENGTH], [FLEXURE, BAR, FLEXURE])
    home, at_home = x[0, 6:9], rotation_of(x[0, 9:])
    a, b = drawn.lower_centres(np.zeros(6)), drawn.upper_centres @ at_home.T
    for row, rho in zip(x, TRAVEL, strict=True):
        turn = rotation_of(row[3:6]) @ at_home.T
        forces, moments = [], []
        for i in range(6):
            axes = beams.beam_frame(a[i], home + b[i], np.array([0.0, 0.0, 1.0]))
            node = b[i] + LENGTH / 2 * axes[:, 0]
            u = np.zeros((4, 3))
            u[0] = rho[i] * drawn.directions[i]
            u[2] = row[:3] + turn @ node - home - node
            u[3] = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
            load = (k @ (u @ axes).ravel()).reshape(4, 3) @ axes.T
            forces.append(load[2])
            moments.append(np.cross(turn @ node, load[2]) + load[3])
        # sections are written with 6 digits; moments of the clamped ends are taken to first order in the turn (9 mrad)
        assert np.linalg.norm(np.sum(forces, axis=0)) < 1e-5 * np.sum(np.linalg.norm(forces, axis=1))
        assert np.linalg.norm(np.sum(moments, axis=0)) < 1e-3 * np.sum(np.linalg.norm(moments, axis=1))


def rotation_of(mrp: Array) -> Array:
    return np.asarray(ca.evalf(lie.mrp_rotation(ca.SX(ca.DM(mrp)))), dtype=float)


LOADED = (
    ("units: {length: mm, angle: deg}", "units: {length: mm, angle: deg}\ngravity: [0, 0, -9.80665]"),
    ("tolerances:", "masses:\n  payload: {kg: 20, com: [0, 0, 0], in: platform}\ntolerances:"),
)


def test_elastic_legs_carry_the_platform(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "stiffness", *LOADED)
    light = poses_of(tmp_path, machine_of(tmp_path, "stiffness"), np.zeros((1, 6)))
    loaded = poses_of(tmp_path, machine, np.zeros((1, 6)))
    sag = loaded[0, :3, 3] - light[0, :3, 3]
    pull = machine.mechanism.rods[0].elastic
    assert pull is not None
    cosine = light[0, 2, 3] - 120.0
    vertical = 6 * pull.stiffness * (cosine / 500.0) ** 2
    # bending of the clamped legs helps by less than 1 %
    assert -sag[2] == pytest.approx(20 * 9.80665 / vertical, rel=0.01)
    assert np.abs(sag[:2]).max() < 1e-6


def test_an_effect_of_loads_is_refused_where_legs_are_elastic(tmp_path: Path) -> None:
    line = "tolerances:"
    soft = "effects:\n  - {effect: leg-compliance, place: [leg1], parameters: {c: {value: 1e-4, unit: mm/N}}}\ntolerances:"
    machine = machine_of(tmp_path, "stiffness", *LOADED, (line, soft))
    with pytest.raises(InputError, match=r"leg-compliance@leg1.*elastic.*expected model: spherical"):
        symbolic_model(machine, machine.effects)


@pytest.mark.parametrize("model", ["linear", "beam"])
def test_soft_legs_shorten_alike_in_the_models_with_joints(tmp_path: Path, model: str) -> None:
    exact, other = (machine_of(tmp_path, name, *LOADED) for name in ("spherical", model))
    kind = effects.get("leg-compliance", "test")()
    sags = []
    for machine in (exact, other):
        soft = PlacedEffect.at(kind, machine, tuple(f"leg{k}" for k in range(1, 7)), {}, {"c": 1e-4})
        both = [poses_of(tmp_path, machine, TRAVEL, placed) for placed in ((), (soft,))]
        sags.append(both[1][:, :3, 3] - both[0][:, :3, 3])
    # leg forces of ball joints at a pose that differs by 16 um of 500 mm
    assert np.allclose(sags[1], sags[0], rtol=0, atol=1e-3 * np.abs(sags[0]).max())
    assert np.abs(sags[0]).max() > 1e-3


# --- derivatives, files, C ------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_poses_by_every_constant(tmp_path: Path, model: str) -> None:
    machine = machine_of(tmp_path, model)
    placed = bending(machine, {f"K[{i},{i}]": 0.01 for i in range(1, 7)}, 1.0)
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL[:3]), (placed,))
    p = predictor.model.p_home
    x, _ = predictor.assemble(p)
    twist = predictor.twists(p, x)[1]
    for k, name in enumerate(predictor.model.names):
        step = 1e-5 * max(1.0, abs(p[k]))
        moved = []
        for sign in (1, -1):
            shifted = p.copy()
            shifted[k] += sign * step
            moved.append(predictor.poses(shifted)[0])
        slope = np.hstack(
            [
                (moved[0] - moved[1])[:, :3, 3],
                lie.log_so3(moved[0][:, :3, :3] @ moved[1][:, :3, :3].transpose(0, 2, 1)),
            ]
        ) / (2 * step)
        # rounding of poses (500 mm) over the step, and its square; a stiffness moves hardly anything
        size = 1e-13 * 500 / step + 1e-5 * np.abs(twist[:, :, k]).max()
        assert np.allclose(twist[:, :, k], slope, rtol=0, atol=size), name


@pytest.mark.parametrize(
    ("model", "old", "new", "message"),
    [
        ("beam", "flexure: {length: 30", "flexure: {length: 600", r"legs: leg1: found flexures of 600 mm"),
        ("beam", "flexure: {length: 30", "flexure: {length: -30", r"flexure.*expected length > 0"),
        ("beam", "flexure: {length: 30", "flexure: {length: 30, beta: 0.8", r"expected 0 <= beta < 0.75"),
        ("stiffness", "rod: {", "# {", r"mechanism.rod: found none, expected one: model stiffness"),
        (
            "stiffness",
            "flexure: {length: 30, bending: ",
            "flexure: {length: 30}  # ",
            r"flexure.bending: found none",
        ),
        ("linear", "model: linear", "model: lineal", r"mechanism.model"),
    ],
)
def test_what_a_model_lacks_is_told(tmp_path: Path, model: str, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        machine_of(tmp_path, model, (old, new))


def test_beam_theory_without_flexures_is_refused(tmp_path: Path) -> None:
    text = campaigns.model_text("beam", "pose")
    kept = [line for line in text.splitlines() if not line.strip().startswith("flexure:")]
    (tmp_path / "m.yaml").write_text("\n".join(kept).replace("beta: 0.025, ", ""))
    with pytest.raises(InputError, match=r"mechanism.flexure: found none, expected one: model beam"):
        load_machine(tmp_path / "m.yaml")


@pytest.mark.parametrize("model", ["beam", "elastic"])
def test_a_calibrated_file_holds_flexures_and_stiffnesses(tmp_path: Path, model: str) -> None:
    drawn = simulator.nominal_machine()
    simulation = simulator.simulate(
        drawn, TRAVEL, ring_stiffness=np.inf, sensor=simulator.PoseSensor(), seed=1
    )
    machine = machine_of(tmp_path, model)
    (tmp_path / "r.csv").write_text(simulator.recording_text(simulation))
    recording = load_recording(machine, [tmp_path / "r.csv"])
    fit = estimate(machine, recording)
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    read = load_machine(tmp_path / "calibrated.yaml")
    names = [p.name for p in machine.parameters]
    assert names == [p.name for p in read.parameters]
    assert any(name.endswith(".flexure") for name in names)
    assert np.allclose([p.nominal for p in read.parameters], fit.p[: len(names)], rtol=1e-12, atol=1e-12)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler found")
@pytest.mark.parametrize("model", ["linear", "beam"])
def test_generated_c_meets_the_models_own_poses(tmp_path: Path, model: str) -> None:
    generate(machine_of(tmp_path, model), tmp_path / "c")
    sources = [str(path) for path in (tmp_path / "c").glob("*.c")]
    command = [
        "gcc",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Werror",
        *sources,
        "-o",
        str(tmp_path / "example"),
        "-lm",
    ]
    subprocess.run(command, check=True, capture_output=True)
    run = subprocess.run(
        [str(tmp_path / "example")], cwd=tmp_path / "c", check=True, capture_output=True, text=True
    )
    assert "0 of" in run.stdout


# --- calibration ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def campaign() -> Iterator[Any]:
    with campaigns.measured(7) as measured:
        yield measured


@cache
def _outcome(campaign: Any, model: str, platform: str) -> Any:
    return fits.calibrated(campaign, model, platform)


@pytest.mark.parametrize("platform", ["rigid", "linear", "matrix"])
@pytest.mark.parametrize("model", ["spherical", "linear", "beam", "stiffness"])
def test_all_twelve_calibrate(campaign: Any, model: str, platform: str) -> None:
    """Data from beam elements. Six parameters a leg are found, the report's; a few um are left in every case."""
    outcome = _outcome(campaign, model, platform)
    last = ".u." if platform == "rigid" else "K["
    kinds = (".a.x", ".a.y", ".b.x", ".b.y", ".length", last)
    for kind in kinds:
        assert sum(kind in name for name in outcome.deviation) == 6
    assert len(outcome.deviation) == 36
    assert np.mean(outcome.position) < 8.0


def test_the_matrix_brings_parameters_back(campaign: Any) -> None:
    """Millimetres off the drawing where the platform is rigid or bends leg by leg; tenths with the measured K."""
    size = {
        platform: np.sqrt(np.mean(_outcome(campaign, "spherical", platform).points ** 2))
        for platform in ("rigid", "linear", "matrix")
    }
    assert size["rigid"] > 1.5 and size["linear"] > 1.5
    assert size["matrix"] < 0.4 * size["rigid"]
    # u and kappa are one parameter: exchanging them changes nothing else
    assert size["linear"] == pytest.approx(size["rigid"], rel=0.02)


def test_what_can_be_told_is_the_truth() -> None:
    """A rigid platform on ball joints: the 36 parameters, with what those left out show through them, within noise."""
    with campaigns.measured(8, ring_stiffness=np.inf) as measured:
        outcome = fits.calibrated(measured, "spherical", "rigid")
        truth, drawn = measured.truth.parameters, simulator.nominal_machine().parameters
    found = outcome.estimate
    kept = list(found.subset.kept)
    expected = np.array([truth[name] - drawn[name] for name in kept])
    for left, shown in found.subset.relations.items():
        if left in truth:
            for name, share in shown.items():
                expected[kept.index(name)] += share * (truth[left] - drawn[left])
    free = [found.fit.prior.names[k] for k in found.fit.prior.free]
    error = np.array([outcome.deviation[name] - expected[kept.index(name)] for name in free])
    chi2 = error @ np.linalg.solve(found.fit.covariance, error)
    # chi2 of 36 degrees of freedom: 5 sigmas of it; the relations are first order
    assert chi2 < 36 + 5 * np.sqrt(72)


@pytest.mark.parametrize("model", MODELS)
def test_gaps_vanish_at_exact_poses_and_their_slopes_are_exact(tmp_path: Path, model: str) -> None:
    machine = machine_of(tmp_path, model, ("tolerance: {xyz: 0, rpy: 0}", "tolerance: {xyz: 1, rpy: 1}"))
    predictor = Predictor(machine, recording_of(tmp_path, machine, TRAVEL[:4]))
    poses, _ = predictor.poses(predictor.model.p_home)
    vectors = np.degrees(lie.log_so3(poses[:, :3, :3]))
    rows = np.hstack([TRAVEL[:4], poses[:, :3, 3], vectors])
    head = ",".join([*machine.mechanism.readings, "x", "y", "z", "rx", "ry", "rz"])
    (tmp_path / "exact.csv").write_text(
        head + "\n" + "\n".join(",".join(f"{v:.15g}" for v in r) for r in rows) + "\n"
    )
    gaps = ClosurePredictor(machine, load_recording(machine, [tmp_path / "exact.csv"]), whitened=False)
    p = gaps.model.p_home
    x, good = gaps.assemble(p)
    (block,) = gaps.blocks(p, x)
    assert good.all() and np.abs(block.residual).max() < 1e-6  # sigmas of 1.5 um
    rng = np.random.default_rng(2)
    scale = np.array([q.scale for q in machine.parameters])
    for _ in range(3):
        step = 1e-4 * scale * rng.standard_normal(len(p))
        ends = []
        for sign in (1, -1):
            shifted = p + sign * step
            (moved,) = gaps.blocks(shifted, gaps.assemble(shifted)[0])
            ends.append(moved.residual)
        change = block.jacobian @ (2 * step)
        assert np.allclose(ends[0] - ends[1], change, rtol=0, atol=1e-5 * np.abs(change).max())


def test_gaps_need_measured_poses(tmp_path: Path) -> None:
    machine = machine_of(tmp_path, "spherical", sensor="targets")
    with pytest.raises(InputError, match="found targets, expected one of type pose"):
        ClosurePredictor(machine, recording_of(tmp_path, machine, TRAVEL[:4]))


@pytest.mark.parametrize("model", MODELS[:3])
def test_gaps_and_readings_agree_on_the_poses(campaign: Any, model: str) -> None:
    """Weighted by the poses' noise, the gaps of the loops are the residuals of the readings to first order."""
    readings = _outcome(campaign, model, "matrix")
    gaps = fits.calibrated(campaign, model, "matrix", "whitened")
    difference = np.abs(readings.position - gaps.position)
    assert np.max(difference) < 1.5  # um, where the errors themselves are 2 to 8
