"""``poses``: from points measured on a body to its poses."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from truepose.commands.common import FileOption, JsonOption, check_file, finish, options, progress
from truepose.errors import InputError
from truepose.files import write_table

PointsArg = Annotated[
    Path,
    typer.Argument(metavar="POINTS", help="One row a placement: P1.x P1.y P1.z P2.x ... (CSV or Parquet)."),
]


@options(
    sigma="MM: 1-sigma of one coordinate as measured, mm.",
    body="FILE: The points in the body's frame: point, x, y, z. Without it the first row is the body.",
    covariance="--covariance: Add the covariances of every two columns, x.y.cov to ry.rz.cov.",
)
def poses(
    points: PointsArg,
    output: FileOption,
    sigma: float,
    body: Path | None = None,
    covariance: bool = False,
    as_json: JsonOption = False,
) -> None:
    """Poses of a body from points measured on it by photogrammetry or a tracker.

    Writes the columns of a pose sensor, x y z (mm) and rx ry rz (deg), each with <column>.std, then chi2_per_dof and
    suspects: points that hardly fit the rigid body. An empty coordinate is a point that was not seen.

    Example: truepose poses points.csv --sigma 0.005 --body body.csv -o recording.csv
    """
    from truepose.identification.leaves.photogrammetry.pose_table import pose_table, read_body, read_points

    check_file(output, points, body)
    if not 0.0 < sigma < float("inf"):
        raise InputError(f"--sigma: found {sigma:g}, expected a number > 0, mm")
    with progress("finding poses"):
        table = read_points(points)
        own = read_body(body) if body else None
        try:
            frame = pose_table(table, sigma, own, covariance=covariance)
        except InputError as exc:
            raise InputError(f"{points}: {exc}") from None
        write_table(output, frame)
    bent = {row: str(names) for row, names in enumerate(frame["suspects"], start=1) if names}
    fit = float(frame["chi2_per_dof"].median())
    summary = {
        "command": "poses",
        "rows": len(frame),
        "columns": [str(c) for c in frame.columns],
        "chi2_per_dof": fit,
        "suspects": {str(row): names.split() for row, names in bent.items()},
        "files": [str(output)],
    }
    notes = [f"row {row}: points that hardly fit the rigid body: {names}" for row, names in bent.items()]
    lines = [f"{output}: {len(frame)} rows, chi2 per degree of freedom {fit:.3g} (median)"]
    finish(summary, lines, notes, as_json=as_json)


COMMANDS = (poses,)
