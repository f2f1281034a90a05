"""Graphs with loops against closed forms: where they stand, which assembly is meant, what does not close."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from support.graph_machines import document_of, machine_of, model_of, poses, recorded, spread, written
from support.loop_closed_forms import (
    PLANAR,
    assemblies,
    delta,
    hybrid_inverse,
    near,
    passive_angles,
    planar_pose,
)
from truepose.errors import InputError
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.machine.kinematics import SymbolicModel, symbolic_model
from truepose.models.machine.machine import Machine

Array = NDArray[np.float64]
NAMES = ("planar", "delta", "hybrid")


# -- forward kinematics --------------------------------------------------------------------------------


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


# -- home ----------------------------------------------------------------------------------------------


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


# -- loops with more equations than unknowns -----------------------------------------------------------


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
