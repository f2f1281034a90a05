"""Which slips are thought of for a machine and which are not, and what they do where more than one is true."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

import truepose
from support import MACHINES
from support.checked_arm import FEW, JOINTS, Document, document, recorded, written
from truepose.identification.identifiability.poses import drawn_poses
from truepose.identification.leaves.check.kinds.frames import frames_swapped
from truepose.identification.leaves.check.kinds.joints import end_zeros, exchanged, offset, zeros
from truepose.identification.leaves.check.kinds.order import matched, shifted
from truepose.identification.leaves.check.kinds.poses import mirrored, poses, targets
from truepose.identification.leaves.check.kinds.units import file_lengths, units
from truepose.identification.leaves.check.pair import SELDOM, Pair
from truepose.identification.leaves.check.rig import Rig
from truepose.identification.leaves.check.run import unbounded

Array = NDArray[np.float64]
SEEN = ["x", "y", "z", "rx", "ry", "rz"]
INF = float("inf")


@pytest.fixture(scope="module")
def right() -> pd.DataFrame:
    return recorded()


def rig_on(folder: Path, rows: pd.DataFrame, machine: Document | None = None) -> Rig:
    path, recording = written(folder, machine or document(), rows)
    loaded = truepose.load_machine(path)
    return Rig(loaded, truepose.load_recording(unbounded(loaded), recording))


def gantry(joints: list[Document], **more: Any) -> Document:
    own = {"type": "serial", "joints": joints}
    sensor = {"type": "position", "sigma": {"xyz": 0.03}}
    return document(mechanism=own, sensor=sensor, masses=None, gravity=None, **more)


def slides(names: str) -> list[Document]:
    """Slides and turning joints by letters s and t, along and about axes of their own."""
    kinds = {"s": "prismatic", "t": "revolute"}
    return [
        {"name": f"q{k}", "kind": kinds[letter], "alpha": 90.0 * (k > 1), "d": 100.0, "r": 10.0}
        for k, letter in enumerate(names, start=1)
    ]


def table(names: list[str], count: int = 8, seed: int = 1) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    return pd.DataFrame(rng.uniform(-80, 80, (count, len(names))), columns=names)


@pytest.mark.parametrize(
    ("base", "count"), [({"xyz": 5, "rpy": 1}, 6), ({"xyz": INF, "rpy": INF}, 1), ({"xyz": 0, "rpy": INF}, 1)]
)
def test_mirrors_differ_by_a_turn_of_a_base_that_nobody_knows(
    base: Document, count: int, right: pd.DataFrame, tmp_path: Path
) -> None:
    machine = document(sensor={"type": "position", "sigma": {"xyz": 0.03}})
    machine["frames"]["base"]["tolerance"] = base
    rig = rig_on(tmp_path, right[:FEW], machine)
    found = list(mirrored(rig, rig.scene))
    assert len(found) == count
    assert ("measured z with the other sign", ("z",)) in [(s.says, s.where) for s in found]


@pytest.mark.parametrize(("count", "orders"), [(2, 1), (4, 23), (5, 10)])
def test_targets_of_a_few_are_exchanged_in_every_order_and_of_many_by_pairs(
    count: int, orders: int, right: pd.DataFrame, tmp_path: Path
) -> None:
    points = {f"P{k}": [10.0 * k, k**2, 3.0] for k in range(count)}
    seen = table([f"{name}.{a}" for name in points for a in "xyz"])
    machine = document(sensor={"type": "targets", "points": points, "sigma": {"xyz": 0.03}})
    rig = rig_on(tmp_path, pd.concat([right[list(JOINTS)][:8], seen], axis=1), machine)
    found = list(targets(rig, rig.scene))
    sizes = [len(slip.where) for slip in found]
    assert len({(*slip.where, slip.fix) for slip in found}) == len(found) == orders
    assert sizes == sorted(sizes) and sizes[0] == 2
    assert found[0].says == "targets P{} and P{} exchanged".format(*(name[1:] for name in found[0].where))
    if orders == 23:
        assert Counter(sizes) == {2: 6, 3: 8, 4: 9}
        assert found[-1].says == "targets P0, P1, P2 and P3 in another order"
        there = found[6].change(rig.scene)
        # read as the words say: columns of the first name are those of the second
        for pair in found[6].fix.removeprefix("rename the columns: ").split(", "):
            old, _, new = pair.partition(" is ")
            np.testing.assert_array_equal(there.rows.observations[f"{new}.y"], seen[f"{old}.y"])


@pytest.mark.parametrize(
    ("joints", "orders"),
    [
        ("tt", [("q1", "q2")]),
        ("st", []),
        ("sst", [("q1", "q2")]),
        ("ttt", [("q1", "q2"), ("q1", "q3"), ("q2", "q3"), ("q1", "q2", "q3"), ("q1", "q2", "q3")]),
    ],
)
def test_joints_are_exchanged_with_those_of_their_kind(
    joints: str, orders: list[tuple[str, ...]], tmp_path: Path
) -> None:
    names = [f"q{k}" for k in range(1, len(joints) + 1)]
    rig = rig_on(tmp_path, table([*names, "x", "y", "z"]), gantry(slides(joints)))
    assert [slip.where for slip in exchanged(rig, rig.scene)] == orders


def test_frames_that_are_alike_are_not_exchanged(right: pd.DataFrame, tmp_path: Path) -> None:
    rig = rig_on(tmp_path, right[:FEW])
    (slip,) = frames_swapped(rig, rig.scene)
    assert (slip.kind, slip.where) == ("frames-swapped", ("frames.base", "frames.tool"))
    assert slip.says == "frames.base and frames.tool exchanged"
    assert slip.fix == "exchange xyz, rpy and tolerance of frames.base and frames.tool"
    pair = slip.mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    own = document()["frames"]
    assert pair.get(("frames", "base")) == {**own["tool"], "in": "world"}
    assert pair.get(("frames", "tool")) == {**own["base"], "in": "flange"}
    alike = document()
    del alike["frames"]
    same = rig_on(tmp_path, right[:FEW], alike)
    assert not list(frames_swapped(same, same.scene))


@pytest.mark.parametrize(("size", "told"), [(-3.3, True), (2.5, False)])
def test_a_zero_that_a_calibration_finds_is_no_slip(
    size: float, told: bool, right: pd.DataFrame, tmp_path: Path
) -> None:
    """From three degrees on it is one: of the joint in which it is, and of the ends where base or tool tell it."""
    rig = rig_on(tmp_path, right[:FEW].assign(q4=right["q4"] + size))
    said = {s.where[0]: s.says for s in zeros(rig, rig.scene)}
    assert ("q4" in said) == told
    if told:
        # errors of the arm itself are a few hundredths of a degree
        assert float(said["q4"].split()[-2]) == pytest.approx(-size, abs=0.2)
    ends = rig_on(tmp_path, right[:FEW].assign(q1=right["q1"] + size))
    assert [s.where for s in end_zeros(ends, ends.scene)] == ([("q1",)] if told else [])


def test_a_slide_s_zero_is_looked_for_over_four_times_its_way(tmp_path: Path) -> None:
    """And one within a fiftieth of its way is what a calibration is for."""
    machine = gantry(slides("tst"))
    machine["frames"]["tool"] = {"in": "flange", "xyz": [50.0, 0.0, 30.0]}
    q = table(["q1", "q2", "q3"], 8)
    read = truepose.simulate(truepose.load_machine(written(tmp_path, machine, q)[0]), q, seed=None)
    way = float(np.ptp(q["q2"]))
    for share, told in ((1.7, True), (0.015, False)):
        rows = pd.concat([q.assign(q2=q["q2"] + share * way), read.reset_index(drop=True)], axis=1)
        rig = rig_on(tmp_path, rows, machine)
        found = {s.where[0]: s for s in zeros(rig, rig.scene)}
        assert ("q2" in found) == told
        if told:
            there = found["q2"].change(rig.scene).rows.q[:, 1] - rig.scene.rows.q[:, 1]
            np.testing.assert_allclose(there, -share * way, rtol=0.02)
            assert found["q2"].says == f"zero of q2 off by {there[0]:+.6g} mm"


def test_machines_with_loops_have_no_end_zeros() -> None:
    machine = truepose.load_machine(MACHINES / "ups.yaml")
    rows = drawn_poses(machine, 5)
    names = [name for sensor in machine.sensors for name in sensor.columns]
    rig = Rig(machine, replace(rows, observations={name: np.zeros(5) for name in names}))
    assert not list(end_zeros(rig, rig.scene))


@pytest.mark.parametrize(
    ("joints", "convention", "k", "field"),
    [
        ([{"name": "a", "kind": "revolute", "theta": 20.0}], None, 0, "theta"),
        ([{"name": "a", "kind": "prismatic", "r": 20.0}], None, 0, "r"),
        ([{"name": "a", "kind": "revolute", "a": 5.0, "alpha": 0.0, "d": 7.0, "theta": 20.0}], "standard", 0, "theta"),
        ([{"name": "a", "kind": "prismatic", "a": 5.0, "alpha": 0.0, "d": 20.0, "theta": 7.0}], "standard", 0, None),
    ],
)  # fmt: skip
def test_a_zero_is_mended_where_the_file_states_it_and_in_the_column_else(
    joints: list[Document], convention: str | None, k: int, field: str | None, tmp_path: Path
) -> None:
    more = [{**joints[0], "name": "b"}]
    machine = gantry([*joints, *more])
    if convention:
        machine["mechanism"]["convention"] = convention
    rows = table(["a", "b", "x", "y", "z"])
    rig = rig_on(tmp_path, rows, machine)
    angle = joints[0]["kind"] == "revolute"
    slip = offset(rig, k, np.radians(3.0) if angle else 3.0)
    unit = "deg" if angle else "mm"
    assert slip.says == f"zero of a off by +3 {unit}"
    assert slip.fix == f"add +3 {unit} to the zero of a in the machine file, or to its column"
    before = Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])
    after = slip.mend(before)
    if field is None:
        assert after.document == before.document
        np.testing.assert_allclose(after.sheets[0].numbers("a"), rows["a"] + 3.0)
    else:
        assert after.get(("mechanism", "joints", 0, field)) == pytest.approx(23.0)
        assert after.get(("mechanism", "joints", 1, field)) == 20.0
        np.testing.assert_allclose(after.sheets[0].numbers("a"), rows["a"])


def test_rows_are_shifted_within_their_files_and_what_was_lost_stays_lost(
    right: pd.DataFrame, tmp_path: Path
) -> None:
    rig = rig_on(tmp_path, right[:14])
    rows = replace(rig.recording, source_file=np.repeat([0, 1], 7))
    lost = np.arange(14) == 2
    scene = replace(rig.scene, rows=rows, lost=lost)
    late = next(s for s in shifted(rig, scene) if s.says == "readings 1 row too late")
    there = late.change(scene)
    assert there.lost is not None and np.flatnonzero(there.lost).tolist() == [2, 6, 13]
    early = next(s for s in shifted(rig, scene) if s.says == "readings 2 rows too early").change(scene)
    assert early.lost is not None and np.flatnonzero(early.lost).tolist() == [0, 1, 2, 7, 8]
    np.testing.assert_array_equal(early.rows.observations["x"][9:], rows.observations["x"][7:12])
    counted = replace(scene, rows=replace(rows, from_row=np.zeros(14, dtype=np.int64)))
    assert not list(shifted(rig, counted))


@pytest.mark.parametrize("kind", ["position", "targets"])
def test_points_that_were_sorted_are_put_back(kind: str, right: pd.DataFrame, tmp_path: Path) -> None:
    sensor: Document = {"type": kind, "sigma": {"xyz": 0.03}}
    names = ["x", "y", "z"]
    if kind == "targets":
        sensor["points"] = {"A": [0.0, 30.0, 0.0], "B": [10.0, -30.0, 5.0], "C": [80.0, 0.0, 20.0]}
        names = [f"{p}.{a}" for p in "ABC" for a in "xyz"]
    machine, q = document(sensor=sensor), right[list(JOINTS)][:20]
    read = truepose.simulate(truepose.load_machine(written(tmp_path, machine, q)[0]), q, seed=1)
    read = read.reset_index(drop=True)[names]
    order = np.argsort(read[names[2]].to_numpy())[::-1]
    rows = pd.concat([q, read.iloc[order].reset_index(drop=True)], axis=1)
    rig = rig_on(tmp_path, rows, machine)
    (slip,) = matched(rig, rig.scene)
    assert slip.says == f"rows sorted by {names[2]} in some of the columns only" and slip.odds == SELDOM
    assert slip.fix == "put readings and joints back into one order"
    there = slip.change(rig.scene)
    for name in names:
        np.testing.assert_allclose(there.rows.observations[name], read[name])
    files = replace(rig.scene, rows=replace(rig.scene.rows, files=("a", "b")))
    assert not list(matched(rig, files))


@pytest.mark.parametrize(("count", "fine"), [(7, False), (8, True)])
def test_eight_rows_may_be_sorted(count: int, fine: bool, right: pd.DataFrame, tmp_path: Path) -> None:
    """By equal values too, but not by one for all."""
    rows = right[:count].copy()
    rows[SEEN] = rows[SEEN].sort_values("x").to_numpy()
    rig = rig_on(tmp_path, rows)
    assert bool(list(matched(rig, rig.scene))) == fine
    equal = rig_on(tmp_path, right[:count].assign(q3=np.sort(np.arange(count) // 2)))
    assert [s.where for s in matched(equal, equal.scene)] in ([], [("q3",)])
    constant = rig_on(tmp_path, right[:count].assign(q3=5.0))
    assert not list(matched(constant, constant.scene))


def test_what_was_lost_of_a_pose_stays_lost(right: pd.DataFrame, tmp_path: Path) -> None:
    rows = right[:FEW].copy()
    rows.loc[3, "y"] = np.nan
    rows.loc[5, "rz"] = np.nan
    rig = rig_on(tmp_path, rows)
    before = np.column_stack([rig.scene.rows.observations[n] for n in SEEN])
    for slip in poses(rig, rig.scene):
        there = slip.change(rig.scene).rows.observations
        after = np.column_stack([there[n] for n in SEEN])
        np.testing.assert_array_equal(after[[3, 5]], before[[3, 5]])
        assert (after[[0, 1]] != before[[0, 1]]).any() and np.isfinite(np.delete(after, [3, 5], axis=0)).all()


WORDS = {
    "readings in m": (("x", "y", "z"), "write the unit in the header: x [m], y [m], z [m]"),
    "q1, q2 and q3 in inch": (("q1", "q2", "q3"), "write the unit in the header: q1 [inch], q2 [inch], q3 [inch]"),
    "q2 in um": (("q2",), "write the unit in the header: q2 [um]"),
    "joints in mrad": (
        ("q4", "q5", "q6", "q7"), "write the unit in the header: q4 [mrad], q5 [mrad], q6 [mrad] and 1 more",
    ),
    "q7 in rad": (("q7",), "write the unit in the header: q7 [rad]"),
    "the mechanism's lengths in cm": (("mechanism",), "write the lengths of 'mechanism' in mm"),
    "the machine file's lengths in ft": (
        ("units.length",),
        "state 'units: {length: ft}' in the machine file, and the unit in the headers of the recording",
    ),
    "alpha of the mechanism in rad": (
        ("mechanism.alpha",), "write alpha in deg (or state 'units: {angle: rad}' for the whole file)",
    ),
}  # fmt: skip


def test_units_are_told_in_words(tmp_path: Path) -> None:
    """Of three slides and four turning joints; no theta is stated, so that none can be in another unit."""
    names = [f"q{k}" for k in range(1, 8)]
    rig = rig_on(tmp_path, table([*names, "x", "y", "z"]), gantry(slides("ssstttt")))
    told = {s.says: (s.where, s.fix) for s in units(rig, rig.scene)}
    assert {text: told[text] for text in WORDS} == WORDS
    # 6 other lengths for readings, slides (all and each) and the file's two; 4 other angles for joints (all and each); alpha;
    # the whole recording in another length, or another length and angle; and all angles, those of the file among them
    assert len(told) == 6 * (1 + 1 + 3 + 2) + 4 * (1 + 4) + 2 + 6 * (1 + 4) + 1
    assert "the recording in m and rad" in told
    assert "theta of the mechanism in rad" not in told
    kinds = Counter(s.kind for s in units(rig, rig.scene))
    assert kinds == {"unit-length": 42 + 30, "unit-angle": 23}


def test_headers_that_say_a_unit_are_no_guess(tmp_path: Path) -> None:
    """Columns that say another unit may be wrong about it; in the file's new unit they go on saying theirs."""
    names = ["q1", "q2", "x", "y", "z"]
    rows = table(names).rename(columns={"x": "x [um]", "q1": "q1 [cm]"})
    rig = rig_on(tmp_path, rows, gantry(slides("ss")))
    told = {s.says: s for s in units(rig, rig.scene)}
    assert told["readings in mm"].where == ("x",)
    assert told["readings in um"].where == ("y", "z")
    assert told["readings in m"].where == ("x", "y", "z")
    there = told["readings in m"].change(rig.scene)
    seen = rig.scene.rows.observations
    np.testing.assert_allclose(there.rows.observations["x"], 1e6 * seen["x"])
    np.testing.assert_allclose(there.rows.observations["y"], 1e3 * seen["y"])
    assert there.size == pytest.approx(1e6)
    whole = told["the machine file's lengths in m"].mend(
        Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"])
    )
    assert whole.get(("units", "length")) == "m"
    assert whole.sheets[0].units == {"q1": "cm", "q2": "mm", "x": "um", "y": "mm", "z": "mm"}


