"""The gate: one slip in a right pair is named, told from others, and mended."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import truepose
from support.checked_arm import (
    JOINTS,
    Document,
    Spoilt,
    checked,
    columns,
    document,
    metres,
    recorded,
)
from truepose.identification.check.pair import Pair
from truepose.identification.check.run import check_files
from truepose.models.yaml_document import document_text


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def radians(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, np.radians, *JOINTS)


def backwards(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: -v, "q3")


def exchanged(rows: pd.DataFrame) -> Spoilt:
    return document(), rows.rename(columns={"q4": "q5", "q5": "q4"})[list(rows.columns)]


def mirrored(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: -v, "y")


def inverse(rows: pd.DataFrame) -> Spoilt:
    back = Rotation.from_rotvec(rows[["rx", "ry", "rz"]].to_numpy(), degrees=True).inv()
    out = rows.copy()
    out[["x", "y", "z"]] = -back.apply(rows[["x", "y", "z"]].to_numpy(copy=True))
    out[["rx", "ry", "rz"]] = np.degrees(back.as_rotvec())
    return document(), out


def euler(rows: pd.DataFrame) -> Spoilt:
    out = rows.copy()
    seen = Rotation.from_rotvec(rows[["rx", "ry", "rz"]].to_numpy(), degrees=True)
    out[["rx", "ry", "rz"]] = seen.as_euler("ZYZ", degrees=True)
    return document(), out


def quarter(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    machine["mechanism"]["joints"][1]["theta"] = 0.0
    return machine, rows


def never_set(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: v + 37.0, "q4")


def typed_as_khalil(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    keep = ("name", "kind", "alpha", "theta")
    joints = [
        {**{key: row[key] for key in keep}, "d": row["a"], "r": row["d"]}
        for row in machine["mechanism"]["joints"]
    ]
    machine["mechanism"] = {"type": "serial", "joints": joints}
    return machine, rows


def alpha_in_radians(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    for row in machine["mechanism"]["joints"]:
        row["alpha"] = float(np.radians(row["alpha"]))
    return machine, rows


def file_in_metres(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    for row in machine["mechanism"]["joints"]:
        row["a"], row["d"] = row["a"] / 1000, row["d"] / 1000
    return machine, rows


def swapped(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    base, tool = machine["frames"]["base"], machine["frames"]["tool"]
    for part in ("xyz", "rpy"):
        base[part], tool[part] = tool[part], base[part]
    return machine, rows


def without_base(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    del machine["frames"]["base"]
    return machine, rows


def without_tool(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    del machine["frames"]["tool"]
    return machine, rows


def late(rows: pd.DataFrame) -> Spoilt:
    out = rows.copy()
    for name in ("x", "y", "z", "rx", "ry", "rz"):
        out[name] = out[name].shift(1)
    return document(), out.dropna()


def in_order(rows: pd.DataFrame) -> Spoilt:
    out = rows.copy()
    names = ["x", "y", "z", "rx", "ry", "rz"]
    out[names] = rows[names].sort_values("x").to_numpy()
    return document(), out


def two_setups(rows: pd.DataFrame) -> Spoilt:
    out = rows.copy()
    out.loc[25:, "x"] += 400.0
    return document(), out


SLIPS: list[tuple[Callable[[pd.DataFrame], Spoilt], str, str]] = [
    (metres, "unit-length", "x"),
    (radians, "unit-angle", "q1"),
    (backwards, "sign", "q3"),
    (exchanged, "permutation", "q4"),
    (mirrored, "handedness", "y"),
    (inverse, "inverse-pose", "x"),
    (euler, "rotation-convention", "rx"),
    (quarter, "offset", "q2"),
    (never_set, "offset", "q4"),
    (typed_as_khalil, "dh-convention", "mechanism.joints"),
    (alpha_in_radians, "unit-angle", "mechanism.alpha"),
    (file_in_metres, "unit-length", "mechanism"),
    (swapped, "frames-swapped", "frames.base"),
    (without_base, "base-missing", "frames.base"),
    (without_tool, "tool-missing", "frames.tool"),
    (late, "rows-shifted", "x"),
    (in_order, "rows-shifted", "x"),
    (two_setups, "sessions-mixed", "session"),
]


@pytest.mark.parametrize(("slip", "kind", "where"), SLIPS, ids=[s[0].__name__ for s in SLIPS])
def test_a_slip_is_named_and_the_mended_pair_is_right(
    slip: Callable[[pd.DataFrame], Spoilt], kind: str, where: str, right: pd.DataFrame, tmp_path: Path
) -> None:
    machine, rows = slip(right)
    found = checked(tmp_path, machine, rows)
    assert found.verdict == "wrong"
    assert (found.found[0].kind, where in found.found[0].where) == (kind, True)
    paths = tmp_path / "arm.yaml", tmp_path / "r.csv"
    if kind == "sessions-mixed":
        return  # where the base stood is not in the files: nothing mends it
    found.mended(Pair.read(paths[0], [paths[1]])).write(tmp_path / "mended")
    again = check_files(tmp_path / "mended/arm.yaml", [tmp_path / "mended/r.csv"])[0]
    assert again.verdict == "ok", again.found
    assert again.left is not None and again.left < 3.0  # tolerances of 0.2 mm and 0.05 deg over 1.2 m


def test_a_header_that_says_the_wrong_unit(right: pd.DataFrame, tmp_path: Path) -> None:
    """Numbers in the file's own unit under a header that says another: the header is what is wrong."""
    said = {"q4": "q4 [rad]", "q5": "q5 [rad]", "x": "x [m]", "y": "y [m]", "z": "z [m]"}
    found = checked(tmp_path, document(), right.rename(columns=said))
    named = {(f.kind, f.where) for f in found.found}
    assert named == {("unit-length", ("x", "y", "z")), ("unit-angle", ("q4", "q5"))}
    found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/arm.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"


