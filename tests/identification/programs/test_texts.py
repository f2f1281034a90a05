"""Pieces of programs: lines, brackets, the kind of a file, and tables of points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from support.program_robots import arms, machine_file
from truepose.errors import InputError
from truepose.identification.leaves.programs.dialects import DIALECTS, beside, dialect_of, text_of
from truepose.identification.leaves.programs.points import HEADER_MOST, Points, decimals_of
from truepose.identification.leaves.programs.program import (
    Left,
    Lines,
    Program,
    in_order,
    masked,
    numbers_in,
    parts,
    shown,
)
from truepose.models.load import load_machine
from truepose.models.machine.machine import Machine


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Machine:
    return load_machine(machine_file(tmp_path_factory.mktemp("arm"), arms()[1]))


def test_lines_end_as_on_every_system() -> None:
    text = "a\nbc\r\n\rd"
    assert [Lines(text).of(text.index(c)) for c in "abcd"] == [1, 2, 2, 4]
    assert Lines(text).of(1) == 1  # a line's end is its own


def test_pieces_of_a_text() -> None:
    text = "f(1,2),[3,{4,5}],6"
    assert [text[a:b] for a, b in parts(text, 0, len(text))] == ["f(1,2)", "[3,{4,5}]", "6"]
    assert [text[a:b] for a, b in parts(text, 2, 5)] == ["1", "2"]
    assert masked('x "a;b" ; c\ny', r";[^\n]*") == "x" + 10 * " " + "\ny"
    assert [n.text for n in numbers_in("-1.5e3 .5 7. x8", 0, 12)] == ["-1.5e3", ".5", "7."]
    assert shown(" a\n\t b ") == "a b"
    assert shown("x" * 60) == "x" * 60 and shown("x" * 61) == "x" * 57 + "..."
    one, two = Left(7, "p", "why"), Left(2, "q", "why")
    assert in_order([one, two, one]) == (two, one)


@pytest.mark.parametrize(
    ("name", "text", "dialect"),
    [
        ("a.SRC", "", "kuka"), ("a.sub", "", "kuka"), ("a.mod", "", "rapid"), ("a.modx", "", "rapid"), ("a.prg", "", "rapid"),
        ("a.sys", "", "rapid"), ("a.sysx", "", "rapid"), ("a.script", "", "urscript"), ("a.urscript", "", "urscript"),
        ("a.csv", "", None), ("a.dat", "q1,q2\n1,2\n", None), ("a.dat", "&ACCESS RVP\n", "kuka"),
        ("a.dat", "DEFDAT A\n", "kuka"), ("a.dat", "DECL POS P={X 1.5,Y 2}", "kuka"), ("a.dat", "P={A1 -3,A2 1}", "kuka"),
    ],
)  # fmt: skip
def test_the_kind_of_a_file_is_told_by_its_ending_and_its_words(
    name: str, text: str, dialect: str | None, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text)
    found = dialect_of(tmp_path / name)
    assert (found and found.name) == dialect
    assert dialect_of(tmp_path / name, "csv") is DIALECTS["csv"]


@pytest.mark.parametrize("data", [b"\xff\xfeP\0", b"\xfe\xff\0P", b"LIN\0P1"])
def test_what_is_no_text_is_refused(data: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.src").write_bytes(data)
    with pytest.raises(InputError, match="UTF-16 or binary"):
        text_of(tmp_path / "a.src")
    (tmp_path / "a.src").write_bytes(b"\xffLIN \xe9")
    assert text_of(tmp_path / "a.src") == "\xffLIN \xe9"


def test_the_file_beside_a_program_has_its_name(tmp_path: Path) -> None:
    for name in ("Job.src", "Job.DAT", "other.dat", "Job.txt"):
        (tmp_path / name).write_text(name)
    assert beside(tmp_path / "Job.src") == "Job.DAT"
    assert beside(tmp_path / "Job.DAT") == "Job.src"
    assert beside(tmp_path / "other.dat") is None
    assert beside(tmp_path / "Job.txt") is None


def values(program: Program) -> list[list[float]]:
    return [[n.value for n in target.numbers] for target in program.targets]


@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_cells_of_a_table_are_parted_by_the_mark_of_its_header(machine: Machine, mark: str) -> None:
    rows = [
        ["q6", "q1", "q2 [rad]", '"q3"', "q4", '"q5 [mrad]"', "note"],
        ["6", " 1 ", "2", '"3"', "4.5", "+5e1", "a"],
    ]
    text = "\xef\xbb\xbf# made by hand\r\n\r\n" + "\r\n".join(mark.join(row) for row in rows) + "\r\n\r\n"
    program = Points().read(text, machine)
    assert values(program) == [[1, 2, 3, 4.5, 50, 6]]
    assert [text[n.start : n.end] for n in program.targets[0].numbers] == ["1", "2", "3", "4.5", "+5e1", "6"]
    target = program.targets[0]
    assert (target.line, target.name, target.kind, target.place) == (
        4,
        "row 1",
        "joints",
        text.index("6" + mark + " 1"),
    )
    assert dict(program.joint_units) == {
        "q1": "deg",
        "q2": "rad",
        "q3": "deg",
        "q4": "deg",
        "q5": "mrad",
        "q6": "deg",
    }


def test_rows_that_lack_a_number_are_left(machine: Machine) -> None:
    text = "q1,q2,q3,q4,q5,q6\n1,2,3,4,5,6\n1,2,3,,5,6\n  # no\n1,2,3\n7,8,9,x,11,12\n0,0,0,0,0,1"
    program = Points().read(text, machine)
    assert values(program) == [[1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 0, 1]]
    assert [(t.line, t.name) for t in program.targets] == [(2, "row 1"), (7, "row 5")]
    assert [(one.line, one.what) for one in program.left] == [
        (3, "1,2,3,,5,6"),
        (5, "1,2,3"),
        (6, "7,8,9,x,11,12"),
    ]


def test_poses_of_a_table_have_its_units(machine: Machine) -> None:
    text = "x [m],y,z,rx [rad],ry,rz,q9\n1,2,3,0.5,90,0,7\n"
    program = Points().read(text, machine)
    pose = program.form.poses(np.array(values(program)))[0]
    np.testing.assert_allclose(pose[:3, 3], [1000, 2, 3])
    assert program.targets[0].kind == "pose" and not program.joint_units
    assert program.form.words == "x,y,z,rx,ry,rz in m and rad"
    assert program.form.decimals == (7, 4, 4, 7, 6, 6)


@pytest.mark.parametrize("header", ["", "# only a note\n", "x,y,z\n1,2,3\n", "q1,q2,q3,q4,q5\n"])
def test_a_table_of_nothing_is_refused(machine: Machine, header: str) -> None:
    with pytest.raises(
        InputError, match="found no line" if "," not in header else "missing column '(rx|q6)'"
    ):
        Points().read(header, machine)


def test_a_header_that_no_one_would_write_names_no_column(machine: Machine) -> None:
    for length, missing in ((HEADER_MOST, False), (HEADER_MOST + 1, True)):
        first = "q1" + " " * (length - len("q1[deg]")) + "[deg]"
        assert len(first) == length
        text = f"{first},q2,q3,q4,q5,q6\n1,2,3,4,5,6\n"
        if missing:
            with pytest.raises(InputError, match="missing column 'q1'"):
                Points().read(text, machine)
        else:
            assert values(Points().read(text, machine)) == [[1, 2, 3, 4, 5, 6]]


@pytest.mark.parametrize(
    ("unit", "kind", "decimals"),
    [("mm", "mm", 4), ("m", "mm", 7), ("um", "mm", 1), ("nm", "mm", 0), ("rad", "rad", 7), ("mrad", "rad", 4),
     ("deg", "rad", 6)],
)  # fmt: skip
def test_a_written_coordinate_is_no_coarser_than_a_tenth_of_a_micrometre(
    unit: str, kind: str, decimals: int
) -> None:
    assert decimals_of(unit, kind) == decimals
