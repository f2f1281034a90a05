"""The gate: what needs no search, what the commands do with its answer; nameless tables, other rotations, gravity reversed."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import truepose
from support.checked_arm import ARM, JOINTS, Document, checked, document, metres, recorded, written
from support.command import input_error, invoke, refused, run
from support.examples import by_day
from truepose.identification.leaves.check.no_convention import unnamed_table
from truepose.identification.leaves.check.pair import Pair
from truepose.identification.leaves.check.result import Found
from truepose.identification.leaves.check.run import check_files, check_loaded

MACHINES = Path(truepose.__path__[0]) / "models/machines"


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


@pytest.mark.parametrize("name", by_day(["telescope", "nanopositioner", "polisher"], "polisher"))
def test_the_bundled_pairs_are_left_in_peace(name: str) -> None:
    found = check_files(MACHINES / name / "machine.yaml", [MACHINES / name / "recording.csv"])[0]
    assert found.verdict == "ok", found.found


def test_what_needs_no_fit(right: pd.DataFrame, tmp_path: Path) -> None:
    def kinds(machine: Document, rows: pd.DataFrame) -> list[tuple[str, str]]:
        return [(f.kind, f.verdict) for f in checked(tmp_path, machine, rows).found]

    for few in (3, 5):
        assert ("too-few-rows", "suspect") in kinds(document(), right[:few])
    assert ("no-sensor", "wrong") in kinds(document(sensor=None), right)
    assert ("no-gravity", "suspect") in kinds(document(gravity=None), right)
    assert ("no-tolerances", "wrong") in kinds(document(tolerances=None), right)
    assert ("no-tolerances", "suspect") in kinds(document(tolerances={"length": 0, "angle": 0}), right)
    twice = pd.concat([right, right[5:9]], ignore_index=True)
    assert ("duplicated-rows", "suspect") in kinds(document(), twice)
    ranged = document()
    ranged["mechanism"]["joints"][0]["range"] = [-20.0, 20.0]
    assert ("offset", "wrong") in kinds(ranged, right)


@pytest.mark.nightly
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


def test_lost_readings_are_no_slip(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right.copy()
    rows.loc[[2, 9], "x"] = np.nan
    rows.loc[20, "ry"] = np.nan
    assert checked(tmp_path, document(), rows).verdict == "ok"


def test_the_command_and_the_gate(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = metres(right)
    paths = written(tmp_path, machine, rows)
    told = invoke("check", *paths, "--json", "--fix", tmp_path / "mended")
    assert told.exit_code == 2
    answer = json.loads(told.stdout)
    assert (answer["schema"], answer["verdict"]) == ("truepose/check/1", "wrong")
    assert set(answer["found"][0]) >= {"kind", "where", "before", "after", "fix"}
    assert [Path(f).name for f in answer["files"]] == ["arm.yaml", "r.csv"]
    refused("calibrate", *paths, "-o", tmp_path / "out", said="readings in m: it would fit")
    assert not (tmp_path / "out").exists()
    anyway = invoke("calibrate", *paths, "-o", tmp_path / "out", "--anyway")
    assert anyway.stdout.startswith("WRONG: unit-length")
    assert json.loads((tmp_path / "out/fit.json").read_text())["check"]["verdict"] == "wrong"
    assert "WRONG: unit-length" in (tmp_path / "out/report.html").read_text()


@pytest.mark.nightly
def test_readings_that_two_sensors_share(right: pd.DataFrame, tmp_path: Path) -> None:
    both = [ARM["sensor"], {"type": "position", "sigma": {"xyz": 0.03}}]
    found = checked(tmp_path, document(sensor=both), right)
    assert [(f.kind, f.where) for f in found.found] == [("duplicated-columns", ("x", "y", "z"))]
    assert found.verdict == "suspect"


def test_check_from_python(right: pd.DataFrame, tmp_path: Path) -> None:
    path, _ = written(tmp_path, *metres(right))
    machine = truepose.load_machine(path)
    assert truepose.check(machine, right).verdict == "ok"
    found = truepose.check(machine, metres(right)[1])
    assert found.to_frame()["kind"].tolist() == ["unit-length"]
    assert len(repr(found).splitlines()) <= 24
    with pytest.raises(truepose.InputError, match="sensor"):
        truepose.check(truepose.load_machine(written(tmp_path, document(sensor=None), right)[0]), right)


def nameless(convention: str) -> Document:
    """The arm's table without a name, as the readings were made with it, or with rows one joint on."""
    machine = document()
    del machine["mechanism"]["convention"]
    joints = machine["mechanism"]["joints"]
    if convention == "modified":
        before = [{"a": 0.0, "alpha": 0.0}, *({k: row[k] for k in ("a", "alpha")} for row in joints)]
        machine["mechanism"]["joints"] = [row | old for row, old in zip(joints, before, strict=False)]
    return machine


