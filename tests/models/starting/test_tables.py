"""Denavit-Hartenberg tables as people type them: cells, units, headers, and what is refused rather than guessed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from truepose.errors import InputError
from truepose.models.starting.cells import cell, interval
from truepose.models.starting.start import tidy
from truepose.models.starting.table import table_start


@pytest.mark.parametrize(
    ("text", "unit", "degrees"),
    [
        ("90", "", 90),
        ("-90°", "", -90),
        ("−90 º", "", -90),
        ("90 deg", "", 90),
        ("pi/2", "", 90),
        ("-π/2", "rad", -90),
        ("2*pi/3", "", 120),
        ("2pi", "deg", 360),
        ("0.5pi", "", 90),
        ("1.5708 rad", "", math.degrees(1.5708)),
        ("1.5708", "rad", math.degrees(1.5708)),
        ("1.5708", "deg", 1.5708),
        ("", "", 0),
        ("-", "", 0),
        ("1,5", "", 1.5),
        (".5", "", 0.5),
        ("1e1", "", 10),
    ],
)
def test_an_angle_is_read_as_it_is_printed(text: str, unit: str, degrees: float) -> None:
    assert cell(text, "angle", unit, "here").value == pytest.approx(degrees, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "unit", "mm"),
    [
        ("425", "", 425),
        ("0.425 m", "", 425),
        ("0.425", "m", 425),
        ("42.5cm", "", 425),
        ("-1 in", "", -25.4),
        ("7", "um", 0.007),
    ],
)
def test_a_length_is_read_as_it_is_printed(text: str, unit: str, mm: float) -> None:
    assert cell(text, "length", unit, "here").value == pytest.approx(mm)


@pytest.mark.parametrize(
    ("text", "offset"),
    [
        ("θ1", 0), ("q2", 0), ("theta_3", 0), ("θ2 - 90", -90), ("q2-90°", -90), ("θ3+pi/2", 90), ("90 + q4", 90),
        ("q5*", 0), ("-90", -90), ("+θ1", 0),
    ],
)  # fmt: skip
def test_a_joints_variable_may_stand_before_its_offset(text: str, offset: float) -> None:
    assert cell(text, "angle", "", "here", variable=True).value == pytest.approx(offset)


@given(st.floats(-400, 400))
def test_a_number_that_is_written_is_read_again(value: float) -> None:
    """With the unit said: without one some angles look like radians."""
    assert cell(repr(value), "angle", "deg", "here").value == value
    assert cell(f"q3 + {value!r}", "angle", "deg", "here", variable=True).value == value


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("-170..170", (-170, 170)), ("±170", (-170, 170)), ("+/-170°", (-170, 170)), ("-190 to 45", (-190, 45)),
        ("[-190, 45]", (-190, 45)), ("+45/-190", (-190, 45)), ("-pi..pi", (-180, 180)), ("45; -190", (-190, 45)),
    ],
)  # fmt: skip
def test_a_range_is_read_as_data_sheets_print_it(text: str, ends: tuple[float, float]) -> None:
    assert interval(text, "angle", "", "here") == pytest.approx(ends)


@pytest.mark.parametrize(
    ("text", "dimension", "variable", "message"),
    [
        ("1.5708", "angle", False, "without a unit, which looks like radians"),
        ("-3.1416", "angle", False, "without a unit, which looks like radians"),
        ("-θ1", "angle", True, "turns against its axis"),
        ("ninety", "angle", False, "expected an angle such as 90"),
        ("θ1", "angle", False, "expected an angle such as 90"),
        ("425 kg", "length", False, "expected a length such as 425"),
        ("90 mm", "angle", False, "expected an angle such as 90"),
    ],
)
def test_what_is_no_number_is_refused(text: str, dimension: str, variable: bool, message: str) -> None:
    with pytest.raises(InputError, match=f"^here: .*{message}"):
        cell(text, dimension, "", "here", variable=variable)


@pytest.mark.parametrize("text", ["170", "-170", "1..2..3", ""])
def test_what_is_no_range_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"^here: .*expected two numbers"):
        interval(text, "angle", "", "here")


SAME = [
    "joint,a [mm],alpha [deg],d [mm],theta [deg]\nq1,25,90,400,0\nq2,455,0,0,-90\n",
    "joint;a [m];alpha;d [m];theta\n1;0,025;pi/2;0,4;θ1\n2;0,455;0;0;θ2-90°\n",
    "| i | a (mm) | α (deg) | d (mm) | θ offset (deg) |\n|---|---|---|---|---|\n"
    "| 1 | 25 | 90 | 400 | 0 |\n| 2 | 455 | 0 | 0 | -90 |\n",
    "# a comment\nName\tAlpha\tA\tTheta\tD\n\nq1\t90\t25\t0\t400\nq2\t0\t455\t-90\t0\n",
    "a,alpha,d,theta,offset\n25,90,400,θ1,0\n455,0,0,θ2,-90\n",
]


@pytest.mark.parametrize("text", SAME)
def test_one_table_in_several_hands(tmp_path: Path, text: str) -> None:
    path = tmp_path / "arm.csv"
    path.write_text(text, encoding="utf-8")
    joints = tidy(table_start(path, "standard").mechanism["joints"])
    assert joints == [
        {"name": "q1", "kind": "revolute", "a": 25, "alpha": 90, "d": 400, "theta": 0},
        {"name": "q2", "kind": "revolute", "a": 455, "alpha": 0, "d": 0, "theta": -90},
    ]


def test_prismatic_joints_have_ranges_in_lengths(tmp_path: Path) -> None:
    path = tmp_path / "scara.csv"
    path.write_text(
        "name,kind,a,alpha,d,theta,min,max\nz,P,0,0,d1+100,0,0,300 mm\nturn,R,250,0,0,θ2,-130,130\n"
    )
    slide, turn = table_start(path, "standard").mechanism["joints"]
    assert (slide["kind"], slide["d"], slide["range"]) == ("prismatic", 100.0, [0.0, 300.0])
    assert (turn["name"], turn["range"]) == ("turn", [-130.0, 130.0])


def test_khalils_convention_shows_by_its_column_r(tmp_path: Path) -> None:
    path = tmp_path / "arm.csv"
    path.write_text("alpha,d,theta,r,beta\n0,0,0,400,0\n-90,25,0,0,0.1\n")
    mechanism = table_start(path, "").mechanism
    assert mechanism["convention"] == "khalil"
    assert mechanism["joints"][1]["beta"] == 0.1


@pytest.mark.parametrize(
    ("text", "convention", "message"),
    [
        ("a,alpha,d,theta\n25,90,400,0\n", "", "which two conventions share, expected --convention standard"),
        (
            "a,alpha,d,theta\n25,90,400,0\n",
            "craig",
            "--convention: found 'craig', expected one of standard, modified",
        ),
        (
            "a,alpha,d,theta\n0.025,90,0.4,0\n",
            "standard",
            "no length above 0.4 and no unit, which looks like metres",
        ),
        (
            "a,alpha,d,theta\n25,1.5708,400,0\n",
            "standard",
            "line 2, column 'alpha': found '1.5708' without a unit",
        ),
        ("a,alpha,d,theta\n25,90,x,0\n", "standard", "line 2, column 'd': found 'x', expected a length"),
        ("a,alpha,d,theta,kind\n25,90,4,0,screw\n", "standard", "column 'kind': found 'screw'"),
        ("a,alpha,d,theta,weight\n25,90,4,0,3\n", "standard", "found the column 'weight'"),
        ("a,a,d,theta\n25,90,4,0\n", "standard", "the column 'a' twice"),
        ("a [kg],alpha,d,theta\n25,90,4,0\n", "standard", "column 'a': found the unit 'kg'"),
        ("a,alpha,d,theta\n25,90,4,0,9\n", "standard", "line 2: found 5 cells, expected 4"),
        ("a,alpha,d,theta,min,max\n25,90,40,0,10,-10\n", "standard", "found the range [10.0, -10.0]"),
        ("name,a,alpha,d,theta\nq,25,90,40,0\nq,5,90,40,0\n", "standard", "found the joint 'q' twice"),
        ("a,alpha,d,theta\n", "standard", "found no rows"),
        ("", "standard", "found no header"),
        (
            "a,alpha,d,theta,range [m]\n25,90,40,0,±1\n",
            "standard",
            "column 'range': found '1', expected an angle",
        ),
    ],
)
def test_tables_are_refused_rather_than_guessed(
    tmp_path: Path, text: str, convention: str, message: str
) -> None:
    path = tmp_path / "arm.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        table_start(path, convention)
    assert message in str(caught.value)
