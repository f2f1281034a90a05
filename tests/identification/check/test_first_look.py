"""What needs no search: rows, ranges, gravity, sigma, a machine without a sensor; limits on either side, and their words."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import truepose
from support.checked_arm import Document, checked, document, recorded, written
from truepose.identification.leaves.check.bare import bare, no_tolerances, out_of_range, repeats
from truepose.identification.leaves.check.pair import Pair, Scene, Sheet, Stand
from truepose.identification.leaves.check.result import Check, Found
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.run import check_loaded, shown, unbounded, without_sensor
from truepose.identification.leaves.check.weighing import reach
from truepose.identification.recording.recording import Recording
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def loaded(folder: Path, machine: Document, rows: pd.DataFrame) -> tuple[Machine, Recording]:
    path, _ = written(folder, machine, rows)
    found = truepose.load_machine(path)
    return found, truepose.load_recording(unbounded(found), rows)


def kinds(folder: Path, machine: Document, rows: pd.DataFrame) -> dict[str, Found]:
    return {f.kind: f for f in bare(*loaded(folder, machine, rows))}


@pytest.mark.parametrize(("rows", "verdict"), [(2, "suspect"), (3, "suspect"), (5, "suspect"), (6, None)])
def test_rows_are_too_few_where_constants_outnumber_readings(
    rows: int, verdict: str | None, right: pd.DataFrame, tmp_path: Path
) -> None:
    """Six readings a row for 36 constants: in six rows there are as many, in three half of them."""
    exact = document()
    exact["frames"]["tool"]["tolerance"] = {"xyz": 0, "rpy": 0}  # the tool's six
    machine = truepose.load_machine(written(tmp_path, exact, right)[0])
    free = sum(p.free for p in machine.parameters)
    assert free == 36
    found = kinds(tmp_path, exact, right[:rows]).get("too-few-rows")
    assert (found and found.verdict) == verdict
    if found:
        assert found.says.startswith(f"{rows} rows are {6 * rows} readings for 36 constants")
        assert found.fix.startswith("measure at least 12 poses")


def test_rows_for_validation_are_no_rows_of_a_fit(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right[:12].assign(role=["validation"] * 8 + ["calibration"] * 4)
    assert kinds(tmp_path, document(), rows)["too-few-rows"].says.startswith("4 rows are 24 readings")


@pytest.mark.parametrize(("kg", "heavy"), [(50.0, False), (50000.0, True)])
def test_masses_in_grams_are_heavier_than_a_cube_of_steel(
    kg: float, heavy: bool, right: pd.DataFrame, tmp_path: Path
) -> None:
    machine = document(gravity=[0, 0, -9.80665], masses={"hand": {"kg": kg, "com": [0, 0, 0], "in": "tool"}})
    found = kinds(tmp_path, machine, right).get("mass-unit")
    assert (found is not None) is heavy
    assert found is None or ("50 kg" in found.fix and found.verdict == "suspect")


@pytest.mark.parametrize(
    ("link", "others", "heavy"),
    [
        (3000.0, (12.0, 5.0), True),
        (3000.0, (1200.0, 5.0), False),
        (30.0, (0.5, 0.2), False),
        (3000.0, (12.0,), False),
    ],
)
def test_one_mass_out_of_proportion_to_all_others_is_told_by_name(
    link: float, others: tuple[float, ...], heavy: bool, right: pd.DataFrame, tmp_path: Path
) -> None:
    machine = document()
    machine["mechanism"]["joints"][1]["a"] = 1100.0
    weights = {"link3": link, **{f"other{k}": kg for k, kg in enumerate(others)}}
    machine["masses"] = {name: {"kg": kg, "com": [0, 0, 0], "in": "link3"} for name, kg in weights.items()}
    found = kinds(tmp_path, machine, right).get("mass-unit")
    assert (found is not None) is heavy
    assert found is None or (found.where == ("masses", "link3") and "3 kg" in found.fix)


@pytest.mark.parametrize(("digits", "coarse"), [(0, True), (4, False)])
def test_a_joint_logged_in_whole_degrees_is_reported_where_the_readings_miss(
    digits: int, coarse: bool, right: pd.DataFrame, tmp_path: Path
) -> None:
    column = next(name for name in right.columns if name.startswith("q3"))
    rows = right.assign(**{column: right[column].round(digits)})
    machine, recording = loaded(tmp_path, document(), rows)
    found = {f.kind: f for f in check_loaded(machine, recording).found}
    assert ("resolution" in found) is coarse
    assert not coarse or found["resolution"].where == ("q3",)


def test_rows_that_repeat_another_one_are_counted_once(right: pd.DataFrame, tmp_path: Path) -> None:
    twice = pd.concat([right[:8], right[2:4], right[3:4]], ignore_index=True)
    rows = loaded(tmp_path, document(), twice)[1]
    assert repeats(rows).tolist() == [8, 9, 10]
    found = kinds(tmp_path, document(), twice)["duplicated-rows"]
    assert found.says == "3 rows repeat an earlier one to the last digit: rows 9, 10, 11"
    assert found.mend is not None
    mended = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])).sheets[0]
    assert len(mended.cells) == 8 and mended.numbers("x")[7] == pytest.approx(right["x"][7])
    for name in ("x", "q1"):
        near = twice.copy()
        near.loc[[8, 9, 10], name] += [1e-9, 2e-9, 3e-9]
        assert not len(repeats(loaded(tmp_path, document(), near)[1]))
    timed = twice.assign(time=np.arange(11.0))
    assert not len(repeats(loaded(tmp_path, document(), timed)[1]))


def test_joints_that_stand_still_are_told(right: pd.DataFrame, tmp_path: Path) -> None:
    one = kinds(tmp_path, document(), right.assign(q2=1.0))["joint-never-moves"]
    assert one.says == "q2 never moves: nothing can be said of its constants"
    two = kinds(tmp_path, document(), right.assign(q2=1.0, q5=2.0))["joint-never-moves"]
    assert two.where == ("q2", "q5") and two.says.startswith("q2 and q5 never move: ")


@pytest.mark.parametrize(
    ("gravity", "masses", "told"), [(None, True, True), (None, False, False), ([0, 0, -9.8], True, False)]
)
def test_weights_need_gravity(
    gravity: list[float] | None, masses: bool, told: bool, right: pd.DataFrame, tmp_path: Path
) -> None:
    machine = document(gravity=gravity) if masses else document(gravity=gravity, masses=None)
    found = kinds(tmp_path, machine, right).get("no-gravity")
    assert (found is not None) == told
    if found is not None and found.mend is not None:
        pair = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
        x, y, z = pair.get(("gravity",))
        assert (x, y) == (0, 0) and z == pytest.approx(-9.81, abs=0.01)  # m/s^2, downwards


@pytest.mark.parametrize(
    ("low", "high", "says"),
    [
        (-151.0, 151.0, None),
        (-60.0, 150.0, "row 1: q1 is -100 deg, out of its range [-60, 150]"),
        (-150.0, 60.0, "row 2: q1 is 100 deg, out of its range [-150, 60]"),
        (-85.0, 115.0, "row 1: q1 is -100 deg, out of its range [-85, 115]"),
    ],
)  # fmt: skip
def test_readings_out_of_a_range_are_told_with_the_first_row(
    low: float, high: float, says: str | None, right: pd.DataFrame, tmp_path: Path
) -> None:
    machine = document()
    machine["mechanism"]["joints"][0]["range"] = [low, high]
    q = np.linspace(-100, 100, len(right))
    q[1] = 100.0
    found, rows = loaded(tmp_path, machine, right.assign(q1=q))
    told = [f.says.partition(": ")[2] for f in out_of_range(found, rows)]
    assert told == ([] if says is None else [says])


def pair_of(names: dict[str, Any]) -> Pair:
    sheet = Sheet("r.csv", pd.DataFrame(names, dtype=object), dict.fromkeys(names))
    return Pair("m.yaml", "", {"name": "m"}, (sheet,))


XYZ = {"x": ["0", "300"], "y": ["0", "-200"], "z": ["5", "6"]}
TARGETS = {f"{p}.{a}": ["1", "2"] for p in ("A", "B2") for a in "xyz"}


@pytest.mark.parametrize(
    ("names", "words", "block"),
    [
        (XYZ, "sensor: {type: position, sigma: {xyz: 0.006}}", {"type": "position", "sigma": {"xyz": 0.006}}),
        (XYZ | {key: ["0", "1"] for key in ("rx", "ry", "rz")}, "sensor: {type: pose, sigma: {xyz: 0.006, rot: 0.005}}",
         {"type": "pose", "sigma": {"xyz": 0.006, "rot": 0.005}}),
        (TARGETS, "sensor: {type: targets, points: {A: [x, y, z], B2: [x, y, z]}, sigma: {xyz: ...}}", None),
        ({"x": ["1"], "y": ["2"], "C.x": ["3"], "C.y": ["4"]}, "", None),
    ],
)  # fmt: skip
def test_a_machine_without_a_sensor_is_told_which_its_columns_speak_of(
    names: dict[str, Any], words: str, block: dict[str, Any] | None
) -> None:
    pair = pair_of(names)
    (found,) = without_sensor(pair).found
    assert found.fix.startswith(
        f"add '{words}' to the machine file" if block else "add a block 'sensor' to the machine file"
    )
    assert (found.mend is None) == (block is None)
    if found.mend is not None:
        assert found.mend(pair).get(("sensor",)) == block
    assert without_sensor(pair).rows == len(pair.sheets[0].cells)
    assert without_sensor(replace(pair, sheets=())).rows == 0


def test_fields_of_a_document_are_made_where_there_are_none() -> None:
    pair = Pair("m.yaml", "", {"a": {"b": [1, {"c": 2}]}}, ())
    assert [pair.get(f) for f in (("a", "b", 1, "c"), ("a", "b", 2), ("a", "x"), ("a", "b", "c"))] == [
        2,
        None,
        None,
        None,
    ]
    assert pair.with_field(("a", "b", 0), 5).document == {"a": {"b": [5, {"c": 2}]}}
    assert pair.with_field(("d", "e"), 3).document == {"a": {"b": [1, {"c": 2}]}, "d": {"e": 3}}
    assert pair.document == {"a": {"b": [1, {"c": 2}]}}


def test_two_recordings_of_one_name_are_written_beside_each_other(
    right: pd.DataFrame, tmp_path: Path
) -> None:
    machine, _ = written(tmp_path, document(), right)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        right.to_csv(tmp_path / name / "r.csv", index=False)
    pair = Pair.read(machine, [tmp_path / "a/r.csv", tmp_path / "b/r.csv"])
    out = pair.write(tmp_path / "out")
    assert [Path(p).name for p in out] == ["arm.yaml", "1_r.csv", "2_r.csv"]
    assert pd.read_csv(out[2])["x"].to_numpy() == pytest.approx(right["x"].to_numpy())


@pytest.mark.parametrize(
    ("verdicts", "whole"),
    [((), "ok"), (("ok",), "ok"), (("ok", "suspect"), "suspect"), (("suspect", "wrong"), "wrong")],
)
def test_the_worst_finding_is_the_verdict(verdicts: tuple[Any, ...], whole: str) -> None:
    found = tuple(Found("k", ("a",), "says", "fix", verdict) for verdict in verdicts)
    check = Check(found, 7, 0.5)
    assert check.verdict == whole
    assert (
        check.document()["misfit"].items() >= {"value": 0.5, "unit": "mm"}.items()
        and check.document()["rows"] == 7
    )
    assert Check(found, 7, None).document()["misfit"] is None


def stand(misfit: float, length: float | None) -> Stand:
    scene: Any = None
    return Stand(np.zeros(1), misfit, length, np.zeros((0, 1)), np.zeros(0, dtype=np.intp), scene)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ((5.0, 2.0), (1.0, 0.5), (2.0, 0.5, "mm")),
        ((5.0, None), (1.0, 0.5), (5.0, 1.0, "sigma")),
        ((5.0, 2.0), (1.0, None), (5.0, 1.0, "sigma")),
        ((np.inf, None), (1.0, 0.5), (None, 0.5, "mm")),
        ((np.inf, None), (1.0, None), (None, 1.0, "sigma")),
    ],
)
def test_two_misfits_are_shown_in_one_unit(
    before: tuple[float, float | None], after: tuple[float, float | None], told: tuple[Any, ...]
) -> None:
    assert shown(stand(*before), stand(*after)) == told


def test_the_longest_dimension_is_the_reach(right: pd.DataFrame, tmp_path: Path) -> None:
    machine, rows = loaded(tmp_path, document(), right)
    rig = Rig(machine, rows)
    assert reach(rig, rig.scene.p) == 440.0
    p = rig.scene.p.copy()
    p[rig.names.index("q4.r")] = -900.0
    p[rig.at["base"]] = 5000.0  # where it stands says nothing of its size
    assert reach(rig, p) == 900.0


def test_replicates_are_told_by_their_own_scatter(right: pd.DataFrame, tmp_path: Path) -> None:
    """Four readings of each of ten poses with twenty times the stated scatter, or a twentieth."""
    rng = np.random.default_rng(4)
    for stated, scatter in ((0.03, 0.6), (0.6, 0.03)):
        repeated = pd.concat([right[:10]] * 4, ignore_index=True)
        repeated[["x", "y", "z"]] += scatter * rng.standard_normal((40, 3))
        machine = document(sensor={"type": "pose", "sigma": {"xyz": stated, "rot": 0.005}})
        found = checked(tmp_path, machine, pd.concat([right, repeated])).found
        one = next(f for f in found if f.where == ("sensor.sigma.xyz",))
        assert one.says.startswith("replicates scatter by ") and one.before == stated
        # ten groups of three coordinates, three free each: their middle within a third
        assert one.after == pytest.approx(scatter, rel=0.35)
        assert one.mend is not None
        pair = one.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
        assert pair.get(("sensor", "sigma", "xyz")) == pytest.approx(one.after, rel=0.01)


def test_scenes_are_changed_by_copies(right: pd.DataFrame, tmp_path: Path) -> None:
    """The rows of a recording are shared by all hypotheses."""
    rows = loaded(tmp_path, document(), right)[1]
    scene = Scene(rows, np.zeros(3), size=2.0)
    there = scene.with_columns({"x": rows.observations["x"] * 5.0}, 3.0)
    assert there.size == 6.0 and scene.size == 2.0
    np.testing.assert_array_equal(there.rows.observations["y"], rows.observations["y"])
    before = rows.q.copy()
    np.testing.assert_array_equal(scene.with_joints(rows.q + 1.0).rows.q, before + 1.0)
    np.testing.assert_array_equal(scene.rows.q, before)


def test_every_joint_out_of_its_range_is_told_and_one_without_is_not(
    right: pd.DataFrame, tmp_path: Path
) -> None:
    machine = document()
    joints = machine["mechanism"]["joints"]
    joints[1]["range"], joints[3]["range"], joints[4]["range"] = [-300.0, 300.0], [-10.0, 10.0], [-10.0, 10.0]
    found, rows = loaded(tmp_path, machine, right)
    told = list(out_of_range(found, rows))
    assert [(f.kind, f.where, f.verdict) for f in told] == [
        ("offset", ("q4",), "wrong"), ("offset", ("q5",), "wrong"),
    ]  # fmt: skip
    assert told[0].fix == "compare the zero, the unit and the range of q4"


def test_rows_in_which_nothing_was_read_repeat_no_other(right: pd.DataFrame, tmp_path: Path) -> None:
    """Zeros in all columns are what an instrument writes that saw nothing."""
    rows = right[:8].copy()
    rows.loc[3:, ["x", "y", "z", "rx", "ry", "rz"]] = 0.0
    rows.loc[4, "q1":"q6"] = rows.loc[3, "q1":"q6"].to_numpy()
    assert not len(repeats(loaded(tmp_path, document(), rows)[1]))
    rows.loc[3:, "z"] = 1e-9
    recording = loaded(tmp_path, document(), rows)[1]
    assert repeats(recording).tolist() == [4]
    assert not len(repeats(replace(recording, observations={})))
    assert not len(repeats(replace(recording, drivers={"payload": np.arange(8.0)})))


def test_few_rows_may_stand_still(right: pd.DataFrame, tmp_path: Path) -> None:
    for count, told in ((5, False), (6, True)):
        found = kinds(tmp_path, document(), right[:count].assign(q2=1.0))
        assert ("joint-never-moves" in found) == told


@pytest.mark.parametrize(
    ("stated", "misfit", "length", "verdict", "example"),
    [
        (None, 3.9, 0.234, "suspect", "{length: 0.2, angle: 0.03}"),
        (None, 4.1, 0.234, "wrong", "{length: 0.2, angle: 0.03}"),
        ({"length": 0, "angle": 0}, 4.1, 1.96, "suspect", "{length: 2, angle: 0.3}"),
        (None, 4.1, 0.004, "wrong", "{length: 0.01, angle: 0.001}"),
        (None, 4.1, None, "wrong", "{length: 0.01, angle: 0.001}"),
    ],
)
def test_tolerances_are_proposed_that_explain_what_is_left(
    stated: Document | None, misfit: float, length: float | None, verdict: str, example: str,
    right: pd.DataFrame, tmp_path: Path,
) -> None:  # fmt: skip
    """As an angle over the longest link, 440 mm; certain where nobody has stated any and readings miss the drawing."""
    machine, rows = loaded(tmp_path, document(tolerances=stated), right[:8])
    rig = Rig(machine, rows)
    (found,) = no_tolerances(rig, replace(rig.stand(), misfit=misfit, length=length))
    assert (found.kind, found.where, found.verdict) == ("no-tolerances", ("tolerances",), verdict)
    sure = ", to 4.1 sigma, and physics blamed for what the workshop made" if verdict == "wrong" else ""
    assert found.says == f"no tolerance of the mechanism is stated: only base and tool would be fitted{sure}"
    assert found.fix == (
        f"state what the drawing allows, for example 'tolerances: {example}'; 0 where it is exact"
    )
    assert found.mend is not None
    pair = found.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    written_there = pair.get(("tolerances",))
    assert f"{{length: {written_there['length']:g}, angle: {written_there['angle']:g}}}" == example
    known = Rig(*loaded(tmp_path, document(), right[:8]))
    assert not list(no_tolerances(known, known.stand()))


def test_no_file_that_was_read_is_written_over(right: pd.DataFrame, tmp_path: Path) -> None:
    """Not even one of them, beside which the others are new."""
    machine, recording = written(tmp_path, document(), right)
    (tmp_path / "rows").mkdir()
    recording.rename(tmp_path / "rows" / "r.csv")
    pair = Pair.read(machine, [tmp_path / "rows" / "r.csv"])
    for folder in (tmp_path, tmp_path / "rows"):
        with pytest.raises(truepose.InputError, match="holds the files that are checked, expected another"):
            pair.write(folder)
    assert [Path(p) for p in pair.write(tmp_path / "new")] == [
        tmp_path / "new" / "arm.yaml", tmp_path / "new" / "r.csv",
    ]  # fmt: skip


def test_the_worst_is_told_first(right: pd.DataFrame, tmp_path: Path) -> None:
    """Whatever was looked at first."""
    rows = right.assign(**{axis: right[axis] / 1000.0 for axis in "xyz"})
    found = checked(tmp_path, document(gravity=None), rows)
    assert [(f.kind, f.verdict) for f in found.found] == [("unit-length", "wrong"), ("no-gravity", "suspect")]
    assert found.rows == 45 and found.unit == "mm"
