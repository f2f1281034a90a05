"""Graphs with loops: a planar 3-RRR, a delta robot and the hybrid, against closed forms written out in numpy."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import InputError
from truepose.identification.estimate import estimate
from truepose.identification.load import load_recording
from truepose.identification.prediction import Predictor
from truepose.identification.recording import Recording
from truepose.identification.simulate import parse_effect
from truepose.identification.write_machine import write_calibrated
from truepose.models import lie
from truepose.models.kinematics import SymbolicModel, symbolic_model
from truepose.models.load import load_machine
from truepose.models.loops import looped
from truepose.models.machine import Machine
from truepose.models.machine_file import write_machine
from truepose.models.yaml_document import read_document

Array = NDArray[np.float64]
Document = dict[str, Any]
MACHINES = Path(__file__).parent / "machines"
NAMES = ("planar", "delta", "hybrid")


@cache
def machine_of(name: str) -> Machine:
    return load_machine(MACHINES / f"{name}.yaml")


@cache
def model_of(name: str) -> SymbolicModel:
    return symbolic_model(machine_of(name))


def document_of(name: str) -> Document:
    return copy.deepcopy(dict(read_document(MACHINES / f"{name}.yaml")))


def written(folder: Path, document: Mapping[str, Any]) -> Machine:
    write_machine(folder / "machine.yaml", document)
    return load_machine(folder / "machine.yaml")


def recorded(folder: Path, machine: Machine, q: Array, **columns: Array) -> Recording:
    """Readings of joints (n, nq) in mm and rad, and the sensor's columns in mm and rad."""
    units = {name: unit for sensor in machine.sensors for name, unit in sensor.columns.items()}
    data = {f"{a.reading} [{a.unit}]": q[:, k] for k, a in enumerate(machine.mechanism.actuators)}
    data |= {f"{name} [{units[name]}]": values for name, values in columns.items()}
    pd.DataFrame(data).to_csv(folder / "rows.csv", index=False)
    return load_recording(machine, [folder / "rows.csv"], need_readings=bool(columns))


def spread(name: str, count: int, share: float = 0.7, seed: int = 1) -> Array:
    """(count, nq) readings around the middle of the ranges."""
    ranges = np.array([a.range for a in machine_of(name).mechanism.actuators])
    middle, half = ranges.mean(axis=1), np.diff(ranges)[:, 0] / 2
    draws = np.random.default_rng(seed).uniform(-1, 1, (count, len(middle)))
    return np.asarray(middle + share * half * draws)


def poses(machine: Machine, folder: Path, q: Array, p: Array | None = None) -> Array:
    """(n, 4, 4) poses of the tool in the world."""
    predictor = Predictor(machine, recorded(folder, machine, q))
    out, good = predictor.poses(predictor.model.p_home if p is None else p)
    assert good.all()
    return out


# -- closed forms ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Planar:
    """A 3-RRR in its plane: base pivots, cranks, rods and the platform's corners (mm)."""

    pivots: Array
    cranks: Array
    rods: Array
    corners: Array

    def platform(self, q: Array, side: Sequence[int]) -> tuple[Array, float]:
        """Position and angle of the platform: the corner of limb 3 must meet its circle.

        Corner 1 runs on its circle, corner 2 follows as the intersection of two circles, and the platform's angle
        is that at which corner 3 is as far from its elbow as its rod is long. ``side`` is the sign of corner 2
        beside the line from corner 1, and the number of the root for the angle of rod 1.
        """
        elbows = self.pivots + self.cranks[:, None] * np.column_stack([np.cos(q), np.sin(q)])
        shape = self.corners - self.corners[0]

        def corners(rod: float) -> Array:
            first = elbows[0] + self.rods[0] * np.array([np.cos(rod), np.sin(rod)])
            way = elbows[1] - first
            apart, reach = np.hypot(*way), np.hypot(*shape[1])
            cosine = (apart**2 + reach**2 - self.rods[1] ** 2) / (2 * apart * reach)
            if abs(cosine) > 1:
                return np.full((3, 2), np.nan)
            angle = (
                np.arctan2(way[1], way[0])
                + side[0] * np.arccos(cosine)
                - np.arctan2(shape[1, 1], shape[1, 0])
            )
            turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            return np.asarray(first + shape @ turn.T)

        def lack(rod: float) -> float:
            return float(np.linalg.norm(corners(rod)[2] - elbows[2]) - self.rods[2])

        found = corners(_roots(lack)[side[1]])
        one, two = found[1] - found[0], shape[1]
        angle = float(np.arctan2(two[0] * one[1] - two[1] * one[0], one @ two))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        return found[0] - turn @ self.corners[0], angle


