"""The gate: one slip in a right pair is named, told from others, and mended; a right pair is left in peace."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import truepose
from truepose.cli import app
from truepose.identification.check.pair import Pair, Sheet
from truepose.identification.check.result import Check
from truepose.identification.check.run import check_files
from truepose.identification.recording.load import tables
from truepose.models.urdf_lengths import rescaled
from truepose.models.yaml_document import document_text

MACHINES = Path(truepose.__path__[0]) / "models/machines"
JOINTS = tuple(f"q{k}" for k in range(1, 7))
ARM: dict[str, Any] = {
    "schema": "truepose/machine/1",
    "name": "arm",
    "gravity": [0.0, 0.0, -9.80665],
    "mechanism": {
        "type": "serial",
        "convention": "standard",
        "joints": [
            {"name": "q1", "kind": "revolute", "a": 30.0, "alpha": -90.0, "d": 380.0, "theta": 0.0},
            {"name": "q2", "kind": "revolute", "a": 440.0, "alpha": 0.0, "d": 0.0, "theta": -90.0},
            {"name": "q3", "kind": "revolute", "a": 35.0, "alpha": -90.0, "d": 0.0, "theta": 0.0},
            {"name": "q4", "kind": "revolute", "a": 0.0, "alpha": 90.0, "d": 420.0, "theta": 0.0},
            {"name": "q5", "kind": "revolute", "a": 0.0, "alpha": -90.0, "d": 0.0, "theta": 0.0},
            {"name": "q6", "kind": "revolute", "a": 0.0, "alpha": 0.0, "d": 80.0, "theta": 0.0},
        ],
    },
    "frames": {
        "base": {
            "in": "world",
            "xyz": [900.0, -300.0, 150.0],
            "rpy": [2.0, -1.0, 70.0],
            "tolerance": {"xyz": 5, "rpy": 1},
        },
        "tool": {
            "in": "flange",
            "xyz": [60.0, -40.0, 130.0],
            "rpy": [10.0, 20.0, 30.0],
            "tolerance": {"xyz": 2, "rpy": 0.5},
        },
    },
    "sensor": {"type": "pose", "sigma": {"xyz": 0.03, "rot": 0.005}},
    "tolerances": {"length": 0.2, "angle": 0.05},
    "masses": {"forearm": {"kg": 8.0, "com": [0.0, 0.0, 100.0], "in": "link4"}},
}
ROWS = 45
Document = dict[str, Any]
Spoilt = tuple[Document, pd.DataFrame]


def turn(axis: str, angle: np.ndarray) -> np.ndarray:
    out = np.tile(np.eye(4), (len(angle), 1, 1))
    out[:, :3, :3] = Rotation.from_euler(axis, np.ravel(angle)[:, None]).as_matrix()
    return out


def shift(axis: int, length: float) -> np.ndarray:
    out = np.eye(4)
    out[axis, 3] = length
    return out


def standing(frame: Document) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3] = Rotation.from_euler("xyz", frame["rpy"], degrees=True).as_matrix()
    out[:3, 3] = frame["xyz"]
    return out


def recorded(seed: int = 3) -> pd.DataFrame:
    """Poses of an arm that is not quite the drawing, worked out from the table here, with noise; deg."""
    rng = np.random.default_rng(seed)
    low, high = np.array([-150, -80, -60, -170, -100, -170]), np.array([150, 60, 120, 170, 100, 170])
    q = np.radians(rng.uniform(low, high, (ROWS, 6)))
    pose = np.tile(standing(ARM["frames"]["base"]), (ROWS, 1, 1))
    for k, row in enumerate(ARM["mechanism"]["joints"]):
        off = rng.standard_normal(4) * [0.2, 0.0009, 0.2, 0.0009]
        pose = pose @ turn("z", q[:, k] + np.radians(row["theta"]) + off[1]) @ shift(2, row["d"] + off[0])
        pose = (
            pose @ shift(0, row["a"] + off[2]) @ turn("x", np.full(ROWS, np.radians(row["alpha"]) + off[3]))
        )
    pose = pose @ standing(ARM["frames"]["tool"])
    noise = rng.standard_normal((ROWS, 6)) * [0.03, 0.03, 0.03, 9e-5, 9e-5, 9e-5]
    seen = Rotation.from_matrix(pose[:, :3, :3]) * Rotation.from_rotvec(noise[:, 3:])
    values = np.hstack([np.degrees(q), pose[:, :3, 3] + noise[:, :3], np.degrees(seen.as_rotvec())])
    return pd.DataFrame(values, columns=[*JOINTS, "x", "y", "z", "rx", "ry", "rz"])


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def document(**changes: Any) -> Document:
    copy: Document = json.loads(json.dumps(ARM))
    return {key: value for key, value in {**copy, **changes}.items() if value is not None}


def written(folder: Path, machine: Document, rows: pd.DataFrame) -> tuple[Path, Path]:
    (folder / "arm.yaml").write_text(document_text(machine), encoding="utf-8")
    rows.to_csv(folder / "r.csv", index=False)
    return folder / "arm.yaml", folder / "r.csv"


def checked(folder: Path, machine: Document, rows: pd.DataFrame) -> Check:
    paths = written(folder, machine, rows)
    return check_files(paths[0], [paths[1]])[0]


def columns(rows: pd.DataFrame, change: Callable[[pd.Series], Any], *names: str) -> Spoilt:
    out = rows.copy()
    for name in names:
        out[name] = change(out[name])
    return document(), out


def metres(rows: pd.DataFrame) -> Spoilt:
    return columns(rows, lambda v: v / 1000, "x", "y", "z")


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


def test_a_right_pair_is_left_in_peace(right: pd.DataFrame, tmp_path: Path) -> None:
    assert checked(tmp_path, document(), right).document()["found"] == []


@pytest.mark.parametrize("name", ["telescope", "nanopositioner", "polisher"])
def test_the_bundled_pairs_are_left_in_peace(name: str) -> None:
    found = check_files(MACHINES / name / "machine.yaml", [MACHINES / name / "recording.csv"])[0]
    assert found.verdict == "ok", found.found


def test_what_needs_no_fit(right: pd.DataFrame, tmp_path: Path) -> None:
    def kinds(machine: Document, rows: pd.DataFrame) -> list[tuple[str, str]]:
        return [(f.kind, f.verdict) for f in checked(tmp_path, machine, rows).found]

    assert ("too-few-rows", "wrong") in kinds(document(), right[:3])
    assert ("too-few-rows", "suspect") in kinds(document(), right[:5])
    assert ("no-sensor", "wrong") in kinds(document(sensor=None), right)
    assert ("no-gravity", "suspect") in kinds(document(gravity=None), right)
    assert ("no-tolerances", "wrong") in kinds(document(tolerances=None), right)
    assert ("no-tolerances", "suspect") in kinds(document(tolerances={"length": 0, "angle": 0}), right)
    twice = pd.concat([right, right[5:9]], ignore_index=True)
    assert ("duplicated-rows", "suspect") in kinds(document(), twice)
    ranged = document()
    ranged["mechanism"]["joints"][0]["range"] = [-20.0, 20.0]
    assert ("offset", "wrong") in kinds(ranged, right)


def test_a_joint_that_was_not_logged(right: pd.DataFrame, tmp_path: Path) -> None:
    found = checked(tmp_path, document(), right.assign(q2=10.0)).found
    assert [(f.kind, f.where, f.verdict) for f in found] == [("joint-never-moves", ("q2",), "wrong")]


def test_sigma_is_held_against_replicates(right: pd.DataFrame, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    repeated = pd.concat([right[:10]] * 4, ignore_index=True)
    for name in ("x", "y", "z"):
        repeated[name] += 0.03 * rng.standard_normal(len(repeated))
    rows = pd.concat([right, repeated], ignore_index=True)
    machine = document(sensor={"type": "pose", "sigma": {"xyz": 1.5, "rot": 0.005}})
    found = checked(tmp_path, machine, rows)
    stated = next(f for f in found.found if f.kind == "sigma")
    assert stated.where == ("sensor.sigma.xyz",)
    assert stated.after == pytest.approx(0.03, rel=0.5)  # 40 rows, a middle of ten groups


def test_gross_readings_hide_no_slip(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right.copy()
    rows.loc[[4, 30, 41], "z"] += 5000.0
    machine, spoilt = backwards(rows)
    assert checked(tmp_path, machine, spoilt).found[0].kind == "sign"
    assert checked(tmp_path, document(), rows).verdict == "ok"


def test_lost_readings_are_no_slip(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right.copy()
    rows.loc[[2, 9], "x"] = np.nan
    rows.loc[20, "ry"] = np.nan
    assert checked(tmp_path, document(), rows).verdict == "ok"


def test_one_slip_behind_another(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = metres(right)
    rows["q3"] = -rows["q3"]
    kinds = {f.kind for f in checked(tmp_path, machine, rows).found}
    assert kinds == {"unit-length", "sign"}


def test_the_same_answer_every_time_and_in_every_order_of_rows(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = exchanged(right)
    first = checked(tmp_path, machine, rows).document()
    assert checked(tmp_path, machine, rows).document() == first
    other = checked(tmp_path, machine, rows.sample(frac=1.0, random_state=1)).document()
    assert [(f["kind"], f["where"]) for f in other["found"]] == [
        (f["kind"], f["where"]) for f in first["found"]
    ]


def test_the_command_and_the_gate(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = metres(right)
    paths = [str(path) for path in written(tmp_path, machine, rows)]
    runner = CliRunner()
    told = runner.invoke(app, ["check", *paths, "--json", "--fix", str(tmp_path / "mended")])
    assert told.exit_code == 2
    answer = json.loads(told.stdout)
    assert (answer["schema"], answer["verdict"]) == ("truepose/check/1", "wrong")
    assert set(answer["found"][0]) >= {"kind", "where", "before", "after", "fix"}
    assert [Path(f).name for f in answer["files"]] == ["arm.yaml", "r.csv"]
    refused = runner.invoke(app, ["calibrate", *paths, "-o", str(tmp_path / "out")])
    assert refused.exit_code == 2 and "readings in m: it would fit" in refused.stderr
    assert not (tmp_path / "out").exists()
    anyway = runner.invoke(app, ["calibrate", *paths, "-o", str(tmp_path / "out"), "--anyway"])
    assert anyway.stdout.startswith("WRONG: unit-length")
    assert json.loads((tmp_path / "out/fit.json").read_text())["check"]["verdict"] == "wrong"
    assert "WRONG: unit-length" in (tmp_path / "out/report.html").read_text()


def test_readings_that_two_sensors_share(right: pd.DataFrame, tmp_path: Path) -> None:
    both = [ARM["sensor"], {"type": "position", "sigma": {"xyz": 0.03}}]
    found = checked(tmp_path, document(sensor=both), right)
    assert [(f.kind, f.where) for f in found.found] == [("duplicated-columns", ("x", "y", "z"))]
    assert found.verdict == "suspect"


URDF = """<robot name="r"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/>
<joint name="j1" type="revolute"><parent link="l0"/><child link="l1"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/></joint>
<joint name="j2" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0.1" rpy="1.5708 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="j3" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/></joint>
</robot>"""
DESCRIBED = """\
# the arm in the corner
schema: truepose/machine/1
name: arm
tolerances: {length: 0.1, angle: 0.05}  # drawing
mechanism: {type: urdf, file: parts/arm.urdf, base_link: l0, tip_link: l3}
frames:
  base: {in: world, xyz: [100, 50, 0], rpy: [0, 0, 30], tolerance: {xyz: .inf, rpy: .inf}}
  tool: {in: flange, xyz: [250, 0, 40], tolerance: {xyz: 0.5, rpy: 0}}
