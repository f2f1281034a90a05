"""Machines with loops are calibrated: readings of closed forms with other lengths, and the files of the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from support.graph_machines import machine_of, poses, recorded, spread
from support.loop_closed_forms import PLANAR, Planar, delta_position, near, planar_pose
from truepose.arrays import Array
from truepose.identification.fit.estimate import estimate
from truepose.identification.fit.write_machine import write_calibrated
from truepose.identification.prediction.predictor import Predictor
from truepose.models import lie
from truepose.models.load import load_machine


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
