"""``truepose import``: a heading is believed; where it does not say which columns are x, y and z, it is asked for them."""

from __future__ import annotations

import re
import shlex
import string
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from support.command import input_error, refused, run
from support.examples import examples
from support.skips import NOTHING_BESIDE, SHARED
from truepose.cli import app
from truepose.identification.leaves.readers.importing import read_foreign
from truepose.identification.recording.table import Table, read_table

SEPARATORS = st.sampled_from([",", ";", "\t", " "])
NUMBER = st.floats(-2000, 2000).map(lambda value: round(value, 3) + 0.0005)
OTHERS = ["J1", "J2", "joint_3", "q4", "A5", "Hz", "V", "payload", "rx", "temperature.air", "/js/position[0]"]
TRIPLES = ["TCP{}", "p{}", "tool_{}_act", "/tracker/pose/position/{}", "{} Coordinate", "Marker.{}"]


@st.composite
def tables(draw: st.DrawFn, axes: tuple[str, ...]) -> tuple[list[str], str, np.ndarray]:
    """Names with the ``axes`` among others, in any order; the text; its numbers."""
    names = draw(st.permutations([*axes, *draw(st.lists(st.sampled_from(OTHERS), min_size=1, unique=True))]))
    separator = draw(SEPARATORS.filter(lambda s: s != " " or " " not in "".join(axes)))
    rows = draw(st.lists(st.lists(NUMBER, min_size=len(names), max_size=len(names)), min_size=2, max_size=4))
    lines = [names, *([f"{value:.4f}" for value in row] for row in rows)]
    return list(names), "\n".join(separator.join(line) for line in lines), np.array(rows)


@settings(max_examples=examples(30), deadline=None)
@given(data=st.data(), triple=st.sampled_from(TRIPLES), upper=st.booleans())
def test_what_a_heading_does_not_say_is_asked_with_a_line_to_copy(
    data: st.DataObject, triple: str, upper: bool
) -> None:
    axes = tuple(triple.format(axis.upper() if upper else axis) for axis in "xyz")
    if axes[0] == "Marker.x":
        return  # columns of a sensor called Marker
    names, text, values = data.draw(tables(axes))
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "log.csv", Path(folder) / "recording.csv"
        path.write_text(text)
        said = refused("import", path, "-o", out)
        assert not out.exists()
        assert all(repr(name) in said for name in names)
        run("import", path, "-o", out, *shlex.split(said.partition("say which they are: ")[2]))
        found = read_table(out)
        for axis, name in zip("xyz", axes, strict=True):
            np.testing.assert_allclose(found.numbers(axis), values[:, names.index(name)], atol=6e-5)


@settings(max_examples=examples(30), deadline=None)
@given(
    data=st.data(),
    unit=st.sampled_from(["mm", "m", "in", "um"]),
    form=st.sampled_from(["{} [{}]", "{}[{}]", "{} ({})", "{}_{}", "{}/{}"]),
    upper=st.booleans(),
)
def test_a_heading_that_says_x_y_and_z_is_believed(
    data: st.DataObject, unit: str, form: str, upper: bool
) -> None:
    """Wherever they stand among the others, joints stay joints, and lengths are in their units."""
    axes = tuple(form.format(axis.upper() if upper else axis, unit) for axis in "xyz")
    names, text, values = data.draw(tables(axes))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        path.write_text(text)
        found = read_foreign(path)
        for axis, name in zip("xyz", axes, strict=True):
            np.testing.assert_allclose(found.numbers(axis), values[:, names.index(name)], atol=6e-5)
            assert found.unit(axis, "none", "mm") == unit
        for name in set(names) - set(axes):
            np.testing.assert_allclose(found.numbers(name), values[:, names.index(name)], atol=6e-5)


@pytest.mark.parametrize("unit", ["deg", "rad", "mrad", "DEG"])
@pytest.mark.parametrize(
    "text",
    [
        "name,x [{0}],y [{0}],z [{0}]\nP1,1,2,3\n",
        "x_{0};y_{0};z_{0}\n1,5;2,5;3,5\n",
        "! Leica\nPointId;X [{0}];Y [{0}];Z [{0}]\nP1;1;2;3\n",
        "Point;X;Y;Z\n;{0};{0};{0}\nP1;1;2;3\n",
    ],
)
def test_angles_are_never_taken_for_lengths(tmp_path: Path, unit: str, text: str) -> None:
    with input_error(r"log\.txt: column 'x'.*is an angle, expected a length"):
        foreign(tmp_path, text.format(unit))


ASKED = {
    "angles of a tracker": "Point Hz V D\nP1 12.1 88.2 1.5\n",
    "the same of a list": "! Leica AT960\nPointId;Hz [deg];V [deg];D [m]\nP1;12,1;88,2;1,5\n",
    "a comment above": "# q1 q2 q3 q4\n0.1 0.2 0.3 100.5\n",
    "a comment of a list": "// SpatialAnalyzer\n// Collection, Group, Point, Hz, V, D\nA, Main, P1, 12.1, 88.2, 1.5\n",
    "another language": "Punkt Rechts Hoch Hoehe\nP1 1.5 2.5 3.5\n",
    "indices": "pose[0],pose[1],pose[2]\n1,2,3\n",
    "numbers without a heading": "0.5 1.5 2.5 3.5 4.5 5.5\n",
    "a name and many numbers": "P1 10.1 20.2 30.3 40.4 50.5 60.6\n",
}


