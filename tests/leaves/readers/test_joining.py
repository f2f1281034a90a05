"""Points beside joints by name or in order, columns under other names, what is written; and other programs' files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.command import input_error
from truepose.identification.leaves.readers.importing import frame_of, read_foreign, with_joints
from truepose.identification.leaves.readers.points import is_marked, read_points
from truepose.identification.leaves.readers.tpoint import is_tpoint, read_tpoint
from truepose.identification.leaves.readers.turns import with_rotation_vector
from truepose.identification.recording.table import (
    Column,
    Table,
    in_known_case,
    missing_column,
    table_in_memory,
)
from truepose.identification.recording.text import SI


def points(*names: str) -> Table:
    n = len(names)
    return table_in_memory({"name": list(names), "x [mm]": np.arange(n), "time": np.arange(n)}, "points")


def joints(**columns: object) -> Table:
    return table_in_memory({"q1": [10.0, 20.0, 30.0], **columns}, "joints")


@pytest.mark.parametrize("key", ["name", "Point", "TARGET"])
@pytest.mark.parametrize("head", ["", "A::Main::", "Station1/"])
def test_rows_are_joined_by_the_column_that_names_points(key: str, head: str) -> None:
    """In the order of the joints, under whole names or the last part of them."""
    found = with_joints(points(*(f"{head}P{k}" for k in range(3))), joints(**{key: ["P2", "P0", "P1"]}))
    assert found.names == ("q1", "x", "time")
    assert found.numbers("x").tolist() == [2.0, 0.0, 1.0] and found.numbers("q1").tolist() == [10, 20, 30]
    assert found.notes[-1] == f"joints: joined with points by column {key.casefold()!r}"
    assert {c.name: c.unit for c in found.columns}["x"] == "mm"


@pytest.mark.parametrize(
    ("pose", "by_name"), [([2, 0, 1], True), ([7, 8, 9], False), ([0, 0, 1], False), (["a", "b", "c"], False)]
)
def test_pose_numbers_are_names_only_where_the_points_have_the_same(
    pose: list[object], by_name: bool
) -> None:
    """They may also say what is a repeat: then rows stand in order. Either way they stay in the recording."""
    found = with_joints(points("0", "1", "2"), joints(pose=pose))
    assert found.names == ("q1", "pose", "x", "time")
    assert found.numbers("x").tolist() == ([2, 0, 1] if by_name else [0, 1, 2])
    assert found.notes[-1] == "joints: joined with points by " + ("column 'pose'" if by_name else "order")


def test_a_clock_of_the_joints_stands_for_that_of_the_points() -> None:
    """What else both have could be of either."""
    found = with_joints(points("a", "b", "c"), joints(time=[5.0, 6.0, 7.0]))
    assert found.names == ("q1", "time", "x") and found.numbers("time").tolist() == [5, 6, 7]
    with input_error("joints: column 'x': found there and in points, expected it in one"):
        with_joints(points("a", "b", "c"), joints(x=[5.0, 6.0, 7.0]))


def test_whole_numbers_are_written_whole_and_units_stand_in_headers() -> None:
    """Numbers with a unit are readings, which only happen to be whole; an empty cell stays empty."""
    table = joints(
        **{"pose": [1, 2, 3], "x [mm]": [1, 2, 3], "half": [1.0, 2.5, 3.0], "y": [1, None, 3]},
        label=list("abc"),
    )
    written = frame_of(table)
    assert list(written.columns) == ["q1", "pose", "x [mm]", "half", "y", "label"]
    kinds = [written[name].dtype.kind for name in ("q1", "pose", "x [mm]", "half", "y")]
    assert kinds == ["i", "i", "f", "f", "f"] and written["label"].tolist() == ["a", "b", "c"]
    assert np.isnan(written["y"][1])


def test_joints_of_a_bag_are_in_rad_unless_they_slide() -> None:
    columns = tuple(Column(name, SI) for name in ("q1", "d2"))
    table = Table("bag", columns, {"q1": [1.5], "d2": [2.5]}, 1)
    assert list(frame_of(table, ["d2"]).columns) == ["q1 [rad]", "d2 [m]"]
    assert list(frame_of(table).columns) == ["q1 [rad]", "d2 [rad]"]


def test_the_unit_of_a_table_is_that_of_its_points_alone(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("Name,X,y [mm],z,q1\nP1,1.5,2,3,4\n", encoding="utf-8")
    units = {c.name: c.unit for c in read_foreign(path, "table", unit="m").columns}
    assert units == {"name": None, "x": "m", "y": "mm", "z": "m", "q1": None}
    assert {c.unit for c in read_foreign(path, "table").columns} == {None, "mm"}


@pytest.mark.parametrize(
    ("written", "hint"),
    [
        ("q1_deg", "found 'q1_deg': write it 'q1 [deg]'"),
        ("Q1-rad", "found 'Q1-rad': write it 'q1 [rad]'"),
        ("q1.mm", "found 'q1.mm': write it 'q1 [mm]'"),
        ("q1/mm", "found 'q1/mm': write it 'q1 [mm]'"),
        ("q1:mm", "known: load, q1:mm"),
        ("q1[foo]", "found 'q1[foo]', whose brackets hold no unit"),
        ("q1_foo", "known: load, q1_foo"),
        ("payload", "known: load, payload"),
    ],
)
def test_a_column_that_is_not_there_may_have_its_unit_in_its_name(written: str, hint: str) -> None:
    table = table_in_memory({written: [1.0], "load": [2.0]}, "rows")
    assert str(missing_column(table, "q1", ["load"])) == f"rows: missing column 'q1'; {hint}"


def test_a_name_in_another_case_is_read_where_one_alone_is_meant() -> None:
    table = table_in_memory({"Q1": [1.0], "D2": [2.0], "d2": [3.0]}, "rows")
    found = in_known_case(table, ["q1", "d2", "q1"])
    assert found.names == ("q1", "D2", "d2") and found.notes == ("rows: read without case: 'Q1' as 'q1'",)
    assert in_known_case(found, ["q1", "Q1"]) is found  # both are known: neither is meant
    with input_error("rows: found the columns 'AB' and 'Ab', expected one column 'ab'"):
        in_known_case(table_in_memory({"AB": [1.0], "Ab": [2.0]}, "rows"), ["ab"])


@pytest.mark.parametrize("length", [0.94, 0.96, 1.04, 1.06, 1e200])
def test_a_quaternion_is_of_length_one_up_to_its_rounding(length: float) -> None:
    cells = {"qx": 0.0, "qy": 0.0, "qz": 0.5, "qw": np.sqrt(0.75)}
    table = table_in_memory({name: [length * v, v, None] for name, v in cells.items()}, "rows")
    if abs(length - 1.0) > 0.05:
        with input_error(r"row 1.*found a quaternion of length .*, expected 1"):
            with_rotation_vector(table)
    else:
        turned = with_rotation_vector(table)
        assert turned.names == ("rx", "ry", "rz") and {c.unit for c in turned.columns} == {"deg"}
        np.testing.assert_allclose(turned.readings("rz"), [60.0, 60.0, np.nan])


def test_a_rotation_vector_is_found_only_where_it_stands() -> None:
    table = table_in_memory({"rx": [1.0], "ry": [2.0], "rz": [3.0]}, "rows")
    assert with_rotation_vector(table, "vector") is table and with_rotation_vector(table) is table
    for form, wanted in (("quaternion", "qx, qy, qz and qw"), ("rpy", "roll, pitch and yaw")):
        bare = table_in_memory({"a": [1.0]}, "rows")
        with input_error(f"rows: --rotation {form}: found the columns a, expected {wanted}"):
            with_rotation_vector(bare, form)
    rpy = with_rotation_vector(table_in_memory({"rx": [0.0], "ry": [0.0], "rz": [90.0]}, "rows"), "rpy")
    np.testing.assert_allclose(rpy.readings("rz"), [90.0])


@pytest.mark.parametrize(
    "sign",
    [
        "// any",
        "A::B 1 2 3",
        "by SpatialAnalyzer",
        "! Leica",
        "! emScon",
        "T-Probe",
        "FARO",
        "P1 X -1 Y 2 Z 3",
        "cam2",
    ],
)
def test_a_point_list_is_told_by_its_signs(sign: str) -> None:
    assert is_marked(f"{sign}\n") and not is_marked("x,y,z\n1,2,3\n")


LISTS: dict[str, tuple[str, list[str], list[float]]] = {
    "no names": ("1.5 2.5 3.5\n", [""], [1.5, 2.5, 3.5]),
    "a number as a name": ("7 1.5 2.5 3.5\n", ["7"], [1.5, 2.5, 3.5]),
    "a number behind the name": ("A 7 1.5 2.5 3.5\n", ["A::7"], [1.5, 2.5, 3.5]),
    "whole coordinates and scatter": ("A 7 8 9 0.01\n", ["A"], [7, 8, 9]),
    "Fortran's exponents": ("A 1.5D2 2d0 -3.5e-1\n", ["A"], [150, 2, -0.35]),
    "a quoted name": ('"A B" 1.5 2.5 3.5\n', ["A B"], [1.5, 2.5, 3.5]),
    "decimal commas": ("A;1,5;2,5;3,5\n", ["A"], [1.5, 2.5, 3.5]),
    "headings in another order": ("Name Z X Y\nA 3.5 1.5 2.5\n", ["A"], [1.5, 2.5, 3.5]),
    "two words of a name": ("Group Name X Y Z\nG A 1.5 2.5 3.5\n", ["G::A"], [1.5, 2.5, 3.5]),
    "a heading of two numbers": ("run 1 of 2\nA 1.5 2.5 3.5\n", ["A"], [1.5, 2.5, 3.5]),
}


@pytest.mark.parametrize("case", LISTS)
def test_a_line_names_a_point_and_gives_its_place(case: str) -> None:
    text, names, place = LISTS[case]
    found = read_points(text, "points", "mm")
    assert list(found.cells["name"]) == names
    assert [found.numbers(axis)[0] for axis in "xyz"] == place


@pytest.mark.parametrize(
    ("said", "unit"),
    [("Units: Millimeters", "mm"), ("unit = inches", "inch"), ("Units length: feet", "ft"), ("units are Metre", "m"),
     ("Units in um", "um"), ("Units: deg", None), ("community mm", None)],
)  # fmt: skip
def test_a_unit_is_read_where_it_is_one_of_lengths(said: str, unit: str | None) -> None:
    found = read_points(f"! {said}\nA 1 2 3\n", "points")
    assert {c.unit for c in found.columns if c.name != "name"} == {unit or "mm"}
    assert bool(found.notes) is (unit is None)
    below = read_points(f"A 1 2 3\n! {said}\n", "points")
    assert below.notes  # too late: points were read before


@pytest.mark.parametrize(
    ("size", "fits"), [("1e12", True), ("-1e12", True), ("1.1e12", False), ("-1.1e12", False)]
)
def test_a_place_beyond_everything_is_none(size: str, fits: bool) -> None:
    text = f"\n! a comment\nA 1 {size} 3\n"
    if fits:
        assert read_points(text, "points", "mm").numbers("y").tolist() == [float(size)]
    else:
        with input_error(r"points: line 3: found '1 .* 3', expected x y z of at most 1e\+12"):
            read_points(text, "points", "mm")


def stars(hours: list[float], site: str, options: str = ": EQUAT\n", end: str = "") -> pd.DataFrame:
    """Encoders read a hundredth of a degree more in declination; sidereal time is 0 h, so that ra is minus the hour angle."""
    rows = []
    for hour in hours:
        seconds = round((-hour % 24.0) * 3600.0)
        h, m, s = seconds // 3600, seconds // 60 % 60, seconds % 60
        rows.append(f"{h} {m} {s} +20 00 00 {h} {m} {s} +20 00 36 0 0")
    table = read_tpoint("\n".join(["a caption", options + site, *rows, end]) + "\n", "stars")
    return pd.DataFrame({name: table.numbers(name) for name in table.names})


def test_stars_and_weather_stand_in_columns() -> None:
    found = stars([1.0, -2.5], "+37 30 00 2023 01 05 10.5 800.0 2000 0.5", end="END\nno star")
    np.testing.assert_allclose(found["star.ha"], [15.0, -37.5])
    np.testing.assert_allclose(found["dec"] - found["star.dec"], 0.01)
    np.testing.assert_allclose(found["q1"], -found["ha"])
    np.testing.assert_allclose(found["q2"], found["dec"])
    assert found["temperature.air"].tolist() == [10.5, 10.5]
    assert found["pressure"].tolist() == [800.0, 800.0] and found["humidity"].tolist() == [50.0, 50.0]
    np.testing.assert_allclose(np.linalg.norm(found[["x", "y", "z"]], axis=1), 1000.0)
    np.testing.assert_allclose(found["z"], 1000.0 * np.sin(np.radians(20.0)))
    np.testing.assert_allclose(
        found["y"], -1000.0 * np.cos(np.radians(20.0)) * np.sin(np.radians(found["star.ha"]))
    )


@pytest.mark.parametrize(
    ("weather", "columns"),
    [
        ("-89 401 0 0", ["temperature.air", "pressure", "humidity"]),
        ("59 1099 0 1.0", ["temperature.air", "pressure", "humidity"]),
        ("-91 399 0 1.1", []),
        ("61 1101 0 -0.1", []),
        ("10 x 0 0.5", ["temperature.air"]),
        ("10", ["temperature.air"]),
        ("", []),
    ],
)
def test_weather_is_believed_where_it_can_be(weather: str, columns: list[str]) -> None:
    found = stars([1.0], f"+37 30 00 2023 01 05 {weather}")
    assert [name for name in found if name in ("temperature.air", "pressure", "humidity")] == columns


@pytest.mark.parametrize(("count", "in_one_piece"), [(4, False), (5, True)])
def test_encoders_that_went_through_half_a_turn_do_not_jump(count: int, in_one_piece: bool) -> None:
    """As far as there are enough stars to say where the axis never was."""
    hours = [10.0, 11.0, 12.5, 13.5, 14.5][:count]
    found = stars(hours, "-00 30 00")
    steps = np.diff(found["ha"])
    assert bool(np.abs(steps).max() < 30.0) is in_one_piece
    assert np.abs(found["star.ha"]).max() <= 180.0
    np.testing.assert_allclose(np.mod(found["ha"] - np.multiply(15.0, hours) + 1.0, 360.0), 1.0, atol=1e-9)


def test_a_star_in_the_south_has_its_azimuth_there() -> None:
    """Of an altazimuth mount: on the meridian, at 90 deg less latitude plus declination."""
    found = stars([0.0], "+50 00 00", ": ALTAZ\n")
    np.testing.assert_allclose(np.abs(found["star.az"]), 180.0)
    np.testing.assert_allclose(found["star.alt"], 60.0)
    west = stars([6.0], "+00 00 00", ": ALTAZ\n")
    np.testing.assert_allclose(west["star.az"] % 360.0, 290.0)
    south = stars([0.0], "-00 30 00", ": ALTAZ\n")
    np.testing.assert_allclose(south["star.alt"], 90.0 - 20.5)


@pytest.mark.parametrize(
    ("text", "told"), [(":NODA\n", True), ("a\n : altaz x\n", True), (":NONE\n", False), ("NODA", False)]
)
def test_the_format_of_stars_is_told_by_its_options(text: str, told: bool) -> None:
    assert is_tpoint(text) is told
