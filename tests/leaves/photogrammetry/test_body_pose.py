"""Laws of the rigid displacement between two scatters of points, and of tables of such points. mm, rad."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2, kstest

from support.command import input_error
from truepose.arrays import Array
from truepose.identification.leaves.photogrammetry.pose_table import COLUMNS, PAIRS, body_pose, pose_table
from truepose.models import lie

SIGMA = 0.005
EXACT = 1e-9  # of coordinates of some hundred mm and turns: rounding times the points' spread


def scatter(rng: np.random.Generator, n: int = 7) -> Array:
    """Points of a body some way off the origin, so that turn and shift are correlated."""
    return np.asarray(rng.normal(size=(n, 3)) * [40.0, 25.0, 10.0] + [200.0, -50.0, 30.0])


def motion(rng: np.random.Generator) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-300.0, 300.0, 3)
    return out


def moved(pose: Array, points: Array) -> Array:
    return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def twist_error(found: Array, true: Array) -> Array:
    """[v; w] from the pose found to the true one: t + v, Exp(w) R."""
    return np.concatenate([true[:3, 3] - found[:3, 3], lie.log_so3(true[:3, :3] @ found[:3, :3].T)])


def pair(rng: np.random.Generator) -> tuple[Array, Array, float, float]:
    """Noisy scatters before and after, with the noise of each (after, before)."""
    x, pose, noise = scatter(rng), motion(rng), (SIGMA, 2 * SIGMA)
    before = x + noise[1] * rng.normal(size=x.shape)
    return before, moved(pose, x) + noise[0] * rng.normal(size=x.shape), *noise


@pytest.mark.parametrize("n", [3, 4, 30])
def test_without_noise_the_displacement_is_found_exactly(n: int) -> None:
    rng = np.random.default_rng(n)
    x, true = scatter(rng, n), motion(rng)
    found = body_pose(x, moved(true, x), SIGMA, 0.3 * SIGMA)
    assert np.max(np.abs(found.pose - true)) < EXACT
    assert found.chi2 < 1e-9 and found.suspects == ()


def test_points_in_one_plane_are_never_mirrored() -> None:
    rng = np.random.default_rng(0)
    x, true = scatter(rng, 5), motion(rng)
    x[:, 2] = 7.0
    found = body_pose(x, moved(true, x) + SIGMA * rng.normal(size=x.shape), SIGMA)
    assert np.linalg.det(found.pose[:3, :3]) > 0.999
    assert np.max(np.abs(twist_error(found.pose, true)) / found.std) < 5.0


def test_the_displacement_moves_with_either_scatter() -> None:
    rng = np.random.default_rng(3)
    x, y, cy, cx = pair(rng)
    found, a, b = body_pose(x, y, cy, cx), motion(rng), motion(rng)
    again = body_pose(moved(a, x), moved(b, y), cy, cx)
    want = b @ found.pose @ np.linalg.inv(a)
    assert np.max(np.abs(twist_error(again.pose, want)) / again.std) < 1e-5
    assert again.chi2 == pytest.approx(found.chi2, rel=1e-9)
    assert again.drops == pytest.approx(found.drops, rel=1e-5)


def test_swapping_the_scatters_inverts_the_displacement() -> None:
    rng = np.random.default_rng(4)
    x, y, cy, cx = pair(rng)
    found, back = body_pose(x, y, cy, cx), body_pose(y, x, cx, cy)
    assert np.max(np.abs(twist_error(back.pose, lie.inverse_pose(found.pose))) / back.std) < 1e-5
    assert back.chi2 == pytest.approx(found.chi2, rel=1e-9)
    # -R'(t + v) turned by Exp(-R' w): v' = -R'(v + t x w), w' = -R' w
    r, t = found.pose[:3, :3], found.pose[:3, 3]
    adjoint = np.block([[r.T, r.T @ np.cross(t, np.eye(3)).T], [np.zeros((3, 3)), r.T]])
    expected = adjoint @ found.covariance @ adjoint.T
    # the adjusted points, where the information is taken, agree; its inverse loses the condition's digits
    assert np.max(np.abs(back.covariance - expected)) < 1e-5 * np.max(np.abs(expected))


def test_covariance_and_chi2_are_calibrated() -> None:
    rng = np.random.default_rng(5)
    x, true = scatter(rng), motion(rng)
    pulls, fits, drops = [], [], []
    for _ in range(400):
        before = x + 2 * SIGMA * rng.normal(size=x.shape)
        found = body_pose(before, moved(true, x) + SIGMA * rng.normal(size=x.shape), SIGMA, 2 * SIGMA)
        e = twist_error(found.pose, true)
        pulls.append(float(e @ np.linalg.solve(found.covariance, e)))
        fits.append(found.chi2)
        drops.append(float(found.drops[0]))
    # a false alarm of one in a thousand each
    for values, dof in ((pulls, 6), (fits, 15), (drops, 3)):
        assert kstest(values, chi2(dof).cdf).pvalue > 1e-3


def test_what_chi2_falls_by_without_a_point_is_what_leaving_it_out_shows() -> None:
    rng = np.random.default_rng(6)
    x, y, cy, cx = pair(rng)
    found = body_pose(x, y, cy, cx)
    for k in range(len(x)):
        rest = np.delete(np.arange(len(x)), k)
        assert found.drops[k] == pytest.approx(
            found.chi2 - body_pose(x[rest], y[rest], cy, cx).chi2, rel=1e-3
        )


def test_a_point_that_moved_on_the_body_is_the_first_suspect() -> None:
    rng = np.random.default_rng(7)
    x, true = scatter(rng, 8), motion(rng)
    y = moved(true, x) + SIGMA * rng.normal(size=x.shape)
    assert body_pose(x, y, SIGMA).suspects == ()
    y[3] += [0.0, 20 * SIGMA, 0.0]
    found = body_pose(x, y, SIGMA)
    assert found.suspects[0] == 3 and chi2(found.dof).sf(found.chi2) < 1e-6


@pytest.mark.parametrize(
    ("points", "says"),
    [
        (np.array([[0.0, 0, 0], [1, 0, 0]]), "at least 3"),
        (np.outer([0.0, 1, 2, 5], [0.0, 0, 3]), "about (0.000, 0.000, 1.000)"),
        (
            np.outer([0.0, 100, 200], [3.0, 0, 4]) + np.array([[0, 0, 0], [0, 0.001, 0], [0, 0, 0]]),
            "(0.600, 0.000, 0.800)",
        ),
        (np.full((4, 3), 2.0), "no rotation is determined"),
        (np.zeros((4, 2)), "shape (4, 2)"),
        (np.array([[0.0, 0, 0], [1, 0, 0], [np.nan, 1, 0]]), "point 2"),
    ],
)
def test_scatters_that_determine_no_pose_are_refused(points: Array, says: str) -> None:
    turn = lie.exp_so3(np.array([0.3, 1.0, 2.0])) if points.shape[1] == 3 else np.eye(2)
    with input_error(says=says):
        body_pose(points, points @ turn.T, SIGMA)


@pytest.mark.parametrize(("sigma", "says"), [(0.0, "no noise"), (-1.0, ">= 0"), (np.nan, ">= 0")])
def test_noise_that_is_none_is_refused(sigma: float, says: str) -> None:
    x = scatter(np.random.default_rng(9), 5)
    with input_error(says=says):
        body_pose(x, x, sigma)
    with input_error("5 points before and 4 after"):
        body_pose(x, x[:4], SIGMA)


BODY = {"P1": (150.0, 0, 20), "P2": (-80.0, 130, 20), "P3": (-80.0, -130, 25), "P4": (10.0, 20, 80)}


def measured(rng: np.random.Generator, n: int) -> tuple[pd.DataFrame, list[Array]]:
    """A table of points in n placements with a joint's column, and the true poses."""
    poses = [motion(rng) for _ in range(n)]
    data: dict[str, list[float]] = {"rho1": [float(k) for k in range(n)]}
    for name, point in BODY.items():
        seen = np.array([moved(pose, np.array([point]))[0] for pose in poses]) + SIGMA * rng.normal(
            size=(n, 3)
        )
        data |= {f"{name}.{axis}": list(seen[:, k]) for k, axis in enumerate("xyz")}
    return pd.DataFrame(data), poses