@pytest.mark.parametrize("case", ASKED)
def test_nothing_is_guessed(tmp_path: Path, case: str) -> None:
    (tmp_path / "log.txt").write_text(ASKED[case])
    said = refused("import", tmp_path / "log.txt", "-o", tmp_path / "out.csv", said="--columns x=")
    assert not (tmp_path / "out.csv").exists()
    assert re.search(r"log\.txt: line \d: found (the columns '|\d+ columns without)", said)


@given(name=st.text(string.ascii_letters, min_size=1, max_size=6), extra=st.integers(0, 2))
def test_columns_without_a_heading_are_chosen_by_number(name: str, extra: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.txt"
        numbers = " ".join(f"{k}.5" for k in range(6 + extra))
        path.write_text(f"{name} {numbers}\n{name}b {numbers}\n")
        found = read_foreign(path, columns="x=4,y=3,z=7")
        assert [found.numbers(axis)[0] for axis in "xyz"] == [2.5, 1.5, 5.5]


def test_points_of_one_name_are_chosen_by_number(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("Trajectories\nFrame,X,Y,Z,X,Y,Z\n,mm,mm,mm,mm,mm,mm\n1,1.5,2.5,3.5,4.5,5.5,6.5\n")
    with input_error(r"expected x, y and z once each; say which .*: --columns x=N,y=N,z=N"):
        read_foreign(path)
    found = read_foreign(path, columns="x=5,y=6,z=7", unit="mm")
    assert [found.numbers(axis)[0] for axis in "xyz"] == [4.5, 5.5, 6.5]


def test_a_file_of_columns_is_asked_about_too(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    pd.DataFrame({"J1": [1.0], "TCPX": [2.0], "TCPY": [3.0], "TCPZ": [4.0]}).to_parquet(path)
    with input_error(r"found the columns 'J1', 'TCPX'.*--columns x=TCPX,y=TCPY,z=TCPZ"):
        read_foreign(path)
    assert read_foreign(path, columns="x=TCPX,y=TCPY,z=TCPZ").names == ("J1", "x", "y", "z")
    assert read_foreign(path, "table").names == ("J1", "TCPX", "TCPY", "TCPZ")


def foreign(folder: Path, text: str) -> Table:
    (folder / "log.txt").write_text(text)
    return read_foreign(folder / "log.txt")


@pytest.mark.parametrize(
    ("text", "units"),
    [
        ("Point;X;Y;Z;Rms\n;m;mm;m;mm\nP1;1;2;3;0.1\n", ["m", "mm", "m"]),
        ("! Leica\nName X[mm] Y[mm] Z[mm] D[m]\nP1 1 2 3 0.1\n", ["mm"] * 3),
    ],
    ids=["below its name", "of its own column"],
)
def test_each_axis_has_its_unit(tmp_path: Path, text: str, units: list[str]) -> None:
    assert [foreign(tmp_path, text).unit(axis, "none", "mm") for axis in "xyz"] == units


def test_names_of_several_words_move_nothing(tmp_path: Path) -> None:
    found = foreign(tmp_path, "! Leica\nPoint X Y Z\nLeft side 1.5 2.5 3.5\n")
    assert [found.numbers(axis)[0] for axis in "xyz"] == [1.5, 2.5, 3.5]
    with input_error(r"line 3: found 'Group 1 1.5 2.5 3.5', expected 4 cells"):
        foreign(tmp_path, "! Leica\nPoint X Y Z\nGroup 1 1.5 2.5 3.5\n")


def test_joints_in_a_comment_above_stay_joints(tmp_path: Path) -> None:
    found = foreign(tmp_path, "# q1 q2 x y z\n0.1 0.2 100.5 200.5 300.5\n")
    assert found.names == ("q1", "q2", "x", "y", "z") and found.numbers("q2")[0] == 0.2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("/PROG  TEST\n/ATTR\n/MN\n   1:J P[1] 100% FINE ;\n/POS\n", "a FANUC TP program"),
        ("MODULE Main\n  PROC main()\n  ENDPROC\nENDMODULE\n", "an ABB RAPID program"),
        ('<?xml version="1.0"?>\n<robot name="a"/>\n', "XML"),
    ],
)
def test_other_languages_are_called_what_they_are(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "what.txt"
    path.write_text(text)
    for read in (read_table, read_foreign):
        with input_error(rf"what\.txt: found {said}.*expected a table"):
            read(path)


def imported(path: Path, out: Path, *options: str) -> Result:
    return CliRunner().invoke(app, ["import", str(path), "-o", str(out), *options])


@pytest.mark.parametrize("name", ["rec_quat_wxyz.csv", "robotlog.csv", "pj.csv"])
def test_tables_from_outside_are_asked_about(tmp_path: Path, name: str) -> None:
    path = SHARED / "cases/import-headings" / name
    if not path.is_file():
        pytest.skip(NOTHING_BESIDE)
    asked = imported(path, tmp_path / "out.csv")
    assert asked.exit_code == 2
    line = shlex.split(" ".join(asked.stderr.split()).partition("say which they are: ")[2])
    assert imported(path, tmp_path / "out.csv", *line).exit_code == 0


def test_each_axis_has_the_unit_of_its_own_column(tmp_path: Path) -> None:
    (tmp_path / "log.txt").write_text("! Leica\nName X[mm] Y[mm] Z[mm] D[m]\nP1 1 2 3 0.1\n")
    assert {read_foreign(tmp_path / "log.txt").unit(axis, "none", "mm") for axis in "xyz"} == {"mm"}
