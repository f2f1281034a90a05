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
from support.checked_arm import JOINTS, Document, Spoilt, checked, columns, document, metres, recorded
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Check
from truepose.identification.leaves.check.run import check_files
from truepose.models.file.yaml_document import document_text

Spoil = Callable[[pd.DataFrame], Spoilt]


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def scaled(factor: float, *names: str, plus: float = 0.0) -> Spoil:
    """Columns times a factor, and shifted."""
    return lambda rows: columns(rows, lambda v: plus + factor * v, *names)


def turned(change: Callable[[Rotation], Rotation]) -> Spoil:
    """Rotation vectors, deg, of other turns."""

    def spoil(rows: pd.DataFrame) -> Spoilt:
        out = rows.copy()
        seen = Rotation.from_rotvec(rows[TURNS].to_numpy(), degrees=True)
        out[TURNS] = change(seen).as_rotvec(degrees=True)
        return document(), out

    return spoil


def table(change: Callable[[Document], Document]) -> Spoil:
    """Rows of the machine file's table typed otherwise."""

    def spoil(rows: pd.DataFrame) -> Spoilt:
        machine = document()
        mechanism = machine["mechanism"]
        mechanism["joints"] = [change(row) for row in mechanism["joints"]]
        return machine, rows

    return spoil


def inverse(rows: pd.DataFrame) -> Spoilt:
    back = Rotation.from_rotvec(rows[TURNS].to_numpy(), degrees=True).inv()
    out = rows.copy()
    out[XYZ] = -back.apply(rows[XYZ].to_numpy(copy=True))
    out[TURNS] = back.as_rotvec(degrees=True)
    return document(), out


def euler(rows: pd.DataFrame) -> Spoilt:
    seen = Rotation.from_rotvec(rows[TURNS].to_numpy(), degrees=True).as_euler("ZYZ", degrees=True)
    return document(), rows.assign(**dict(zip(TURNS, seen.T, strict=True)))


def typed_as_khalil(rows: pd.DataFrame) -> Spoilt:
    machine, _ = table(lambda row: {**row, "d": row["a"], "r": row["d"]})(rows)
    del machine["mechanism"]["convention"]
    for row in machine["mechanism"]["joints"]:
        del row["a"]
    return machine, rows


def frames(change: Callable[[Document], object]) -> Spoil:
    """Base and tool stated otherwise."""

    def spoil(rows: pd.DataFrame) -> Spoilt:
        machine = document()
        change(machine["frames"])
        return machine, rows

    return spoil


def swap(frames: Document) -> None:
    base, tool = frames["base"], frames["tool"]
    for part in ("xyz", "rpy"):
        base[part], tool[part] = tool[part], base[part]