@pytest.mark.parametrize(
    ("convention", "words"),
    [("standard", "a data sheet's standard table"), ("modified", "a modified table (Craig)")],
)
def test_a_table_without_a_name_is_that_of_which_the_readings_are(
    convention: str, words: str, tmp_path: Path
) -> None:
    path, rows = written(tmp_path, nameless(convention), recorded()[:20])
    pair = Pair.read(path, [rows])
    check = unnamed_table(pair, [rows])
    assert check is not None
    (found,) = check.found
    assert (found.kind, found.where) == ("dh-convention", ("mechanism.joints", "mechanism.convention"))
    assert found.says == f"the joints have a field 'a' and no convention is stated; as {words} they fit best"
    assert found.fix == f"state 'convention: {convention}' beside 'joints'"
    assert (found.verdict, found.before, found.unit, check.rows) == ("wrong", None, "mm", 20)
    # tolerances of the arm: 0.2 mm and 0.05 deg over a metre
    assert found.after is not None and found.after == check.left and 0.1 < found.after < 5.0
    assert found.mend is not None
    assert found.mend(pair).get(("mechanism", "convention")) == convention


@pytest.mark.parametrize(
    "mechanism",
    [{"convention": "standard"}, {"type": "6-ups"}, {"joints": "six"}, {"joints": [{"name": "q1"}]}],
)
def test_other_faults_of_a_file_are_no_matter_of_names(mechanism: Document, tmp_path: Path) -> None:
    machine = nameless("standard")
    machine["mechanism"] |= mechanism
    path, rows = written(tmp_path, machine, recorded()[:20])
    assert unnamed_table(Pair.read(path, [rows]), [rows]) is None


VECTOR = ["rx", "ry", "rz"]


def in_form(rows: pd.DataFrame, names: tuple[str, ...]) -> pd.DataFrame:
    """Return the rows with their rotation as a quaternion, scalar last, or as roll, pitch and yaw under other names."""
    turned = Rotation.from_rotvec(rows[VECTOR].to_numpy(), degrees=True)
    values = turned.as_quat() if len(names) == 4 else turned.as_euler("ZYX", degrees=True)[:, ::-1]
    return pd.concat([rows.drop(columns=VECTOR), pd.DataFrame(values, columns=list(names))], axis=1)


@pytest.mark.parametrize(
    "names",
    [("qx", "qy", "qz", "qw"), ("roll", "pitch", "yaw"), ("C", "B", "A"), ("W", "P", "R")],
    ids="".join,
)
def test_what_the_error_says_to_do_gives_a_recording_that_fits(
    names: tuple[str, ...], tmp_path: Path
) -> None:
    rows = recorded()
    assert not np.allclose(rows[VECTOR], 0.0)
    machine, table = written(tmp_path, document(), in_form(rows, names))
    with input_error("missing column 'rx'") as refused:
        check_files(machine, [table])
    found = re.search(r"`truepose import([^`]*)`", str(refused.value))
    assert found is not None, str(refused.value)
    run("import", table, *shlex.split(found[1]), "-o", tmp_path / "own.csv")
    assert check_files(machine, [tmp_path / "own.csv"])[0].verdict == "ok"


DOWN, UP = [0.0, 0.0, -9.80665], [0.0, 0.0, 9.80665]
MASSES = {
    "upper": {"kg": 30.0, "com": [-200.0, 0.0, 0.0], "in": "link2"},
    "forearm": {"kg": 20.0, "com": [0.0, 0.0, 100.0], "in": "link4"},
}
SEEN, UNSEEN = 6e-6, 1e-8
"""Compliances, rad/(N m), that move the tool by tens of the sensor's sigmas, and by far less than one."""


