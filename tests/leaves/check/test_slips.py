"""The gate: one slip in a right pair is named, told from others, and mended."""

from __future__ import annotations

import re
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
from support.examples import by_day
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check
from truepose.identification.leaves.check.run import check_files
from truepose.models.file.yaml_document import document_text


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def radians(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, np.radians, *JOINTS)


def backwards(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: -v, "q3")


def all_backwards(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: -v, *JOINTS)


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


def si(rows: pd.DataFrame) -> Spoilt:
    return document(), radians(metres(rows)[1])[1].assign(
        **{n: np.radians(rows[n]) for n in ("rx", "ry", "rz")}
    )


def gradians(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: v / 0.9, *JOINTS)


def scalar_first(rows: pd.DataFrame) -> Spoilt:
    """Quaternions w, x, y, z that were read as x, y, z, w."""
    out = rows.copy()
    names = ["rx", "ry", "rz"]
    xyzw = Rotation.from_rotvec(rows[names].to_numpy(), degrees=True).as_quat()
    out[names] = Rotation.from_quat(xyzw[:, [3, 0, 1, 2]]).as_rotvec(degrees=True)
    return document(), out


def stated_as_modified(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    machine["mechanism"]["convention"] = "modified"
    return machine, rows


def rows_of_the_table_exchanged(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    joints = machine["mechanism"]["joints"]
    joints[1], joints[2] = joints[2] | {"name": "q2"}, joints[1] | {"name": "q3"}
    return machine, rows


def horizon(rows: pd.DataFrame) -> Spoilt:
    """The third joint counted from the horizon: with the second one's angle."""
    return document(), rows.assign(q3=rows["q3"] + rows["q2"])


def in_counts(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: (v * 8192 / 360).round(), "q5")


def turned_and_mirrored(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: 90.0 - v, "q4")


SLIPS: list[tuple[Callable[[pd.DataFrame], Spoilt], str, str, str]] = [
    (metres, "unit-length", "x", "readings in m"),
    (radians, "unit-angle", "q1", "joints in rad"),
    (gradians, "unit-angle", "q1", "joints in grad"),
    (si, "unit-length", "q1", "the recording in m and rad"),
    (backwards, "sign", "q3", "q3 counted the other way"),
    (all_backwards, "sign", "q6", "q1, q2, q3, q4, q5 and q6 counted the other way"),
    (turned_and_mirrored, "sign", "q4", "q4 counted the other way, zero of q4 off by [+-]90 deg"),
    (exchanged, "permutation", "q4", "q4 and q5 exchanged"),
    (mirrored, "handedness", "y", "measured y with the other sign"),
    (inverse, "inverse-pose", "x", "inverse"),
    (euler, "rotation-convention", "rx", "about z, y, z, moving axes"),
    (scalar_first, "rotation-convention", "rx", "was scalar first .* and read as scalar last"),
    (quarter, "offset", "q2", "zero of q2 off by -90 deg"),
    (never_set, "offset", "q4", "zero of q4 off by -3[67]"),
    (horizon, "coupled", "q3", r"q3 is coupled: .* \+ q2 .*k = 1\)"),
    (in_counts, "counts", "q5", "q5 in counts of an encoder, 8192 a turn"),
    (typed_as_khalil, "dh-convention", "mechanism.joints", "standard table .* a typed as d and d typed as r"),
    (stated_as_modified, "dh-convention", "mechanism.convention", "a standard table"),
    (rows_of_the_table_exchanged, "permutation", "mechanism.joints", "constants of q2 and q3 stand in each other's row"),
    (alpha_in_radians, "unit-angle", "mechanism.alpha", "alpha of the mechanism in rad"),
    (file_in_metres, "unit-length", "mechanism", "the mechanism's lengths in m"),
    (swapped, "frames-swapped", "frames.base", "exchanged"),
    (without_base, "base-missing", "frames.base", "left out"),
    (without_tool, "tool-missing", "frames.tool", "left out"),
    (late, "rows-shifted", "x", "readings 1 row too late"),
    (in_order, "rows-shifted", "x", "rows sorted by x"),
]  # fmt: skip


def mended_check(found: Check, folder: Path) -> Check:
    found.mended(Pair.read(folder / "arm.yaml", [folder / "r.csv"])).write(folder / "mended")
    return check_files(folder / "mended/arm.yaml", [folder / "mended/r.csv"])[0]


BY_DAY = {metres, backwards, inverse, never_set, swapped}


@pytest.mark.parametrize(
    ("slip", "kind", "where", "says"),
    by_day(SLIPS, *(case for case in SLIPS if case[0] in BY_DAY)),
    ids=[s[0].__name__ for s in SLIPS],
)
def test_a_slip_is_named_and_the_mended_pair_is_right(
    slip: Callable[[pd.DataFrame], Spoilt],
    kind: str,
    where: str,
    says: str,
    right: pd.DataFrame,
    tmp_path: Path,
) -> None:
    found = checked(tmp_path, *slip(right))
    first = found.found[0]
    assert (first.verdict, first.kind, where in first.where) == ("wrong", kind, True), found.found
    assert re.search(says, first.says), first.says
    assert [f for f in found.found if f.verdict == "wrong"] == [first]
    again = mended_check(found, tmp_path)
    assert again.verdict == "ok", again.found
    assert again.left is not None and again.left < 3.0  # tolerances of 0.2 mm and 0.05 deg over 1.2 m


@pytest.mark.nightly
def test_tolerances_that_allow_for_anything_prove_nothing(right: pd.DataFrame, tmp_path: Path) -> None:
    """Degrees under ``angle: rad``: half a radian takes up whatever is left, and the unit is named all the same."""
    machine = document(units={"angle": "rad"})
    machine["tolerances"]["angle"] = 0.5
    found = checked(tmp_path, machine, right)
    assert found.verdict == "wrong" and found.found[0].where == ("units.angle",), found.found


def test_a_header_that_says_the_wrong_unit(right: pd.DataFrame, tmp_path: Path) -> None:
    """Numbers in the file's own unit under a header that says another: the header is what is wrong."""
    said = {"q4": "q4 [rad]", "q5": "q5 [rad]", "x": "x [m]", "y": "y [m]", "z": "z [m]"}
    found = checked(tmp_path, document(), right.rename(columns=said))
    assert {name for f in found.found for name in f.where} == {"q4", "q5", "x", "y", "z"}
    assert {f.kind for f in found.found} <= {"unit-length", "unit-angle"}
    assert mended_check(found, tmp_path).verdict == "ok"


def grown(machine: Document, factor: float) -> Document:
    """The same machine with every length of its file times ``factor``."""
    for joint in machine["mechanism"]["joints"]:
        joint |= {key: factor * joint[key] for key in ("a", "d")}
    for frame in machine["frames"].values():
        frame["xyz"] = [factor * v for v in frame["xyz"]]
        frame["tolerance"]["xyz"] *= factor
    machine["tolerances"]["length"] *= factor
    return machine


@pytest.mark.nightly
def test_of_two_scales_that_fit_alike_the_machine_of_a_usual_size(
    right: pd.DataFrame, tmp_path: Path
) -> None:
    """Points show no scale: readings in m and a file in um are one misfit, a file in m and readings in um another."""
    sensor = {"type": "position", "sigma": {"xyz": 0.03}}
    machine, rows = document(sensor=sensor), right[[*JOINTS, "x", "y", "z"]]
    small = rows.assign(**{axis: rows[axis] / 1000 for axis in "xyz"})
    assert checked(tmp_path, machine, small).found[0].says == "readings in m"
    assert checked(tmp_path, grown(machine, 0.001), rows).found[0].says == "the machine file's lengths in m"


@pytest.mark.nightly
def test_gross_readings_hide_no_slip(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right.copy()
    rows.loc[[4, 30, 41], "z"] += 5000.0
    machine, spoilt = backwards(rows)
    assert checked(tmp_path, machine, spoilt).found[0].kind == "sign"
    alone = checked(tmp_path, document(), rows)
    assert [(f.kind, f.verdict) for f in alone.found] == [("rows-stand-out", "suspect")]


@pytest.mark.nightly
@pytest.mark.parametrize(
    "both",
    [
        (metres, backwards),
        (inverse, backwards),
        (euler, exchanged),
        (quarter, exchanged),
        (mirrored, backwards),
    ],
    ids=lambda both: " and ".join(slip.__name__ for slip in both),
)
def test_two_slips_at_once_are_told_for_what_they_are(
    both: tuple[Callable[[pd.DataFrame], Spoilt], ...], right: pd.DataFrame, tmp_path: Path
) -> None:
    """Neither of which shows alone; the first may change the machine file."""
    machine, rows = both[0](right)
    found = checked(tmp_path, machine, both[1](rows)[1])
    wanted = {kind for slip, kind, *_ in SLIPS if slip in both}
    assert {f.kind for f in found.found} == wanted, found.found
    assert mended_check(found, tmp_path).verdict == "ok"


@pytest.mark.nightly
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