def rows_of_the_table_exchanged(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    joints = machine["mechanism"]["joints"]
    joints[1], joints[2] = joints[2] | {"name": "q2"}, joints[1] | {"name": "q3"}
    return machine, rows


def stated_as_modified(rows: pd.DataFrame) -> Spoilt:
    machine = document()
    machine["mechanism"]["convention"] = "modified"
    return machine, rows


def si(rows: pd.DataFrame) -> Spoilt:
    return document(), metres(scaled(RAD, *JOINTS, *TURNS)(rows)[1])[1]


XYZ, TURNS, RAD = ["x", "y", "z"], ["rx", "ry", "rz"], np.pi / 180
SEEN = [*XYZ, *TURNS]
SLIPS: dict[str, tuple[Spoil, str, str, str]] = {
    "metres": (metres, "unit-length", "x", "readings in m"),
    "radians": (scaled(RAD, *JOINTS), "unit-angle", "q1", "joints in rad"),
    "gradians": (scaled(1 / 0.9, *JOINTS), "unit-angle", "q1", "joints in grad"),
    "si": (si, "unit-length", "q1", "the recording in m and rad"),
    "backwards": (scaled(-1.0, "q3"), "sign", "q3", "q3 counted the other way"),
    "all backwards": (scaled(-1.0, *JOINTS), "sign", "q6", "q1, q2, q3, q4, q5 and q6 counted the other way"),
    "turned and mirrored": (
        scaled(-1.0, "q4", plus=90.0), "sign", "q4", "q4 counted the other way, zero of q4 off by [+-]90 deg"
    ),
    "exchanged": (
        lambda rows: (document(), rows.rename(columns={"q4": "q5", "q5": "q4"})[list(rows.columns)]),
        "permutation", "q4", "q4 and q5 exchanged",
    ),
    "mirrored": (scaled(-1.0, "y"), "handedness", "y", "measured y with the other sign"),
    "inverse": (inverse, "inverse-pose", "x", "inverse"),
    "euler": (euler, "rotation-convention", "rx", "about z, y, z, moving axes"),
    "scalar first": (
        turned(lambda seen: Rotation.from_quat(seen.as_quat()[:, [3, 0, 1, 2]])),
        "rotation-convention", "rx", "was scalar first .* and read as scalar last",
    ),
    "quarter": (
        table(lambda row: row | ({"theta": 0.0} if row["name"] == "q2" else {})),
        "offset", "q2", "zero of q2 off by -90 deg",
    ),
    "never set": (scaled(1.0, "q4", plus=37.0), "offset", "q4", "zero of q4 off by -3[67]"),
    "horizon": (
        lambda rows: (document(), rows.assign(q3=rows["q3"] + rows["q2"])),
        "coupled", "q3", r"q3 is coupled: .* \+ q2 .*k = 1\)",
    ),
    "counts": (
        lambda rows: columns(rows, lambda v: (v * 8192 / 360).round(), "q5"),
        "counts", "q5", "q5 in counts of an encoder, 8192 a turn",
    ),
    "khalil": (
        typed_as_khalil, "dh-convention", "mechanism.joints", "standard table .* a typed as d and d typed as r"
    ),
    "modified": (stated_as_modified, "dh-convention", "mechanism.convention", "a standard table"),
    "table's rows": (
        rows_of_the_table_exchanged,
        "permutation", "mechanism.joints", "constants of q2 and q3 stand in each other's row",
    ),
    "alpha in rad": (
        table(lambda row: row | {"alpha": float(np.radians(row["alpha"]))}),
        "unit-angle", "mechanism.alpha", "alpha of the mechanism in rad",
    ),
    "file in m": (
        table(lambda row: row | {key: row[key] / 1000 for key in ("a", "d")}),
        "unit-length", "mechanism", "the mechanism's lengths in m",
    ),
    "swapped": (frames(swap), "frames-swapped", "frames.base", "exchanged"),
    "no base": (frames(lambda own: own.pop("base")), "base-missing", "frames.base", "left out"),
    "no tool": (frames(lambda own: own.pop("tool")), "tool-missing", "frames.tool", "left out"),
    "late": (
        lambda rows: (document(), rows.assign(**{n: rows[n].shift(1) for n in SEEN}).dropna()),
        "rows-shifted", "x", "readings 1 row too late",
    ),
    "in order": (
        lambda rows: (document(), pd.concat([rows[[*JOINTS]], rows[SEEN].sort_values("x", ignore_index=True)], axis=1)),
        "rows-shifted", "x", "rows sorted by x",
    ),
}  # fmt: skip


def mended_check(found: Check, folder: Path) -> Check:
    found.mended(Pair.read(folder / "arm.yaml", [folder / "r.csv"])).write(folder / "mended")
    return check_files(folder / "mended/arm.yaml", [folder / "mended/r.csv"])[0]


BY_DAY = {"metres", "backwards", "inverse", "never set", "swapped", "horizon", "counts"}


@pytest.mark.parametrize(
    "slip", [one if one in BY_DAY else pytest.param(one, marks=pytest.mark.nightly) for one in SLIPS]
)
def test_a_slip_is_named_and_the_mended_pair_is_right(slip: str, right: pd.DataFrame, tmp_path: Path) -> None:
    spoil, kind, where, says = SLIPS[slip]
    found = checked(tmp_path, *spoil(right))
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
    machine, spoilt = SLIPS["backwards"][0](rows)
    assert checked(tmp_path, machine, spoilt).found[0].kind == "sign"
    alone = checked(tmp_path, document(), rows)
    assert [(f.kind, f.verdict) for f in alone.found] == [("rows-stand-out", "suspect")]


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("first", "second"),
    [("metres", "backwards"), ("inverse", "backwards"), ("euler", "exchanged"), ("quarter", "exchanged"),
     ("mirrored", "backwards")],
)  # fmt: skip
def test_two_slips_at_once_are_told_for_what_they_are(
    first: str, second: str, right: pd.DataFrame, tmp_path: Path
) -> None:
    """Neither of which shows alone; the first may change the machine file."""
    machine, rows = SLIPS[first][0](right)
    found = checked(tmp_path, machine, SLIPS[second][0](rows)[1])
    assert {f.kind for f in found.found} == {SLIPS[first][1], SLIPS[second][1]}, found.found
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