def pulls(frame: pd.DataFrame, poses: list[Array]) -> Array:
    """(n, 6) errors of the table's columns over their stated 1-sigma; angles in deg."""
    true = np.array([np.r_[p[:3, 3], np.rad2deg(lie.log_so3(p[:3, :3]))] for p in poses])
    std = frame[[f"{c}.std" for c in COLUMNS]].to_numpy()
    return np.asarray((frame[list(COLUMNS)].to_numpy() - true) / std)


def test_a_table_of_points_becomes_poses_with_calibrated_columns() -> None:
    rng = np.random.default_rng(12)
    table, poses = measured(rng, 300)
    frame = pose_table(table, SIGMA, BODY)
    assert list(frame.columns[:7]) == ["rho1", *COLUMNS]
    assert frame["rho1"].equals(table["rho1"])
    # six columns, each standard normal in 300 rows: a false alarm of one in a thousand each
    assert all(kstest(column, "norm").pvalue > 1e-3 for column in pulls(frame, poses).T)
    assert float(frame["chi2_per_dof"].mean()) == pytest.approx(1.0, abs=5 * np.sqrt(2 / 6 / 300))


def test_covariances_of_the_columns_are_calibrated() -> None:
    table, poses = measured(np.random.default_rng(18), 300)
    frame = pose_table(table, SIGMA, BODY, covariance=True)
    spread = np.zeros((len(frame), 6, 6))
    for (a, b), (i, k) in zip(PAIRS, zip(*np.triu_indices(6, 1), strict=True), strict=True):
        spread[:, i, k] = spread[:, k, i] = frame[f"{a}.{b}.cov"]
    std = frame[[f"{c}.std" for c in COLUMNS]].to_numpy()
    spread[:, range(6), range(6)] = std**2
    errors = pulls(frame, poses) * std
    distance = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(spread), errors)
    assert kstest(distance, chi2(6).cdf).pvalue > 1e-3
    assert list(pose_table(table, SIGMA, BODY).columns) == [
        c for c in frame.columns if not c.endswith(".cov")
    ]