def _roots(function: Callable[[float], float]) -> list[float]:
    """Zeros over a whole turn, by bisection between sign changes of a fine scan."""
    grid = np.linspace(-np.pi, np.pi, 721)
    values = np.array([function(float(t)) for t in grid])
    out = []
    for k in np.flatnonzero(values[:-1] * values[1:] < 0):
        low, high, sign = grid[k], grid[k + 1], np.sign(values[k])
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if np.sign(function(float(middle))) == sign else (low, middle)
        out.append(float((low + high) / 2))
    return out


PLANAR = Planar(
    np.array([[-141.0, -255.0], [291.0, 5.0], [-150.0, 250.0]]),
    np.array([100.0, 103.0, 98.0]),
    np.array([150.0, 147.0, 152.0]),
    np.array([[-130.0, -75.0], [130.0, -74.0], [1.0, 150.0]]),
)


def assemblies(planar: Planar, q: Array) -> list[tuple[Array, float]]:
    """All poses of the platform (six at most) at which the loops close."""
    found = []
    for sign in (1, -1):
        for root in range(8):
            try:
                found.append(planar.platform(q, (sign, root)))
            except IndexError:
                break
    return found


def near(planar: Planar, q: Array, wanted: tuple[Array, float]) -> tuple[Array, float]:
    """The assembly of the closed form that is nearest to a pose."""

    def away(pose: tuple[Array, float]) -> float:
        turn = (pose[1] - wanted[1] + np.pi) % (2 * np.pi) - np.pi
        return float(np.linalg.norm(pose[0] - wanted[0]) + 100 * abs(turn))

    return min(assemblies(planar, q), key=away)


def passive_angles(planar: Planar, q: Array, pose: tuple[Array, float]) -> dict[str, float]:
    """Passive joints of planar.yaml at an assembly, deg."""
    xy, angle = pose
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    elbows = planar.pivots + planar.cranks[:, None] * np.column_stack([np.cos(q), np.sin(q)])
    way = xy + planar.corners @ turn.T - elbows
    rods = np.arctan2(way[:, 1], way[:, 0])
    angles = {f"b{k + 1}": float(rods[k] - q[k]) for k in range(3)} | {"p1": float(angle - rods[0])}
    return {name: float(np.degrees(np.angle(np.exp(1j * value)))) for name, value in angles.items()}


def planar_pose(xy: Array, angle: float) -> Array:
    """Of the tool of planar.yaml, (4, 4)."""
    platform, tool = np.eye(4), np.eye(4)
    platform[:3, :3], platform[:2, 3] = Rotation.from_euler("z", angle).as_matrix(), xy
    tool[:3, :3], tool[:3, 3] = Rotation.from_euler("z", 20, degrees=True).as_matrix(), [10, 5, 30]
    out: Array = platform @ tool
    return out


