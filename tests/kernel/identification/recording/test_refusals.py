"""Recordings refused: every fault named by file, row and column."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from support.recordings import BASIC, JOINTS, SENSOR, read, refusal
from truepose.errors import InputError
from truepose.identification.recording.load import tables
from truepose.identification.recording.read import read_recording
from truepose.models.units import UnitSystem

ROW_2 = "s,r,x,rx\n10,90,1,180\n{}\n"
REFUSED = {
    "missing joint": ("r,x,rx,ss\n0,0,0,0\n", "a.csv: missing column 's'; did you mean 'ss'?"),
    "missing reading": ("s,r,x\n0,0,0\n", "a.csv: missing column 'rx'"),
    "text": (
        ROW_2.format("10,abc,1,1"),
        "a.csv: row 2 (line 3), column 'r': found 'abc', expected a finite number",
    ),
    "grouped digits": (ROW_2.format("1_0,0,1,1"), "a.csv: row 2 (line 3), column 's': found '1_0'"),
    "nan": (ROW_2.format("10,0,nan,1"), "a.csv: row 2 (line 3), column 'x': found 'nan'"),
    "infinity": (ROW_2.format("10,0,1,-inf"), "a.csv: row 2 (line 3), column 'rx': found '-inf'"),
    "empty cell": (ROW_2.format("10,,0,1"), "a.csv: row 2 (line 3), column 'r': found an empty cell"),
    "empty column": (
        "s,r,x,rx\n0,0,,0\n1,1,,0\n",
        "a.csv: column 'x': every cell is empty, expected readings",
    ),
    "short row": (ROW_2.format("10,0,1"), "a.csv: row 2 (line 3): found 3 cells, expected 4"),
    "above range": (
        ROW_2.format("105.1,0,1,1"),
        "a.csv: row 2 (line 3), column 's': found 105.1 mm, expected a value in",
    ),
    "below range": (
        ROW_2.format("10,-199,1,1"),
        "column 'r': found -199 deg, expected a value in the joint's range",
    ),
    "twice": ("s,r,x,rx,x\n0,0,0,0,0\n", "a.csv: column 'x': found twice"),
    "twice with a unit": ("s,r,x,rx,x [um]\n0,0,0,0,0\n", "a.csv: column 'x': found twice"),
    "no row": ("s,r,x,rx\n", "a.csv: found no row"),
    "nothing": ("", "a.csv: found no header"),
    "two separators": (BASIC.replace("r,x", "r;x"), "found a semicolon and a comma in the header"),
    "unknown unit": (BASIC.replace("x,rx", "x [mmm],rx"), "a.csv: column 'x': unknown unit 'mmm', expected"),
    "wrong unit": (BASIC.replace("x,rx", "x [deg],rx"), "a.csv: column 'x': unit 'deg' is an angle"),
    "plain angle": (BASIC.replace("r,x", "r [1],x"), "a.csv: column 'r': unit '1' is a plain number"),
    "role": ("s,r,x,rx,role\n0,0,0,0,test\n", "a.csv: row 1 (line 2), column 'role': found 'test', expected"),
    "no role": ("s,r,x,rx,role\n0,0,0,0,\n", "a.csv: row 1 (line 2), column 'role': found an empty cell"),
    "approach": (
        "s,r,x,rx,approach.s\n0,0,0,0,2\n",
        "a.csv: row 1 (line 2), column 'approach.s': found 2, expected -1",
    ),
    "pose": (
        "s,r,x,rx,pose\n0,0,0,0,1.5\n",
        "a.csv: row 1 (line 2), column 'pose': found 1.5, expected a whole number",
    ),
    "session": ("s,r,x,rx,session\n0,0,0,0,b\n", "a.csv: row 1 (line 2), column 'session': found 'b'"),
    "from": (
        "s,r,x,rx,pose,from\n0,0,0,0,1,1\n0,0,0,0,2,3\n0,0,0,0,3,1\n",
        "a.csv: row 2 (line 3), column 'from': found 3",
    ),
    "from without pose": ("s,r,x,rx,from\n0,0,0,0,1\n", "a.csv: missing column 'pose'"),
    "driver": ("s,r,x,rx,payload\n0,0,0,0,heavy\n", "a.csv: row 1 (line 2), column 'payload': found 'heavy'"),
    "time": ("s,r,x,rx,time\n0,0,0,0,12:30\n", "a.csv: row 1 (line 2), column 'time': found '12:30'"),
    "quotes": ('s,r,x,rx\n0,0,0,"0\n', "a.csv: cannot read the file"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_file_row_and_column(tmp_path: Path, case: str) -> None:
    text, expected = REFUSED[case]
    assert expected in refusal(tmp_path, text)


def test_comments_do_not_count_as_rows(tmp_path: Path) -> None:
    text = "# header next\ns,r,x,rx\n# first\n0,0,0,0\n\n# second\n0,0,oops,0\n"
    assert "row 2 (line 7), column 'x'" in refusal(tmp_path, text)


def test_the_fault_names_its_own_file(tmp_path: Path) -> None:
    assert "b.csv: row 1 (line 2)" in refusal(tmp_path, BASIC, "s,r,x,rx\n0,0,nan,0\n")


def test_a_range_has_five_per_cent_of_slack(tmp_path: Path) -> None:
    recording = read(tmp_path, "s,r,x,rx\n105,-197.9,0,0\n-5,197.9,0,0\n")
    assert recording.q[0, 0] == 105.0


@pytest.mark.parametrize(
    "content", [None, b"PAR1 and nothing more", b"\xff\xfes,r\n", b"s,r,x,rx\n0,0,0,\x00\n"]
)
def test_unreadable_files_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "a.csv"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.csv: "):
        read_recording(tables([path]), JOINTS, SENSOR, UnitSystem())
    with pytest.raises(InputError, match="cannot read the file"):
        read_recording(tables([tmp_path]), JOINTS, SENSOR, UnitSystem())
    with pytest.raises(InputError, match="no recording"):
        read_recording(tables([]), JOINTS, SENSOR, UnitSystem())


@pytest.mark.parametrize(
    ("column", "values", "expected"),
    [
        ("s", [1.0, None], "row 2, column 's': found an empty cell"),
        ("x", ["1", "far"], "row 2, column 'x': found 'far'"),
        ("x", [True, False], "row 1, column 'x': found True"),
        ("x", [1.0, math.inf], "row 2, column 'x': found inf"),
        ("role", ["calibration", None], "row 2, column 'role': found an empty cell"),
    ],
)
def test_parquet_is_refused_like_csv(tmp_path: Path, column: str, values: list[Any], expected: str) -> None:
    frame = pd.DataFrame({"s": [1.0, 2.0], "r": [1, 2], "x": [0.0, 0.0], "rx": [0.0, 0.0], column: values})
    frame.to_parquet(tmp_path / "a.parquet")
    with pytest.raises(InputError) as caught:
        read_recording(tables([tmp_path / "a.parquet"]), JOINTS, SENSOR, UnitSystem())
    assert str(caught.value).startswith(f"{tmp_path / 'a.parquet'}: {expected}")