def test_a_point_that_was_not_seen_is_left_out_of_its_row() -> None:
    rng = np.random.default_rng(13)
    table, poses = measured(rng, 3)
    table.loc[1, "P2.y"] = np.nan
    frame = pose_table(table, SIGMA, BODY)
    assert np.max(np.abs(pulls(frame, poses))) < 5
    whole = pose_table(measured(np.random.default_rng(13), 3)[0], SIGMA, BODY)
    assert frame["x.std"].to_numpy()[1] > whole["x.std"].to_numpy()[1]
    table.loc[1, "P3.x"] = np.nan
    with input_error("row 2: points P1, P4: found 2 points"):
        pose_table(table, SIGMA, BODY)


def test_without_a_body_the_first_row_is_the_reference() -> None:
    table, poses = measured(np.random.default_rng(14), 4)
    frame = pose_table(table, SIGMA)
    assert np.max(np.abs(frame.loc[0, list(COLUMNS)].to_numpy(dtype=float))) < EXACT
    relative = [pose @ np.linalg.inv(poses[0]) for pose in poses]
    assert np.max(np.abs(pulls(frame[1:], relative[1:]))) < 5


def test_suspects_are_named() -> None:
    table, _ = measured(np.random.default_rng(16), 3)
    table["P4.z"] = table["P4.z"] + np.array([0.0, 0.0, 1.0])
    suspects = [str(text) for text in pose_table(table, SIGMA, BODY)["suspects"]]
    assert suspects[:2] == ["", ""] and suspects[2].split()[0] == "P4"


def test_the_displacement_agrees_with_scipy() -> None:
    rng = np.random.default_rng(1)
    x, true = scatter(rng, 9), motion(rng)
    y = moved(true, x) + SIGMA * rng.normal(size=x.shape)
    found = body_pose(x, y, SIGMA)
    middle_x, middle_y = x.mean(axis=0), y.mean(axis=0)
    turn, _ = Rotation.align_vectors(y - middle_y, x - middle_x)
    assert np.max(np.abs(found.pose[:3, :3] - turn.as_matrix())) < EXACT
    assert np.max(np.abs(found.pose[:3, 3] - (middle_y - turn.apply(middle_x)))) < EXACT * 100