sensor: {type: position, sigma: {xyz: 0.02}}
"""


def test_check_from_python(right: pd.DataFrame, tmp_path: Path) -> None:
    path, _ = written(tmp_path, *metres(right))
    machine = truepose.load_machine(path)
    assert truepose.check(machine, right).verdict == "ok"
    found = truepose.check(machine, metres(right)[1])
    assert found.to_frame()["kind"].tolist() == ["unit-length"]
    assert len(repr(found).splitlines()) <= 24
    with pytest.raises(truepose.InputError, match="sensor"):
        truepose.check(truepose.load_machine(written(tmp_path, document(sensor=None), right)[0]), right)


def test_a_mended_pair_is_not_written_over_its_source(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, recording = written(tmp_path, document(), right)
    with pytest.raises(truepose.InputError, match="another directory"):
        Pair.read(machine, [recording]).write(tmp_path)


def test_a_robot_description_goes_with_the_mended_machine_file(tmp_path: Path) -> None:
    """The machine file keeps its comments, and its URDF stands beside it, so that the mended pair is whole."""
    (tmp_path / "given" / "parts").mkdir(parents=True)
    given = tmp_path / "given" / "m.yaml"
    (tmp_path / "given" / "parts" / "arm.urdf").write_text(URDF, encoding="utf-8")
    given.write_text(DESCRIBED, encoding="utf-8")
    machine = truepose.load_machine(given)
    rng = np.random.default_rng(5)
    poses = pd.DataFrame(rng.uniform(-1.5, 1.5, (30, 3)), columns=["j1 [rad]", "j2 [rad]", "j3 [rad]"])
    rows = pd.concat([poses, truepose.simulate(machine, poses, seed=2).reset_index(drop=True)], axis=1)
    rows.assign(**{"j2 [rad]": -rows["j2 [rad]"]}).to_csv(tmp_path / "r.csv", index=False)
    mended = tmp_path / "mended" / "m.yaml"
    arguments = ["check", str(given), str(tmp_path / "r.csv"), "--fix", str(mended.parent)]
    stopped = CliRunner().invoke(app, arguments)
    assert stopped.exit_code == 2 and stopped.stdout.count("mended/") == 3, stopped.output
    assert check_files(mended, [tmp_path / "mended" / "r.csv"])[0].verdict == "ok"
    assert mended.read_text(encoding="utf-8") == DESCRIBED.replace("parts/arm.urdf", "arm.urdf")


def test_a_urdf_in_millimetres_is_mended(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "m.yaml").write_text(DESCRIBED, encoding="utf-8")
    (tmp_path / "parts" / "arm.urdf").write_text(URDF, encoding="utf-8")
    machine = truepose.load_machine(tmp_path / "m.yaml")
    q = np.random.default_rng(5).uniform(-1.5, 1.5, (30, 3))
    poses = pd.DataFrame(q, columns=["j1 [rad]", "j2 [rad]", "j3 [rad]"])
    rows = pd.concat([poses, truepose.simulate(machine, poses, seed=2).reset_index(drop=True)], axis=1)
    rows.to_csv(tmp_path / "r.csv", index=False)
    (tmp_path / "parts" / "arm.urdf").write_text(rescaled(URDF, 1000.0), encoding="utf-8")
    found = check_files(tmp_path / "m.yaml", [tmp_path / "r.csv"])[0]
    assert [(f.kind, f.verdict) for f in found.found] == [("unit-length", "wrong")]
    assert found.found[0].says == "the URDF's lengths in mm"
    found.mended(Pair.read(tmp_path / "m.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/m.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"


def test_lengths_of_a_urdf_alone_are_rescaled() -> None:
    text = """<joint name="a" type="prismatic"><origin rpy="0 0 1" xyz="1 -2.5 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="4" effort="5"/></joint>