def grown(machine: Document, factor: float) -> Document:
    """The same machine with every length of its file times ``factor``."""
    for joint in machine["mechanism"]["joints"]:
        joint |= {key: factor * joint[key] for key in ("a", "d")}
    for frame in machine["frames"].values():
        frame["xyz"] = [factor * v for v in frame["xyz"]]
        frame["tolerance"]["xyz"] *= factor
    machine["tolerances"]["length"] *= factor
    return machine


def test_of_two_scales_that_fit_alike_the_machine_of_a_usual_size(
    right: pd.DataFrame, tmp_path: Path
) -> None:
    """Points show no scale: readings in m and a file in um are one misfit, a file in m and readings in um another."""
    sensor = {"type": "position", "sigma": {"xyz": 0.03}}
    machine, rows = document(sensor=sensor), right[[*JOINTS, "x", "y", "z"]]
    small = rows.assign(**{axis: rows[axis] / 1000 for axis in "xyz"})
    assert checked(tmp_path, machine, small).found[0].says == "readings in m"
    assert checked(tmp_path, grown(machine, 0.001), rows).found[0].says == "the machine file's lengths in m"


def test_gross_readings_hide_no_slip(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right.copy()
    rows.loc[[4, 30, 41], "z"] += 5000.0
    machine, spoilt = backwards(rows)
    assert checked(tmp_path, machine, spoilt).found[0].kind == "sign"
    assert checked(tmp_path, document(), rows).verdict == "ok"


def test_one_slip_behind_another(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = metres(right)
    rows["q3"] = -rows["q3"]
    kinds = {f.kind for f in checked(tmp_path, machine, rows).found}
    assert kinds == {"unit-length", "sign"}


@pytest.mark.parametrize(
    "both", [(inverse, backwards), (euler, exchanged)], ids=["inverse, sign", "angles, order"]
)
def test_two_slips_neither_of_which_shows_alone(
    both: tuple[Callable[[pd.DataFrame], Spoilt], ...], right: pd.DataFrame, tmp_path: Path
) -> None:
    machine, rows = both[1](both[0](right)[1])
    found = checked(tmp_path, machine, rows)
    wanted = {kind for slip, kind, _ in SLIPS if slip in both}
    assert {f.kind for f in found.found} == wanted
    found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/arm.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"


def test_the_same_answer_every_time_and_in_every_order_of_rows(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = exchanged(right)
    first = checked(tmp_path, machine, rows).document()
    assert checked(tmp_path, machine, rows).document() == first
    other = checked(tmp_path, machine, rows.sample(frac=1.0, random_state=1)).document()
    assert [(f["kind"], f["where"]) for f in other["found"]] == [
        (f["kind"], f["where"]) for f in first["found"]
    ]


def test_targets_whose_exchange_is_a_turn_of_the_tool(right: pd.DataFrame, tmp_path: Path) -> None:
    """Two of three targets of an isosceles triangle: readings alone are as well explained by a tool that was turned over."""
    points = {"P1": [0.0, 30.0, 0.0], "P2": [0.0, -30.0, 0.0], "P3": [80.0, 0.0, 0.0]}
    sensor = {"type": "targets", "points": points, "sigma": {"xyz": 0.03}}
    (tmp_path / "right.yaml").write_text(document_text(document(sensor=sensor)), encoding="utf-8")
    poses = right[list(JOINTS)]
    seen = truepose.simulate(truepose.load_machine(tmp_path / "right.yaml"), poses, seed=1)
    rows = pd.concat([poses, seen.reset_index(drop=True)], axis=1)
    axes = {f"P{a}.{axis}": f"P{b}.{axis}" for a, b in ((1, 2), (2, 1)) for axis in "xyz"}
    found = checked(tmp_path, document(sensor=sensor), rows.rename(columns=axes))
    assert [(f.kind, f.where) for f in found.found] == [("permutation", ("P1", "P2"))]