def delta_position(q: Array, base: float, arms: Array, rods: Array, platform: float) -> Array:
    """(3,) platform of a delta robot: where three spheres about the elbows, moved inwards by its radius, meet."""
    azimuth = np.radians([0, 120, 240])
    out = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)])
    centre = out * (base - platform + arms * np.cos(q))[:, None] - np.outer(arms * np.sin(q), [0, 0, 1])
    one, two = centre[1] - centre[0], centre[2] - centre[0]
    right = [
        (rods[0] ** 2 - rods[k] ** 2 + centre[k] @ centre[k] - centre[0] @ centre[0]) / 2 for k in (1, 2)
    ]
    normal = np.cross(one, two)
    at = np.linalg.solve([one, two, normal], [*right, normal @ centre[0]])
    down = (
        -np.sqrt(rods[0] ** 2 - np.sum((at - centre[0]) ** 2)) * np.sign(normal[2]) / np.linalg.norm(normal)
    )
    return np.asarray(at + down * normal)


def delta(q: Array) -> Array:
    return delta_position(q, 200.0, np.full(3, 250.0), np.full(3, 550.0), 60.0)


def hybrid_inverse(up: Array) -> Array:
    """(3,) limb lengths of the hybrid whose passive limb stands at two angles and a length."""
    turn = Rotation.from_euler("XY", up[:2]).as_matrix()
    azimuth = np.radians([0, 120, 240])
    circle = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)])
    return np.asarray(
        np.linalg.norm((turn @ (165 * circle.T + [[0], [0], [up[2]]])).T - 340 * circle, axis=1)
    )


# -- forward kinematics ---------------------------------------------------------------------------------


def test_the_planar_loops_close_where_circles_meet(tmp_path: Path) -> None:
    q = spread("planar", 12)
    for row, pose in zip(q, poses(machine_of("planar"), tmp_path, q), strict=True):
        xy, angle = near(PLANAR, row, (pose[:2, 3], 0.0))
        np.testing.assert_allclose(pose, planar_pose(xy, angle), atol=1e-8)


def test_the_delta_stands_where_spheres_meet_and_never_turns(tmp_path: Path) -> None:
    q = spread("delta", 12)
    for row, pose in zip(q, poses(machine_of("delta"), tmp_path, q), strict=True):
        np.testing.assert_allclose(
            pose[:3, 3], delta(row) - [0, 0, 50], atol=1e-4
        )  # the file has 1e-6 of a circle
        np.testing.assert_allclose(pose[:3, :3], np.eye(3), atol=1e-7)


