"""Denavit-Hartenberg tables as people type them: cells, units, headers, and what is refused rather than guessed."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.command import input_error, run
from truepose.models.leaves.starting.start import readings_of, tidy
from truepose.models.leaves.starting.table import cell, interval, table_start
from truepose.models.load import load_machine


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
        ("q5*", 0), ("-90", -90), ("+θ1", 0), ("θ₇ − 90", -90),
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
    with input_error(f"^here: .*{message}"):
        cell(text, dimension, "", "here", variable=variable)


@pytest.mark.parametrize("text", ["170", "-170", "1..2..3", ""])
def test_what_is_no_range_is_refused(text: str) -> None:
    with input_error(r"^here: .*expected two numbers"):
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


@pytest.mark.parametrize("column", ["a", "alpha", "d", "theta"])
def test_a_column_that_is_not_there_is_listed(tmp_path: Path, column: str) -> None:
    cells = {"a": "25", "alpha": "90", "d": "40", "theta": "30"}
    del cells[column]
    path = tmp_path / "arm.csv"
    path.write_text(f"{','.join(cells)}\n{','.join(cells.values())}\n")
    assert (
        f"CHECK columns that the table has not, all 0 here: {column}." in table_start(path, "standard").about
    )


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
        ("a,alpha,d,theta\n0.025,90,0.4,0\n", "standard", "no length above 0.4 and no unit, which looks like metres"),
        ("a,alpha,d,theta\n25,1.5708,400,0\n", "standard", "line 2, column 'alpha': found '1.5708' without a unit"),
        ("a,alpha,d,theta\n25,90,x,0\n", "standard", "line 2, column 'd': found 'x', expected a length"),
        ("a,alpha,d,theta,kind\n25,90,4,0,screw\n", "standard", "column 'kind': found 'screw'"),
        ("a,alpha,d,theta,kind\n25,90,40,q1,fixed\n", "standard", "column 'theta': found 'q1' in a fixed row"),
        ("a,alpha,d,theta,kind,range\n25,90,40,0,-,±9\n", "standard", "column 'range': found '±9' in a fixed row"),
        ("a,alpha,d,theta,weight\n25,90,4,0,3\n", "standard", "found the column 'weight'"),
        ("a,a,d,theta\n25,90,4,0\n", "standard", "the column 'a' twice"),
        ("a [kg],alpha,d,theta\n25,90,4,0\n", "standard", "column 'a': unit 'kg' is a mass, expected a length"),
        ("a,alpha,d,theta\n25,90,4,0,9\n", "standard", "line 2: found 5 cells, expected 4"),
        ("a,alpha,d,theta,min,max\n25,90,40,0,10,-10\n", "standard", "found the range [10.0, -10.0]"),
        (
            "a,alpha,d,theta\n25,90,40,q1\n5,90,40,90 - 0\n5,90,40,q1 + 90\n",
            "standard",
            "line 4, column 'theta': found the variable q1 of ",
        ),
        ("name,a,alpha,d,theta\nq,25,90,40,0\nq,5,90,40,0\n", "standard", "found the joint 'q' twice"),
        ("a,alpha,d,theta\n", "standard", "found no rows"),
        ("", "standard", "found no header"),
        ("a,alpha,d,theta,range [m]\n25,90,40,0,±1\n", "standard", "column 'range': found '1', expected an angle"),
    ],
)  # fmt: skip
def test_tables_are_refused_rather_than_guessed(
    tmp_path: Path, text: str, convention: str, message: str
) -> None:
    path = tmp_path / "arm.csv"
    path.write_text(text)
    with input_error(says=message):
        table_start(path, convention)


FRANKA = [(0, 333), (0, 0), (0, 316), (82.5, 0), (-82.5, 384), (0, 0), (88, 0)]
"""a and d, mm, as Franka publishes them; 107 more lead to the flange."""
ENDS = ["flange", "Flange", "F", "tool", "TCP", "ee", "end effector", "tool0", "hand", "8", ""]


def typed(name: str, kind: str, theta: str, last: tuple[str, str, str], *, ranged: bool = False) -> str:
    """Return the table with cells of each joint, ``{k}`` its number, and name, kind and theta of the row behind the joints."""
    rows = [(name, kind, theta, row, "±170" if ranged else "") for row in FRANKA]
    rows.append((last[0], last[1], last[2], (0, 107), ""))
    lines = [
        f"{label.format(k=k)},{own.format(k=k)},{a},{d},0,{turn.format(k=k)},{ends}"
        for k, (label, own, turn, (a, d), ends) in enumerate(rows, start=1)
    ]
    return "\n".join(["name,kind,a,d,alpha,theta,range", *lines]) + "\n"


@given(
    name=st.sampled_from(["q{k}", "Joint {k}", "A{k}", "{k}", "", "axis_{k}"]),
    said=st.sampled_from(["variable", "kind", "both", "names"]),
    theta=st.sampled_from(["{}", "{} - 90", "90 + {}"]),
    end=st.sampled_from(ENDS),
    empty=st.booleans(),
    stated=st.booleans(),
    ranged=st.booleans(),
)
def test_a_row_without_a_joint_is_not_driven(
    tmp_path_factory: pytest.TempPathFactory,
    name: str, said: str, theta: str, end: str, empty: bool, stated: bool, ranged: bool,
) -> None:  # fmt: skip
    """Seven joints, however a table says which rows they are, and a frame behind them that keeps its constants."""
    if said == "names" and not stated and (end in ("8", "") or (not name and end in ("F", "hand"))):
        stated = True  # nothing else tells such a row from a joint's
    kind = "revolute" if said in ("kind", "both") else ""
    variable = theta.format("θ{k}") if said in ("variable", "both") else "0"
    text = typed(name, kind, variable, (end, "fixed" if stated else "", "" if empty else "0"), ranged=ranged)
    path = tmp_path_factory.mktemp("table") / "panda.csv"
    path.write_text(text, encoding="utf-8")
    start = table_start(path, "modified")
    joints = start.mechanism["joints"]
    assert [joint["kind"] for joint in joints] == [*7 * ["revolute"], "fixed"]
    assert [joint["d"] for joint in joints] == [*(d for _, d in FRANKA), 107]
    assert len(readings_of(start.mechanism)) == 7
    assert stated or any("CHECK rows" in line for line in start.about)


def test_a_flange_s_row_is_a_frame_of_the_machine(tmp_path: Path) -> None:
    """In both conventions, under a name that no frame has; the recording has a column for each joint."""
    (tmp_path / "panda.csv").write_text(typed("q{k}", "", "0", ("flange", "", "0")), encoding="utf-8")
    for convention in ("standard", "modified"):
        path = tmp_path / f"{convention}.yaml"
        run("init", "--table", tmp_path / "panda.csv", "--convention", convention, "-o", path)
        machine = load_machine(path)
        assert machine.mechanism.readings == tuple(f"q{k}" for k in range(1, 8))
        assert machine.geometry["flange_frame.r"].nominal == 107
        assert "# CHECK rows that are not named as joints, and are fixed here: 'flange'." in path.read_text()


def test_a_variable_in_d_is_a_slide_s(tmp_path: Path) -> None:
    path = tmp_path / "scara.csv"
    path.write_text("a,d,alpha,theta\n300,400,0,θ1\n200,0,180,θ2\n0,d3 + 20,0,0\n0,30,0,θ4\n0,50,0,0\n")
    joints = table_start(path, "standard").mechanism["joints"]
    assert [joint["kind"] for joint in joints] == ["revolute", "revolute", "prismatic", "revolute", "fixed"]
    assert joints[2]["d"] == 20


@pytest.mark.parametrize("theta", ["0", "90", ""])
@pytest.mark.parametrize(
    "names", [("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3"), ("pan", "tilt"), ("", "", "")]
)
def test_rows_that_nothing_tells_apart_are_joints_and_listed(
    tmp_path: Path, names: tuple[str, ...], theta: str
) -> None:
    path = tmp_path / "arm.csv"
    path.write_text("\n".join(["name,a,d,alpha,theta", *(f"{name},300,0,0,{theta}" for name in names)]))
    start = table_start(path, "standard")
    assert all(joint["kind"] == "revolute" for joint in start.mechanism["joints"])
    (line,) = [line for line in start.about if "do not say whether they are driven" in line]
    assert all((repr(name) in line) == (not name[-1:].isdigit()) for name in names if name)
