"""``truepose poses``: from a file of measured points to the columns of a pose sensor, and what it refuses. mm, deg."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from support.command import refused, run
from truepose.identification.leaves.photogrammetry.pose_table import COLUMNS, pose_table

SIGMA = 0.005
BODY = {"P1": (150.0, 0, 20), "P2": (-80.0, 130, 20), "P3": (-80.0, -130, 25), "P4": (10.0, 20, 80)}


def points(n: int = 6) -> pd.DataFrame:
    """Placements of the body with a joint's column and a label, as measured."""
    rng = np.random.default_rng(5)
    out: dict[str, Any] = {"q1": [f"{k}.50" for k in range(n)], "who": [f"shot {k}" for k in range(n)]}
    turns, shifts = Rotation.random(n, rng=rng), rng.uniform(-300, 300, (n, 3))
    for name, point in BODY.items():
        seen = turns.apply(point) + shifts + SIGMA * rng.normal(size=(n, 3))
        out |= {f"{name}.{axis}": seen[:, k] for k, axis in enumerate("xyz")}
    return pd.DataFrame(out)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """points.csv and body.csv in a folder."""
    points().to_csv(tmp_path / "points.csv", index=False)
    body = pd.DataFrame(BODY, index=list("xyz")).T.rename_axis("point")
    body.to_csv(tmp_path / "body.csv")
    return tmp_path


def test_poses_are_those_of_the_library_beside_the_other_columns(files: Path) -> None:
    done = run(
        "poses", files / "points.csv", "--sigma", SIGMA, "--body", files / "body.csv", "-o", files / "out.csv"
    )
    assert done.stderr == ""
    found = pd.read_csv(files / "out.csv", dtype={"q1": str}, keep_default_na=False)
    expected = pose_table(points(), SIGMA, BODY)
    assert list(found["q1"]) == list(points()["q1"]) and list(found["who"]) == list(points()["who"])
    assert list(found.columns) == list(expected.columns)
    numbers = [c for c in expected.columns if c not in ("q1", "who", "suspects")]
    np.testing.assert_allclose(found[numbers].to_numpy(float), expected[numbers].to_numpy(float), rtol=1e-12)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_units_of_columns_and_kinds_of_files_change_nothing(suffix: str, files: Path) -> None:
    frame = points()
    frame["P2.y [um]"] = 1e3 * frame.pop("P2.y")
    frame = frame.rename(columns={"who": "who [1]"})
    if suffix == "csv":
        frame.to_csv(files / "other.csv", index=False)
    else:
        frame.to_parquet(files / "other.parquet")
    for name, source in (("one", "points.csv"), ("two", f"other.{suffix}")):
        words = ("--sigma", SIGMA, "--body", files / "body.csv", "--covariance")
        run("poses", files / source, *words, "-o", files / f"{name}.{suffix}")
    read = pd.read_csv if suffix == "csv" else pd.read_parquet
    one, two = (read(files / f"{name}.{suffix}") for name in ("one", "two"))
    numbers = [c for c in one.columns if c.split(".")[0] in COLUMNS]
    assert len(numbers) == 6 + 6 + 15 and "who [1]" in two
    np.testing.assert_allclose(
        two[numbers].to_numpy(float), one[numbers].to_numpy(float), rtol=1e-9, atol=1e-12
    )


def test_a_point_may_be_unseen_and_one_that_moved_is_named(files: Path) -> None:
    frame = points()
    frame.loc[1, "P3.x"] = np.nan
    frame["P4.z"] += np.where(frame.index == 4, 1.0, 0.0)
    frame.to_csv(files / "points.csv", index=False)
    words = (files / "points.csv", "--sigma", SIGMA, "--body", files / "body.csv", "-o", files / "out.csv")
    told = run("poses", *words)
    assert "row 5: points that hardly fit the rigid body: P4" in told.stderr
    summary = json.loads(run("poses", *words, "--json").stdout)
    assert summary["rows"] == 6 and list(summary["suspects"]) == ["5"] and summary["suspects"]["5"][0] == "P4"
    std = pd.read_csv(files / "out.csv")["x.std"]
    assert std[1] > std.drop(1).max()


def _edited(name: str, change: Callable[[pd.DataFrame], pd.DataFrame]) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        change(pd.read_csv(folder / name, dtype=str)).to_csv(folder / name, index=False)

    return edit


def _cell(name: str, column: str, value: str) -> Callable[[Path], None]:
    def change(frame: pd.DataFrame) -> pd.DataFrame:
        frame.loc[2, column] = value
        return frame

    return _edited(name, change)


BAD: dict[str, tuple[Callable[[Path], None], str]] = {
    "text": (_cell("points.csv", "P2.y", "high"), r"points.csv: row 3 (line 4), column 'P2.y'"),
    "infinity": (_cell("points.csv", "P2.y", "inf"), r"points.csv: row 3 (line 4), column 'P2.y'"),
    "no column": (_edited("points.csv", lambda f: f.drop(columns="P2.z")), "points.csv: missing column 'P2.z'"),
    "two points": (
        _edited("points.csv", lambda f: f.assign(**{"P1.x": None, "P2.x": None})),
        "points.csv: row 1: points P3, P4: found 2 points",
    ),
    "a wrong unit": (_edited("points.csv", lambda f: f.rename(columns={"P1.x": "P1.x [s]"})), "points.csv: column 'P1.x'"),
    "no body point": (_cell("body.csv", "point", "P9"), "missing column 'P9.x'"),
    "a body point twice": (_cell("body.csv", "point", "P1"), "body.csv: row 3 (line 4), column 'point': found 'P1' again"),
    "no axis": (_edited("body.csv", lambda f: f.rename(columns={"x": "X"})), "body.csv: missing column 'x'"),
    "no coordinate": (_cell("body.csv", "y", ""), "body.csv: row 3 (line 4), column 'y'"),
    "no file": (lambda folder: (folder / "body.csv").unlink(), "body.csv: cannot read the file"),
    "no row": (_edited("points.csv", lambda f: f.iloc[:0]), "points.csv"),
    "no sigma": (lambda folder: None, "--sigma: found inf, expected a number > 0, mm"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_files_are_one_line_and_leave_nothing(case: str, files: Path) -> None:
    edit, says = BAD[case]
    edit(files)
    sigma = "inf" if case == "no sigma" else SIGMA
    words = (files / "points.csv", "--sigma", sigma, "--body", files / "body.csv", "-o", files / "out.csv")
    refused("poses", *words, said=says)
    assert not (files / "out.csv").exists()