def test_two_scales_of_a_drawing_multiply(right: pd.DataFrame, tmp_path: Path) -> None:
    """Of lengths and of tolerances, which do not grow where the mechanism alone was drawn too small."""
    rig = rig_on(tmp_path, right[:FEW])
    told = {s.says: s for s in file_lengths(rig, rig.scene)}
    small, large = told["the mechanism's lengths in um"], told["the mechanism's lengths in cm"]
    inch = told["the machine file's lengths in inch"]
    there = inch.change(small.change(rig.scene))
    assert (there.drawn, there.stated) == pytest.approx((25.4e-3, 25.4e-3))
    again = inch.change(large.change(inch.change(rig.scene)))
    assert (again.drawn, again.stated) == pytest.approx((25.4**2 * 10.0, 25.4**2))
    k = rig.names.index("q2.d")
    assert again.p[k] == pytest.approx(25.4**2 * 10.0 * rig.scene.p[k])
    x = rig.at["base"][0]
    assert again.p[x] == pytest.approx(25.4**2 * rig.scene.p[x])


def test_rows_in_no_order_are_not_looked_at(right: pd.DataFrame, tmp_path: Path) -> None:
    rig = rig_on(tmp_path, right[:20])
    assert not list(matched(rig, rig.scene))
    few = rig_on(tmp_path, right[:7].sort_values("x"))
    assert not list(matched(few, few.scene))
    falling = rig_on(tmp_path, right[:20].assign(q2=np.linspace(50, -70, 20)))
    assert [s.where for s in matched(falling, falling.scene)] in ([], [("q2",)])


@pytest.mark.parametrize("out", [-165.0, 175.0])
def test_readings_are_brought_back_into_an_uneven_range(
    out: float, right: pd.DataFrame, tmp_path: Path
) -> None:
    """A range of 30 to 350 deg: what stands below or above it is a turn away."""
    machine = document()
    machine["mechanism"]["joints"][3]["range"] = [30.0, 350.0]
    read = np.linspace(40, 340, 12)
    read[3] = out
    rig = rig_on(tmp_path, right[:12].assign(q4=read), machine)
    mended = offset(rig, 3, np.radians(5.0)).mend(Pair.read(tmp_path / "arm.yaml", [tmp_path / "r.csv"]))
    expected = read + 5.0
    expected[3] += 360.0 if out < 0 else 0.0
    if out > 0:  # inside as it is: nothing is out, the zero goes into the table
        assert mended.get(("mechanism", "joints", 3, "theta")) == pytest.approx(5.0)
        return
    np.testing.assert_allclose(mended.sheets[0].numbers("q4"), expected, atol=1e-9)
