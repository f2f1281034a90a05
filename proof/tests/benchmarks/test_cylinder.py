"""Frames of a cylinder's points beside the rigid displacement (telescope paper, section 3.1). mm, rad."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from truepose.errors import InputError
from truepose.identification.leaves.photogrammetry.pose_table import body_pose
from truepose.models import lie

cylinder_frame = import_module("telescope.cylinder").cylinder_frame
Array = NDArray[np.float64]
SIGMA = 0.005


def motion(rng: np.random.Generator) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-300.0, 300.0, 3)
    return out


def moved(pose: Array, points: Array) -> Array:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def twist_error(found: Array, true: Array) -> Array:
    """[v; w] from the pose found to the true one: t + v, Exp(w) R."""
    return np.concatenate([true[:3, 3] - found[:3, 3], lie.log_so3(true[:3, :3] @ found[:3, :3].T)])


def cylinder(rng: np.random.Generator, n: int) -> Array:
    turn, height = rng.uniform(0, 2 * np.pi, n), np.sort(rng.uniform(-25, 25, n))
    return np.column_stack([np.cos(turn), np.sin(turn), height])


def test_a_cylinder_s_frame_moves_with_its_points() -> None:
    rng = np.random.default_rng(10)
    for _ in range(5):
        points, true = cylinder(rng, 12), motion(rng)
        frame = cylinder_frame(points, 1.0)
        assert np.max(np.abs(frame[:3, 2] - [0, 0, 1])) < 1e-6 and np.hypot(*frame[:2, 3]) < 1e-6
        side = points.mean(axis=0)[:2]
        assert frame[:2, 0] == pytest.approx(side / np.linalg.norm(side), abs=1e-5)
        # the fit stops at the square root of rounding
        assert np.max(np.abs(cylinder_frame(moved(true, points), 1.0) - true @ frame)) < 1e-5
    ring = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 10], [0, -1, 10], [1, 0, 20], [-1, 0, 20]])
    with pytest.raises(InputError, match="barycentre"):
        cylinder_frame(ring, 1.0)
    with pytest.raises(InputError, match="radius"):
        cylinder_frame(ring, 0.0)


def test_the_rigid_displacement_beats_frames_of_the_cylinder() -> None:
    """Telescope paper, Fig. 5: the axis, and the turn about it, are better known; 60 draws a number of points."""
    rng = np.random.default_rng(11)
    for n in (8, 16):
        errors = []
        for _ in range(60):
            x, true = cylinder(rng, n), motion(rng)
            y = moved(true, x) + SIGMA * rng.normal(size=x.shape)
            by_axis = cylinder_frame(y, 1.0) @ np.linalg.inv(cylinder_frame(x, 1.0))
            both = [
                twist_error(pose, true)[3:] @ true[:3, :3] for pose in (by_axis, body_pose(x, y, SIGMA).pose)
            ]
            errors.append([[np.hypot(*e[:2]), abs(e[2])] for e in both])
        axis, rigid = np.median(errors, axis=0)
        assert (rigid < 0.9 * axis).all()