def test_the_hybrid_undoes_its_inverse(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    up = rng.uniform([-0.3, -0.3, 600], [0.3, 0.3, 800], (8, 3))
    wrist = rng.uniform(-1.2, 1.2, (8, 3))
    q = np.column_stack([[hybrid_inverse(row) for row in up], wrist])
    for row, turn, pose in zip(up, wrist, poses(machine_of("hybrid"), tmp_path, q), strict=True):
        limb = Rotation.from_euler("XY", row[:2]).as_matrix()
        hand = limb @ Rotation.from_euler("ZYX", turn).as_matrix()
        np.testing.assert_allclose(pose[:3, :3], hand, atol=1e-9)
        # the wrist centre is 127.5 beyond the platform, the tool 120 + 90 beyond that
        np.testing.assert_allclose(pose[:3, 3], limb @ [0, 0, row[2] + 127.5] + hand @ [0, 0, 210], atol=1e-8)


# -- home -----------------------------------------------------------------------------------------------


def with_home(folder: Path, name: str, **home: float) -> Machine:
    document = document_of(name)
    document["mechanism"]["home"] |= home
    return written(folder, document)


def test_home_picks_the_assembly(tmp_path: Path) -> None:
    """The loops close in two ways at these readings; a rough home, to 3 deg, means either of them."""
    q = model_of("planar").q_home
    found = assemblies(PLANAR, q)
    assert len(found) == 2
    assert abs(found[0][1] - found[1][1]) > 0.5
    rng = np.random.default_rng(21)
    for pose in found:
        home = passive_angles(PLANAR, q, pose)
        machine = with_home(tmp_path, "planar", **{k: v + rng.uniform(-3, 3) for k, v in home.items()})
        np.testing.assert_allclose(poses(machine, tmp_path, q[None])[0], planar_pose(*pose), atol=1e-8)


@pytest.mark.parametrize("off", [{"b1": 75.0, "b2": 110.0}, {"p1": -90.0, "b3": 60.0}])
def test_a_home_that_does_not_close_is_mended(tmp_path: Path, off: Mapping[str, float]) -> None:
    machine = with_home(tmp_path, "planar", **off)
    np.testing.assert_allclose(symbolic_model(machine).home, model_of("planar").home, atol=1e-9)
    q = spread("planar", 4)
    np.testing.assert_allclose(
        poses(machine, tmp_path, q), poses(machine_of("planar"), tmp_path, q), atol=1e-9
    )


def test_a_singular_home_is_left(tmp_path: Path) -> None:
    """All rods stretched along their cranks: no step of Newton's method leads away from there."""
    model = symbolic_model(with_home(tmp_path, "planar", b1=0, b2=0, b3=0, p1=0))
    gap, slope = _gap_at(model, model.home)
    assert np.max(np.abs(gap)) < 1e-9
    assert np.linalg.cond(slope[:, :] / np.linalg.norm(slope, axis=0)) < 1e4


def test_readings_out_of_reach_are_told(tmp_path: Path) -> None:
    document = document_of("planar")
    document["mechanism"]["joints"][0]["xyz"] = [-900, -150, 0]
    with pytest.raises(InputError, match=r"mechanism\.home: found no way to close the loops near it"):
        symbolic_model(written(tmp_path, document))


def _gap_at(model: SymbolicModel, x: Array) -> tuple[Array, Array]:
    inputs = [model.x, model.q, model.z, model.p]
    function = ca.Function("gap", inputs, [model.gap, ca.jacobian(model.gap, model.x)])
    gap, slope = function(x, model.q_home, model.z_home, model.p_home)
    return np.array(gap), np.array(slope)


# -- loops with more equations than unknowns ------------------------------------------------------------


def test_counts_of_equations() -> None:
    counts = {name: (len(model_of(name).home), model_of(name).gap.numel()) for name in NAMES}
    assert counts == {"planar": (4, 10), "delta": (15, 15), "hybrid": (9, 9)}
    for name in NAMES:
        assert model_of(name).closure.numel() == counts[name][0]
    assert model_of("planar").equations.numel() == 10


def strained() -> Array:
    """Parameters of the planar machine with pivots that are neither level nor parallel: no pose closes it."""
    p = model_of("planar").p_home.copy()
    at = {name: k for k, name in enumerate(model_of("planar").names)}
    for name, value in {
        "b1.rx": 1.5e-3,
        "p2.ry": -1e-3,
        "a3.z": 0.3,
        "mount3.z": -0.2,
        "b2.rx": 8e-4,
    }.items():
        p[at[name]] += value
    return p


def test_strained_loops_close_in_least_squares(tmp_path: Path) -> None:
    """No other values of the passive joints leave less of a gap; in the plane nothing moves to first order."""
    machine, p = machine_of("planar"), strained()
    q = spread("planar", 5)
    predictor = Predictor(machine, recorded(tmp_path, machine, q))
    x, good = predictor.assemble(p)
    assert good.all()
    model = predictor.model
    function = ca.Function("gap", [model.x, model.q, model.z, model.p], [model.gap, model.closure])
    rng = np.random.default_rng(7)
    for row, at in zip(q, x, strict=True):
        gap, closure = (np.array(v)[:, 0] for v in function(at, row, model.z_home, p))
        assert 0.1 < np.linalg.norm(gap) < 5
        assert np.max(np.abs(closure)) < 1e-8
        for step in 1e-4 * rng.standard_normal((20, 4)):
            more = np.array(function(at + step, row, model.z_home, p)[0])
            assert np.linalg.norm(more) > np.linalg.norm(gap)
    moved = predictor.poses(p)[0] - predictor.poses(model.p_home)[0]
    assert np.abs(moved[:, :2, 3]).max() < 0.05


@pytest.mark.parametrize("name", NAMES)
def test_total_derivatives_are_those_of_the_poses(tmp_path: Path, name: str) -> None:
    """By every parameter, loops re-closed at every step; the planar machine strained, where the gap counts too."""
    machine = machine_of(name)
    predictor = Predictor(machine, recorded(tmp_path, machine, spread(name, 3)))
    rng = np.random.default_rng(4)
    p = strained() if name == "planar" else predictor.model.p_home.copy()
    unit = np.array([1.0 if parameter.unit == "mm" else 1e-3 for parameter in machine.parameters])
    if name != "planar":
        p = p + 0.1 * unit * rng.standard_normal(len(p))
    x, _ = predictor.assemble(p)
    pose, exact = predictor.twists(p, x)
    still = np.swapaxes(pose[:, :3, :3], 1, 2)
    for k in range(len(p)):
        steps = []
        for size in (0.05, 0.1):
            ends = []
            for sign in (1, -1):
                e = np.zeros(len(p))
                e[k] = sign * size * unit[k]
                at = predictor.poses(p + e, predictor.assemble(p + e, x)[0])[0]
                turn = lie.log_so3(at[:, :3, :3] @ still)
                ends.append(np.hstack([at[:, :3, 3], turn]))
            steps.append((ends[0] - ends[1]) / (2 * size))
        differences = (4 * steps[0] - steps[1]) / 3  # fourth order
        # poses are closed to about 1e-10 mm: of steps of 0.1 that leaves 1e-9
        np.testing.assert_allclose(
            differences, exact[:, :, k] * unit[k], atol=2e-8, err_msg=machine.parameters[k].name
        )


# -- calibration ----------------------------------------------------------------------------------------


def test_a_planar_machine_is_calibrated(tmp_path: Path) -> None:
    """Readings of the closed form with other lengths: new poses follow within what the fit says it knows."""
    machine, rng = machine_of("planar"), np.random.default_rng(11)
    built = Planar(*(part + 0.2 * rng.standard_normal(part.shape) for part in vars(PLANAR).values()))
    zeros = np.radians(0.1) * rng.standard_normal(3)

    def seen(q: Array) -> Array:
        start = poses(machine, tmp_path, q)
        out = []
        for row, pose in zip(q, start, strict=True):
            angle = float(np.arctan2(pose[1, 0], pose[0, 0]) - np.radians(20))
            platform = pose[:2, 3] - Rotation.from_euler("z", angle).as_matrix()[:2, :2] @ [10, 5]
            out.append(planar_pose(*near(built, row + zeros, (platform, angle))))
        return np.array(out)

    q = spread("planar", 40, 0.9)
    exact = seen(q)
    xyz = exact[:, :3, 3] + 0.01 * rng.standard_normal((40, 3))
    turn = lie.log_so3(exact[:, :3, :3] @ lie.exp_so3(np.radians(0.005) * rng.standard_normal((40, 3))))
    columns = dict(zip(("x", "y", "z", "rx", "ry", "rz"), np.hstack([xyz, turn]).T, strict=True))
    fit = estimate(machine, recorded(tmp_path, machine, q, **columns))
    assert 0.75 < fit.chi2_per_dof < 1.25  # 2.5 sigma of 220 degrees of freedom
    fresh = spread("planar", 10, 0.8, seed=3)
    before, after, truth = (
        poses(machine, tmp_path, fresh),
        poses(machine, tmp_path, fresh, fit.p),
        seen(fresh),
    )
    off = [
        float(np.sqrt(np.mean(np.sum((found - truth)[:, :3, 3] ** 2, axis=1)))) for found in (before, after)
    ]
    assert off[0] > 0.2
    assert off[1] < 0.01  # the noise of one of 40 readings
    new = Predictor(machine, recorded(tmp_path, machine, fresh))
    slope = new.twists(fit.p, new.assemble(fit.p)[0])[1][:, :2, fit.prior.free].reshape(20, -1)
    std = np.sqrt(np.einsum("ij,jk,ik->i", slope, fit.covariance, slope))
    assert np.sqrt(np.mean(((after - truth)[:, :2, 3].ravel() / std) ** 2)) < 2


def test_a_delta_robot_is_calibrated(tmp_path: Path) -> None:
    """Both rods of a parallelogram off alike, as the closed form has them; 129 parameters share what is seen."""
    machine, rng = machine_of("delta"), np.random.default_rng(13)
    arms, rods = 250 + 0.2 * rng.standard_normal(3), 550 + 0.2 * rng.standard_normal(3)
    zeros = np.radians(0.1) * rng.standard_normal(3)

    def seen(q: Array) -> Array:
        return np.array([delta_position(row + zeros, 200.3, arms, rods, 59.9) - [0, 0, 50] for row in q])

    q = spread("delta", 60, 0.9)
    xyz = seen(q) + 0.02 * rng.standard_normal((60, 3))
    recording = recorded(tmp_path, machine, q, **dict(zip("xyz", xyz.T, strict=True)))
    fit = estimate(machine, recording)
    assert 0.7 < fit.chi2_per_dof < 1.3  # 2.7 sigma of 160 degrees of freedom
    fresh = spread("delta", 20, 0.8, seed=3)
    off = [
        float(
            np.sqrt(
                np.mean(np.sum((poses(machine, tmp_path, fresh, p)[:, :3, 3] - seen(fresh)) ** 2, axis=1))
            )
        )
        for p in (None, fit.p)
    ]
    assert off[0] > 0.3
    assert off[1] < 0.03
    new = Predictor(machine, recorded(tmp_path, machine, fresh))
    slope = new.twists(fit.p, new.assemble(fit.p)[0])[1][:, :3, fit.prior.free].reshape(60, -1)
    std = np.sqrt(np.einsum("ij,jk,ik->i", slope, fit.covariance, slope))
    assert np.sqrt(np.mean(((new.poses(fit.p)[0][:, :3, 3] - seen(fresh)).ravel() / std) ** 2)) < 2


# -- the file -------------------------------------------------------------------------------------------


def test_the_shorthand_is_its_graph(tmp_path: Path) -> None:
    short = machine_of("hybrid")
    document = document_of("hybrid") | {"mechanism": dict(short.mechanism.expanded or {})}
    document["frames"] = {
        "tool": {"in": "flange", "xyz": [0, 0, 210], "tolerance": {"xyz": 0.1, "rpy": 0.05}}
    }
    graph = written(tmp_path, document)
    assert graph.mechanism.parameters == short.mechanism.parameters
    assert graph.frames == short.frames
    for field in ("joints", "actuators", "limbs", "lengths", "flange", "platform"):
        assert getattr(graph.mechanism, field) == getattr(short.mechanism, field), field
    q = spread("hybrid", 3)
    np.testing.assert_array_equal(poses(graph, tmp_path, q), poses(short, tmp_path, q))


def test_a_calibrated_shorthand_is_a_graph_that_predicts_the_same(tmp_path: Path) -> None:
    machine, rng = machine_of("hybrid"), np.random.default_rng(17)
    names = [p.name for p in machine.parameters]
    truth = np.array([p.nominal + p.tolerance * rng.standard_normal() for p in machine.parameters])
    q = spread("hybrid", 40)
    exact = poses(machine, tmp_path, q, truth)
    xyz = exact[:, :3, 3] + 0.01 * rng.standard_normal((40, 3))
    turn = lie.log_so3(exact[:, :3, :3] @ lie.exp_so3(np.radians(0.003) * rng.standard_normal((40, 3))))
    columns = dict(zip(("x", "y", "z", "rx", "ry", "rz"), np.hstack([xyz, turn]).T, strict=True))
    recording = recorded(tmp_path, machine, q, **columns)
    fit = estimate(machine, recording)
    write_calibrated(tmp_path / "calibrated.yaml", fit, recording)
    again = load_machine(tmp_path / "calibrated.yaml")
    assert again.file is not None
    assert again.file.mechanism["type"] == "graph"
    assert [p.name for p in again.parameters] == names
    fresh = spread("hybrid", 6, seed=9)
    calibrated, fitted = poses(again, tmp_path, fresh), poses(machine, tmp_path, fresh, fit.p)
    np.testing.assert_allclose(calibrated, fitted, atol=1e-9)
    off = [
        np.linalg.norm((found - poses(machine, tmp_path, fresh, truth))[:, :3, 3])
        for found in (calibrated, poses(machine, tmp_path, fresh))
    ]
    assert off[0] < 0.1 * off[1]
    assert [limb.name for limb in again.mechanism.limbs] == ["leg1", "leg2", "leg3"]


def test_a_file_chooses_its_units(tmp_path: Path) -> None:
    document = document_of("planar")
    document["units"] = {"length": "m", "angle": "rad"}
    document["tolerances"] = {"length": 0.2e-3, "angle": float(np.radians(0.1))}
    mechanism = document["mechanism"]
    mechanism["home"] = {name: float(np.radians(value)) for name, value in mechanism["home"].items()}
    for joint in mechanism["joints"]:
        joint["xyz"] = [value / 1000 for value in joint["xyz"]]
        if "range" in joint:
            joint["range"] = [float(np.radians(value)) for value in joint["range"]]
    tool = document["frames"]["tool"]
    tool["xyz"], tool["rpy"] = [0.01, 0.005, 0.03], [0, 0, float(np.radians(20))]
    tool["tolerance"] = {"xyz": 0.5e-3, "rpy": float(np.radians(0.2))}
    document["sensor"]["sigma"] = {"xyz": 1e-5, "rot": float(np.radians(0.005))}
    for mass in document["masses"].values():
        mass["com"] = [value / 1000 for value in mass["com"]]
    metres = written(tmp_path, document)
    values = [(p.name, p.nominal, p.tolerance) for p in metres.parameters]
    usual = [(p.name, p.nominal, p.tolerance) for p in machine_of("planar").parameters]
    assert [v[0] for v in values] == [v[0] for v in usual]
    np.testing.assert_allclose([v[1:] for v in values], [v[1:] for v in usual], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(symbolic_model(metres).home, model_of("planar").home, atol=1e-9)


def test_sliding_homes_and_spherical_ones(tmp_path: Path) -> None:
    """Lengths in the file's unit; three angles of a ball joint as roll, pitch, yaw."""
    home = machine_of("hybrid").mechanism
    up3 = next(joint for joint in home.joints if joint.name == "up3")
    assert up3.home == pytest.approx((708.71,), rel=1e-4)  # half of the range, less what the limbs lean
    ball = next(joint for joint in machine_of("delta").mechanism.joints if joint.name == "s1a")
    expected = Rotation.from_euler("xyz", [-180, 43, -180], degrees=True).as_mrp()
    np.testing.assert_allclose(ball.home, expected, atol=1e-12)


def test_which_joints_stand_in_loops() -> None:
    planar, hybrid = machine_of("planar").mechanism, machine_of("hybrid").mechanism
    assert looped(planar) == {joint.name for joint in planar.joints}
    assert {joint.name for joint in hybrid.joints} - looped(hybrid) == {"q4", "q5", "q6"}
    assert looped(replace(hybrid, joints=hybrid.tree)) == set()


def joint(**fields: Any) -> Document:
    return {"name": "j", "kind": "revolute", "parent": "ground", "child": "arm", "actuated": True, **fields}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bodies": ["ground", "arm", "arm"]}, r"mechanism\.bodies: found 'arm' twice"),
        ({"bodies": []}, r"mechanism\.bodies: found none"),
        (
            {"bodies": ["ground", "arm", "base"]},
            r"mechanism\.bodies: found 'base' after 'ground', expected it first",
        ),
        (
            {"bodies": ["ground", "arm", "hand"]},
            r"mechanism\.joints: found no joints from 'ground' to body 'hand'",
        ),
        ({"joints": [joint(), joint()]}, r"mechanism\.joints: found 'j' twice"),
        (
            {"joints": [joint(child="arn")]},
            r"joints\[0\]\.child: found 'arn', expected a body; did you mean 'arm'",
        ),
        ({"joints": [joint(child="ground")]}, r"joints\[0\]: found 'j' between 'ground' and itself"),
        ({"joints": [joint(parent="arm", child="ground")]}, r"found no joints from 'ground' to body 'arm'"),
        (
            {"joints": [joint(kind="spherical")]},
            r"joints\[0\].*actuated: true on a revolute or prismatic joint only.*'spherical'",
        ),
        ({"joints": [joint(kind="screw")]}, r"joints\[0\]\.kind: expected 'revolute'"),
        ({"joints": [joint(axis=[0, 0, 0])]}, r"joints\[0\].*axis: a direction"),
        ({"joints": [joint(range=[3, -3])]}, r"joints\[0\].*range: \[low, high\] with low < high"),
        ({"joints": [joint(actuated=False)]}, r"mechanism\.joints: found no joint with `actuated: true`"),
        ({"joints": [joint(lenght=3)]}, r"joints\[0\]\.lenght: unknown field"),
        ({"home": {"k": 1}}, r"mechanism\.home: found joint 'k'"),
        ({"home": {"j": [1, 2, 3]}}, r"mechanism\.home\.j: found 3 numbers, expected 1 of a revolute joint"),
        ({"limbs": {"leg1": "k"}}, r"mechanism\.limbs\.leg1: found 'k', expected an actuated joint"),
        ({"flange": "hnad"}, r"mechanism\.flange: found 'hnad', expected a body"),
    ],
)
def test_graphs_that_make_no_sense_are_told(tmp_path: Path, change: Document, message: str) -> None:
    mechanism = {"type": "graph", "bodies": ["ground", "arm"], "joints": [joint()], **change}
    document = {"schema": "truepose/machine/1", "name": "m", "mechanism": mechanism}
    with pytest.raises(InputError, match=message):
        written(tmp_path, document)


