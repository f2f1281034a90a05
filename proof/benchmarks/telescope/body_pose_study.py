"""How well do points on a body tell its displacement? Fig. 5 of the telescope paper.

    python -m benchmarks.telescope.body_pose_study [REPEATS] [OUTDIR]

A scatter of 6 to 20 points on a cylinder (50 mm long, radius 1 mm) is displaced and measured with 5 um on each
coordinate. Three ways to find the displacement: the line of least squared distances, which leaves the rotation
about itself open (here it is told the truth); frames from the axis of a cylinder of known radius; and the weighted
rigid displacement of Haralick et al. Prints a table of mean and spread of the errors and draws OUTDIR/telescope_body_pose.svg.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from figures import Series, write_chart
from truepose.identification.leaves.photogrammetry.pose_table import body_pose

from .cylinder import cylinder_frame

Array = NDArray[np.float64]
LENGTH, RADIUS, SIGMA = 50.0, 1.0, 0.005  # mm
COUNTS = tuple(range(6, 21, 2))
FIGURES = Path(__file__).resolve().parents[3] / "docs" / "figures"
METHODS = ("line", "axis of the cylinder", "rigid displacement")
ERRORS = ("position (um)", "axis (urad)", "about the axis (mrad)")


@dataclass(frozen=True)
class Errors:
    """(repeats, methods, 3) errors of one number of points: see ``ERRORS``."""

    count: int
    values: Array


def scatter(count: int, rng: np.random.Generator) -> Array:
    """(count, 3) points on the cylinder around z, its middle the origin; the first at the lower end."""
    turn = rng.uniform(0.0, 2.0 * np.pi, count)
    height = np.sort(rng.uniform(-0.5 * LENGTH, 0.5 * LENGTH, count))
    return np.column_stack([RADIUS * np.cos(turn), RADIUS * np.sin(turn), height])


def displacement(rng: np.random.Generator) -> Array:
    """(4, 4) any rotation, some hundred mm."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.random(rng=rng).as_matrix(), rng.uniform(-300.0, 300.0, 3)
    return out


def line_frame(points: Array, across: Array) -> Array:
    """(4, 4) frame of the line of least squared distances: z along it, x as near to ``across`` as it can be.

    The line runs through the points' barycentre, so that the barycentre's projection on it gives no direction.
    """
    z = np.linalg.svd(points - points.mean(axis=0))[2][0]
    z = z * np.sign((points[-1] - points[0]) @ z)
    x = across - (across @ z) * z
    out = np.eye(4)
    out[:3, :3] = np.column_stack([x, np.cross(z, x), z]) / [np.linalg.norm(x), np.linalg.norm(x), 1.0]
    out[:3, 3] = points.mean(axis=0)
    return out


def by_line(before: Array, after: Array, true: Array) -> Array:
    """(4, 4) displacement by frames of lines, told the true direction of x."""
    across = np.array([1.0, 0.0, 0.0])
    return line_frame(after, true[:3, :3] @ across) @ np.linalg.inv(line_frame(before, across))


def errors_of(found: Array, true: Array) -> Array:
    """(3,) distance of the cylinder's middle, angle of its axis, angle about it: um, urad, mrad."""
    turn = found[:3, :3].T @ true[:3, :3]
    axis = np.arctan2(np.hypot(turn[0, 2], turn[1, 2]), turn[2, 2])
    about = np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])
    middle = np.linalg.norm(found[:3, 3] - true[:3, 3])
    return np.array([1e3 * middle, 1e6 * axis, 1e3 * abs(about)])


def study(repeats: int, seed: int = 5) -> list[Errors]:
    """Errors of both methods for every number of points."""
    out = []
    for count in COUNTS:
        rng = np.random.default_rng([seed, count])
        values = np.empty((repeats, len(METHODS), len(ERRORS)))
        for k in range(repeats):
            before, true = scatter(count, rng), displacement(rng)
            exact = before @ true[:3, :3].T + true[:3, 3]
            after = exact + SIGMA * rng.standard_normal(exact.shape)
            by_axis = cylinder_frame(after, RADIUS) @ np.linalg.inv(cylinder_frame(before, RADIUS))
            found = (by_line(before, after, true), by_axis, body_pose(before, after, SIGMA).pose)
            values[k] = [errors_of(pose, true) for pose in found]
        out.append(Errors(count, values))
    return out


def table(results: list[Errors]) -> str:
    """Markdown: mean +- standard deviation."""
    head = [f"{error}, {method}" for error in ERRORS for method in METHODS]
    told = head.index(f"{ERRORS[2]}, {METHODS[0]}")  # the truth was given
    rows = ["| points | " + " | ".join(head[:told] + head[told + 1 :]) + " |", "|---" * len(head) + "|"]
    for one in results:
        mean, spread = one.values.mean(axis=0).T.ravel(), one.values.std(axis=0).T.ravel()
        cells = [
            f"{m:.{2 if m < 10 else 0}f} +- {s:.{2 if s < 10 else 0}f}"
            for m, s in zip(mean, spread, strict=True)
        ]
        rows.append(f"| {one.count} | " + " | ".join(cells[:told] + cells[told + 1 :]) + " |")
    return "\n".join(rows) + "\n"


def draw(results: list[Errors], path: Path) -> None:
    """Angle of the axis against the number of points, as in Fig. 5."""
    series = [
        Series(
            method,
            [one.count + 0.15 * (k - 1) for one in results],
            [float(one.values[:, k, 1].mean()) for one in results],
            "both",
            [float(one.values[:, k, 1].std()) for one in results],
        )
        for k, method in enumerate(METHODS)
    ]
    title = "Direction of a 50 mm x 1 mm cylinder from points with 5 um"
    write_chart(path, title, "points on the body", "error of the axis, urad", series, log_y=True)


def main(repeats: int, folder: Path) -> None:
    """Run the study, print its table, draw its figure."""
    results = study(repeats)
    draw(results, folder / "telescope_body_pose.svg")
    sys.stdout.write(table(results))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 200, Path(sys.argv[2]) if len(sys.argv) > 2 else FIGURES)
