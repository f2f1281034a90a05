"""The same rows by any format are the same recording; what could be read in two ways is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import truepose
from support.command import input_error
from support.examples import examples
from support.machine_texts import machine_from
from support.recordings import BASIC, JOINTS, SENSOR, read, refusal
from support.workbook import write_workbook
from truepose.identification.recording.load import as_recording, load_recording, tables
from truepose.identification.recording.read import read_recording
from truepose.identification.recording.recording import Recording
from truepose.models.units import UnitSystem

VALUES = st.floats(-99.0, 99.0, allow_nan=False).map(lambda v: v + 0.0)
ROWS = st.lists(
    st.tuples(
        VALUES, VALUES, st.one_of(st.none(), VALUES), VALUES, st.sampled_from(["calibration", "validation"])
    ),
    min_size=2,
    max_size=8,
).filter(lambda rows: any(row[2] is not None for row in rows))
HEADERS = ("s [mm]", "r", "x", "rx [rad]", "role")
Write = Callable[[Path, pd.DataFrame], Any]


def _text(separator: str, decimal: str = ".", encoding: str = "utf-8", start: str = "") -> Write:
    def write(path: Path, frame: pd.DataFrame) -> Path:
        text = start + frame.to_csv(index=False, sep=separator, decimal=decimal, lineterminator="\n")
        path.write_bytes(text.encode(encoding))
        return path

    return write


def _workbook(path: Path, frame: pd.DataFrame) -> Path:
    pytest.importorskip("python_calamine")
    cells = frame.astype(object).where(frame.notna(), None).to_numpy().tolist()
    write_workbook(path, {"notes": [], "rows": [["# made by hand"], [], list(frame.columns), *cells]})
    return path


def _spaces(path: Path, frame: pd.DataFrame) -> Path:
    """Columns of one width; a lost reading cannot be told by spaces, so it is quoted nowhere: not among these."""
    path.write_text(frame.to_string(index=False) + "\n", encoding="utf-8")
    return path


def _parquet(path: Path, frame: pd.DataFrame) -> Path:
    frame.to_parquet(path, index=False)
    return path


FORMATS: dict[str, Write] = {
    "semicolons": _text(";"),
    "semicolons and decimal commas": _text(";", ","),
    "a tab": _text("\t"),
    "a tab and decimal commas": _text("\t", ","),
    "quoted decimal commas": _text(",", ","),
    "UTF-8 with a mark": _text(",", encoding="utf-8-sig"),
    "UTF-16": _text("\t", ",", encoding="utf-16"),
    "UTF-16 without a mark": _text(";", encoding="utf-16-le"),
    "Latin-1": _text(";", encoding="latin-1", start="# Prüfstand, 20 °C\n"),
    "a spreadsheet's own": _text(";", ",", start="sep=;\n"),
    "a workbook": _workbook,
    "Parquet": _parquet,
    "a DataFrame": lambda _, frame: frame,
    "a dict": lambda _, frame: {name: frame[name].tolist() for name in frame},
}


def _load(source: Any) -> Recording:
    return read_recording(tables(source), JOINTS, SENSOR, UnitSystem())


def _same(one: Recording, other: Recording) -> None:
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.validation, other.validation)
    for name in SENSOR:
        np.testing.assert_array_equal(one.observations[name], other.observations[name])


def _frame(rows: list[tuple[Any, ...]]) -> pd.DataFrame:
    frame = pd.DataFrame(rows, columns=list(HEADERS))
    return frame.assign(**{"s [mm]": frame["s [mm]"].abs(), "x": frame["x"].astype(float)})


@pytest.mark.parametrize("form", FORMATS)
@settings(max_examples=examples(12), deadline=None)
@given(rows=ROWS)
def test_the_same_rows_are_the_same_recording(
    tmp_path_factory: pytest.TempPathFactory, form: str, rows: list[tuple[Any, ...]]
) -> None:
    folder, frame = tmp_path_factory.mktemp("rows"), _frame(rows)
    frame["x"] += 0.5  # one number with another count of decimals than three: commas are no thousands
    plain = _load(_text(",")(folder / "plain.csv", frame))
    _same(_load(FORMATS[form](folder / "rows.dat", frame)), plain)


@settings(max_examples=examples(12), deadline=None)
@given(rows=ROWS)
def test_spaces_stand_between_columns(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[Any, ...]]
) -> None:
    folder, frame = tmp_path_factory.mktemp("rows"), _frame(rows).fillna(1.0).round(6)
    _same(_load(_spaces(folder / "rows.txt", frame)), _load(_text(",")(folder / "plain.csv", frame)))


AMBIGUOUS = {
    "both decimal marks": ("s;r;x;rx\n1,5;2;3.5;4\n", "found '1,5' in row 1 (line 2), column 's' and '3.5' in row 1"),
    "thousands": ("s\tr\tx\trx\n1,500\t2\t3\t4\n", "the comma may mark decimals or thousands"),
    "decimal commas among commas": ("s,r,x,rx\n1,5,2,5,3,5,4,5\n", "found 8 cells, expected 4; decimal commas need"),
    "two separators": ("s;r,x;rx\n1;2,3;4\n", "found a semicolon and a comma in the header"),
    "spaces in some rows": ("s r x rx\n1 2 3 4\n1 2 3\n", "row 2 (line 3): found 3 cells, expected 4"),
}  # fmt: skip


@pytest.mark.parametrize("case", AMBIGUOUS)
def test_what_could_be_read_in_two_ways_is_refused(tmp_path: Path, case: str) -> None:
    text, expected = AMBIGUOUS[case]
    assert expected in refusal(tmp_path, text)


def test_a_workbook_has_one_sheet_with_data_and_its_rows_are_lines(tmp_path: Path) -> None:
    pytest.importorskip("python_calamine")
    path = tmp_path / "book.xlsx"
    rows: list[list[object]] = [[*BASIC.splitlines()[0].split(",")], [], [1.0, 2.0, "far", 4.0]]
    write_workbook(path, {"rows": rows})
    with input_error(r"book\.xlsx: row 1 \(line 3\), column 'x': found 'far'"):
        _load(path)
    write_workbook(path, {"rows": rows, "more": rows})
    with input_error("found sheets with data: 'rows', 'more'; expected one"):
        _load(path)
    path.write_bytes(path.read_bytes()[:200])
    with input_error("no Excel workbook"):
        _load(path)


def test_a_gantry_may_have_x_twice(tmp_path: Path) -> None:
    """Joint X and reading x: case tells them apart."""
    joints = (type(JOINTS[0])("X", "mm"),)
    found = read(tmp_path, "X,x\n1,2\n", joints=joints, sensor={"x": "mm"})
    np.testing.assert_array_equal((found.q[0, 0], found.observations["x"][0]), (1.0, 2.0))
    assert "missing column 'X'" in refusal(tmp_path, "x\n2\n", joints=joints, sensor={"x": "mm"})


@given(
    name=st.from_regex(r"[a-z/_.]{1,12}", fullmatch=True),
    index=st.from_regex(r"[0-9]{1,3}(,[0-9]{1,2})?", fullmatch=True),
)
def test_an_index_in_brackets_is_a_part_of_the_name(name: str, index: str) -> None:
    """A unit stands in brackets that hold one, or behind a space."""
    headers = [f"{name}[{index}]", f"{name}a [{index}]", f"{name}b[um]", f"{name}c (deg)"]
    found = tables(pd.DataFrame({header: [1.0] for header in headers}))[0]
    assert [(c.name, c.unit) for c in found.columns] == [
        (headers[0], None), (f"{name}a", index), (f"{name}b", "um"), (f"{name}c", "deg")
    ]  # fmt: skip


def test_units_may_stand_in_round_brackets(tmp_path: Path) -> None:
    found = read(tmp_path, "s (m),r,x (um),rx,x (raw)\n0.01,0,5,6,7\n")
    assert (found.q[0, 0], found.observations["x"][0]) == pytest.approx((10.0, 0.005))
    assert found.notes == (f"{tmp_path / 'a.csv'}: ignored columns that mean nothing here: 'x (raw)'",)


ARM = """
schema: truepose/machine/1
name: arm
mechanism: {type: serial, joints: [{name: q1, kind: revolute}, {name: q2, kind: revolute, d: 300, alpha: 90}]}
frames: {tool: {in: flange, xyz: [200, 0, 0]}}
tolerances: {length: 0.1, angle: 0.1}
sensor: {type: position, sigma: {xyz: 0.01}}
"""


def test_anything_that_is_a_recording_is_taken_by_the_public_functions(tmp_path: Path) -> None:
    machine = machine_from(tmp_path, ARM, "arm")
    rng = np.random.default_rng(1)
    joints = {name: rng.uniform(-90, 90, 12) for name in ("q1", "q2")}
    rows = pd.concat([pd.DataFrame(joints), truepose.simulate(machine, joints, seed=2)], axis=1)
    file = tmp_path / "r.csv"
    rows.to_csv(file, index=False)
    kept = truepose.load_recording(machine, rows)
    assert as_recording(machine, kept) is kept
    as_dict: dict[str, list[float]] = {str(name): values.tolist() for name, values in rows.items()}
    fits = [truepose.estimate(machine, s).p for s in (kept, rows, as_dict, str(file), file, [file])]
    for p in fits:
        np.testing.assert_array_equal(p, fits[0])
    assert truepose.calibrate(machine, str(file)).fit.used.sum() == 12
    pd.testing.assert_frame_equal(truepose.predict(machine, rows), truepose.predict(machine, file))
    both = load_recording(machine, [rows, str(file)])
    assert both.files == ("DataFrame 1", str(file))
    arrow = pytest.importorskip("pyarrow").Table.from_pandas(rows)
    np.testing.assert_array_equal(load_recording(machine, arrow).q, kept.q)


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        (3.0, "recording: found float, expected a path, a DataFrame, a dict of columns"),
        ([3.0], "recording: found float, expected a path"),
        ([], "found no recording"),
        ({"s": [1.0], "r": [1.0, 2.0], "x": [0.0], "rx": [0.0]}, "dict: found 1 values in 's' and 2 in 'r'"),
        ({"s": 1.0}, "dict: column 's': expected a sequence of values"),
        (pd.DataFrame({1: [0.0]}), "DataFrame: found the column 1, expected names that are texts"),
        (pd.DataFrame({"s": [math.nan], "r": [1.0], "x": [0.0], "rx": [0.0]}), "DataFrame: row 1, column 's': found"),
        (pd.DataFrame({"s": ["1", 2.0], "r": [1, 2], "x": [True, 2], "rx": [0.0, 1]}), "column 'x': found True"),
    ],
)  # fmt: skip
def test_what_is_no_recording_is_refused(source: Any, expected: str) -> None:
    with input_error(expected):
        _load(source)