def effect(slug: str, joint: str, unit: str, **values: float) -> dict[str, Any]:
    return {
        "effect": slug,
        "place": [joint],
        "parameters": {name: {"value": value, "unit": unit} for name, value in values.items()},
    }


def found_by(
    folder: Path,
    stated: list[float],
    *effects: dict[str, Any],
    pulls: list[float] = DOWN,
    rows: int = 45,
    **more: Any,
) -> list[Found]:
    """What is said of gravity where an arm with these effects is pulled elsewhere than stated, perhaps."""
    q = recorded()[list(JOINTS)][:rows].reset_index(drop=True)
    built = document(masses=MASSES, gravity=pulls, effects=list(effects))
    real = truepose.load_machine(written(folder, built, q)[0])
    both = pd.concat([q, truepose.simulate(real, q, seed=4).reset_index(drop=True)], axis=1)
    drawn = document(**{"masses": MASSES, "gravity": stated, **more})
    machine = truepose.load_machine(written(folder, drawn, both)[0])
    found = check_loaded(machine, truepose.load_recording(machine, both)).found
    return [one for one in found if one.kind == "gravity-reversed"]


def compliant(size: float) -> list[dict[str, Any]]:
    return [effect("joint-compliance", f"q{k}", "rad/(N*m)", c=size) for k in (2, 3)]


@pytest.mark.parametrize(("down", "up"), [(DOWN, UP), (UP, DOWN), ([9.8, 0.0, 0.0], [-9.8, 0.0, 0.0])])
@pytest.mark.parametrize("masses", [MASSES, None])
def test_gravity_with_the_other_sign_is_told_and_mended(
    down: list[float], up: list[float], masses: dict[str, Any] | None, tmp_path: Path
) -> None:
    (found,) = found_by(tmp_path, up, *compliant(SEEN), pulls=down, masses=masses)
    assert found.verdict == "suspect" and found.where == ("gravity",) and found.mend is not None
    mended = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    assert mended.get(("gravity",)) == down
    assert found_by(tmp_path, down, *compliant(SEEN), pulls=down, masses=masses) == []


@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_no_encoder_makes_gravity_look_reversed(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    sizes = st.floats(-1e-3, 1e-3)
    eccentric = [
        effect("encoder-eccentricity", name, "rad", a=data.draw(sizes), b=data.draw(sizes))
        for name in JOINTS[1:3]
    ]
    compliance = data.draw(st.sampled_from([0.0, UNSEEN, SEEN]))
    assert found_by(tmp_path_factory.mktemp("arm"), DOWN, *eccentric, *compliant(compliance)) == []


@pytest.mark.parametrize(
    ("size", "rows", "more"),
    [(UNSEEN, 45, {}), (SEEN, 5, {}), (SEEN, 45, {"effects": compliant(SEEN)})],
)
def test_nothing_is_told_where_nothing_gives_way_that_can_be_seen(
    size: float, rows: int, more: dict[str, Any], tmp_path: Path
) -> None:
    assert found_by(tmp_path, UP, *compliant(size), rows=rows, **more) == []


@pytest.mark.nightly
@pytest.mark.parametrize("sensor", ["as it is", "position"])
@pytest.mark.parametrize("name", ["ur10-laser-tracker/configurations", "stewart-mocap/session_60"])
def test_real_recordings_in_another_unit(shared: Path, name: str, sensor: str, tmp_path: Path) -> None:
    """Points alone show no scale, so that a machine of a robot's size must decide where the slip was."""
    source = shared / "data" / name
    machine = yaml.safe_load((source.parent / "machine.yaml").read_text(encoding="utf-8"))
    rows = pd.read_csv(source.with_suffix(".csv"))
    if sensor == "position":
        machine["sensor"] = {"type": "position", "sigma": {"xyz": machine["sensor"]["sigma"]["xyz"]}}
        rows = rows.drop(columns=["rx", "ry", "rz"])
    small = rows.assign(**{axis: rows[axis] / 1000 for axis in "xyz"})
    assert checked(tmp_path, machine, small).found[0].says == "readings in m"
    machine["units"]["length"] = "m"
    headed = rows.rename(columns={axis: f"{axis} [mm]" for axis in "xyz"})
    says = checked(tmp_path, machine, headed).found[0].says
    assert says in ("the machine file's lengths in mm", "the mechanism's lengths in mm")