def test_the_flange_is_the_body_that_the_file_names(tmp_path: Path) -> None:
    bodies = ["ground", "arm", "hand"]
    joints = [joint(), joint(name="k", parent="arm", child="hand", xyz=[100, 0, 0])]
    for more, flange in (({}, "hand"), ({"flange": "arm"}, "arm")):
        mechanism = {"type": "graph", "bodies": bodies, "joints": joints, **more}
        document = {"schema": "truepose/machine/1", "name": "m", "mechanism": mechanism}
        assert written(tmp_path, document).mechanism.flange == flange
    named = {
        "type": "graph",
        "bodies": ["ground", "flange", "hand"],
        "joints": [joint(child="flange"), {**joints[1], "parent": "flange"}],
    }
    document = {"schema": "truepose/machine/1", "name": "m", "mechanism": named}
    assert written(tmp_path, document).mechanism.flange == "flange"


def test_machines_of_the_documentation_are_machines(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "docs" / "graphs.md").read_text(encoding="utf-8")
    whole = [block for block in re.findall(r"```yaml\n(.*?)```", text, re.S) if block.startswith("schema:")]
    assert whole
    for block in whole:
        (tmp_path / "machine.yaml").write_text(block, encoding="utf-8")
        machine = load_machine(tmp_path / "machine.yaml")
        assert len(symbolic_model(machine).home) == len(machine.mechanism.passive)


@pytest.mark.parametrize(
    ("named", "place"),
    [
        ("actuator-scale@leg2:s=1e-3", "q2"),
        ("actuator-scale@q2:s=1e-3", "q2"),
        ("leg-compliance@q2:c=1e-3", "leg2"),
        ("thermal-expansion@q2:alpha=1e-5", "leg2"),
        ("joint-compliance@leg2:c=1e-3", "q2"),
    ],
)
def test_either_name_of_a_limb_is_understood(named: str, place: str) -> None:
    assert parse_effect(named, machine_of("hybrid")).place == (place,)