<joint name="b" type="revolute"><origin xyz='1e-3 0 0'/><limit lower="-3" upper="4"/></joint>"""
    grown = text.replace("1 -2.5 0", "10 -25 0").replace("1e-3 0 0", "0.01 0 0")
    assert rescaled(text, 10.0) == grown.replace('"-3" upper="4" effort', '"-30" upper="40" effort')


def test_a_zero_counts_within_the_range(right: pd.DataFrame, tmp_path: Path) -> None:
    """An encoder that starts again after a turn: mended readings are back in the joint's range, one by one."""
    machine = document()
    machine["mechanism"]["joints"][3]["range"] = [-172.0, 172.0]
    spoilt = right.assign(q4=(right["q4"] + 163.0 + 180.0) % 360.0 - 180.0)
    found = checked(tmp_path, machine, spoilt)
    assert [(f.kind, f.where, f.verdict) for f in found.found] == [("offset", ("q4",), "wrong")]
    found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/arm.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"
    read = pd.read_csv(tmp_path / "mended/r.csv")["q4"]
    assert np.allclose(read, right["q4"], atol=0.5)


def platform(inch: float) -> Document:
    """Six struts on vertical rails, lengths in parts of ``inch``."""
    legs = []
    for k in range(6):
        below, above = (np.radians(60 * (k // 2) * 2 + side * (-1) ** k) for side in (12.0, 48.0))
        a, b = 390 * np.array([np.cos(below), np.sin(below)]), 250 * np.array([np.cos(above), np.sin(above)])
        legs.append(
            {
                "name": f"leg{k + 1}",
                "joint": f"rho{k + 1}",
                "a": [*(a / inch).tolist(), 0.0],
                "u": [0.0, 0.0, 1.0],
                "b": [*(b / inch).tolist(), 0.0],
                "length": 500.0 / inch,
            }
        )
    home = float(np.sqrt(500.0**2 - np.sum((a - b) ** 2)))
    return {
        "schema": "truepose/machine/1",
        "name": "platform",
        "mechanism": {"type": "6-pus", "legs": legs, "home": [0.0, 0.0, home / inch, 0.0, 0.0, 0.0]},
        "frames": {
            "base": {"in": "world", "xyz": [200 / inch, 0, 0], "tolerance": {"xyz": 5 / inch, "rpy": 1}}
        },
        "sensor": {"type": "pose", "sigma": {"xyz": 0.02 / inch, "rot": 0.005}},
        "tolerances": {"length": 0.1 / inch, "angle": 0.05},
    }


def test_a_platform_drawn_in_inches(tmp_path: Path) -> None:
    """Its loops close from a home that is in inches, too, with strokes longer than the machine then seems to be."""
    (tmp_path / "right.yaml").write_text(document_text(platform(1.0)), encoding="utf-8")
    q = np.random.default_rng(8).uniform(-70, 70, (30, 6)) + np.linspace(-90, 90, 30)[:, None]
    poses = pd.DataFrame(q, columns=[f"rho{k}" for k in range(1, 7)])
    seen = truepose.simulate(truepose.load_machine(tmp_path / "right.yaml"), poses, seed=1)
    found = checked(tmp_path, platform(25.4), pd.concat([poses, seen.reset_index(drop=True)], axis=1))
    assert (found.verdict, found.found[0].says) == ("wrong", "the machine file's lengths in inch")
    found.mended(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).write(tmp_path / "mended")
    assert check_files(tmp_path / "mended/arm.yaml", [tmp_path / "mended/r.csv"])[0].verdict == "ok"


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


@pytest.mark.parametrize(("share", "verdict"), [(0.05, "suspect"), (0.5, "wrong")])
def test_a_misfit_that_nothing_explains(
    share: float, verdict: str, right: pd.DataFrame, tmp_path: Path
) -> None:
    """Up to what physics can make of a motion nothing is certain: a right machine must not be refused."""
    rng, rows = np.random.default_rng(6), right.copy()
    for name in ("x", "y", "z"):
        rows[name] += share * float(rows[name].std()) * rng.standard_normal(len(rows))
    found = checked(tmp_path, document(), rows)
    assert ("unexplained", verdict) in [(f.kind, f.verdict) for f in found.found], found.found
    assert found.verdict == verdict


def test_a_sheet_keeps_what_is_not_changed(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("q1,x [um],note\n1.50,2,fine\n-3,4.25,\n", encoding="utf-8")
    sheet = Sheet.of(tables([tmp_path / "r.csv"])[0])
    assert sheet.text() == "q1,x [um],note\n1.50,2,fine\n-3,4.25,\n"
    assert sheet.in_unit(["x"], "m").text().startswith("q1,x [m],note")
    assert sheet.with_numbers({"q1": -sheet.numbers("q1")}).text().splitlines()[1] == "-1.5,2,fine"


def test_documents_are_mended_where_they_are(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(document_text(document()), encoding="utf-8")
    pair = Pair.read(tmp_path / "m.yaml", [])
    changed = pair.with_field(("mechanism", "joints", 2, "theta"), 5.0)
    assert changed.get(("mechanism", "joints", 2, "theta")) == 5.0
    assert pair.get(("mechanism", "joints", 2, "theta")) == 0.0
    assert pair.get(("mechanism", "legs", 0)) is None
