"""Large tables read and written by whole columns: the same values, cells and complaints as cell by cell."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa  # type: ignore[import-untyped]
import pyarrow.parquet as pq  # type: ignore[import-untyped]
import pytest

from truepose.errors import InputError
from truepose.identification.compensation import path_file
from truepose.identification.compensation.path_file import csv_text
from truepose.identification.recording import plain_text, table
from truepose.identification.recording.arrow_columns import ArrowCells
from truepose.identification.recording.plain_text import read_plain_csv
from truepose.identification.recording.table import Column, Table, read_table


@pytest.fixture
def both(monkeypatch: pytest.MonkeyPatch) -> Any:
    def read(path: Path) -> Iterator[Table]:
        """As a large file, then as a small one."""
        for large in (0, 1 << 30):
            monkeypatch.setattr(table, "LARGE", large)
            yield read_table(path)

    return read


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("q1 [mm],note,q2\n1,a,2.50\n-1e-3,b c,+4\n", True),
        ("\ufeff# comment\n\nq1,note,q2\r\n 1 ,,2\r\n3,x,4\r\n", True),
        ('q1,note,q2\n1,"a, b",2\n', False),
        ("q1,note,q2\n1,a,2\n# between\n3,b,4\n", False),
        ("q1,note,q2\n\n1,a,2\n\n3,b,4\n", True),
    ],
)
def test_a_table_is_the_same_by_columns(text: str, plain: bool, tmp_path: Path, both: Any) -> None:
    assert (read_plain_csv(io.BytesIO(text.encode())) is not None) == plain
    path = tmp_path / "path.csv"
    path.write_bytes(text.encode())
    one, other = both(path)
    assert (one.file, one.columns, one.n_rows) == (other.file, other.columns, other.n_rows)
    for name in ("q1", "q2"):
        np.testing.assert_array_equal(one.numbers(name), other.numbers(name))
    assert {name: list(one.cells[name]) for name in one.names} == dict(other.cells)


@pytest.mark.parametrize(
    "text",
    [
        "q1,q2\n1,2\n3,high\n",
        "q1,q2\n1,2\n3,\n",
        "q1,q2\n1,2\n3,nan\n",
        "q1,q2\n1,2\n3,1_000\n",
        "q1,q2\n1,2\n3\n",
        "q1,q2\n1,2\n3,4,5\n",
        "q1,q1 [mm]\n1,2\n",
        "q1,q2\n",
        "",
        "q1,q2\n1,\udcff\n",
    ],
)
def test_what_is_wrong_with_a_table_is_said_the_same(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "path.csv"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    said = []
    for large in (0, 1 << 30):
        monkeypatch.setattr(table, "LARGE", large)
        with pytest.raises(InputError) as caught:
            read_table(path).numbers("q2")
        said.append(str(caught.value))
    assert said[0] == said[1]


def test_columns_of_parquet_are_what_was_written(tmp_path: Path) -> None:
    data: dict[str, Any] = {"q1": [1.5, -2.0], "count": [3, 4], "note": ["a", "b"], "hot": [True, False]}
    path = tmp_path / "path.parquet"
    pd.DataFrame(data).to_parquet(path)
    found = read_table(path)
    for name in ("q1", "count"):
        np.testing.assert_array_equal(found.numbers(name), data[name])
    assert {name: list(found.cells[name]) for name in found.names} == data
    with pytest.raises(InputError, match="row 1, column 'hot': found True, expected a finite number"):
        found.numbers("hot")


def test_columns_are_added_behind_the_others() -> None:
    found = Table("path", (Column("a"),), {"a": ["1", "2"]}, 2).with_numbers({"b": np.array([1 / 3, -0.0])})
    assert found.names == ("a", "b")
    np.testing.assert_array_equal(found.numbers("b"), [1 / 3, -0.0])
    assert list(found.cells["b"]) == [1 / 3, -0.0]


def test_cells_are_a_sequence() -> None:
    cells = ArrowCells(np.array([1.0, 2.0, 4.0]))
    assert (len(cells), cells[1], cells[-2:], cells.index(4.0), 3.0 in cells) == (
        3,
        2.0,
        [2.0, 4.0],
        2,
        False,
    )


@pytest.mark.parametrize("note", [["a", "b c", ""], ["a, b", 'say "c"', "d"]])
def test_what_is_written_reads_back_exactly(
    note: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, both: Any
) -> None:
    monkeypatch.setattr(path_file, "MANY", 0)
    values = np.array([1 / 3, -1e-17, 6.02e23])
    path = tmp_path / "commands.csv"
    path.write_text(csv_text(pd.DataFrame({"q1 [mm]": values, "note": note})))
    for found in both(path):
        np.testing.assert_array_equal(found.numbers("q1"), values)
        assert list(found.cells["note"]) == note
        assert found.columns[0].unit == "mm"


@pytest.mark.parametrize("block", [1, 7, 64, 1000])
def test_blocks_of_any_size_are_the_same_columns(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is cut where: labels, numbers, many distinct texts, no end of line at the end."""
    rows = [f"{k * 0.125},{'ab'[k % 2]},{k % 7:03d},{'' if k == 5 else k}" for k in range(600)]
    text = ("# a comment\n" + '"q1","note",pose,x\n' + "\n".join(rows)).encode()
    whole = read_plain_csv(io.BytesIO(text))
    monkeypatch.setattr(plain_text, "BLOCK", block)
    cut = read_plain_csv(io.BytesIO(text))
    assert whole is not None
    assert cut is not None
    assert cut[0] == whole[0] == ["q1", "note", "pose", "x"]
    for one, other in zip(cut[1], whole[1], strict=True):
        assert len(one) == 600
        np.testing.assert_array_equal(one.numbers(lost=True), other.numbers(lost=True))
    assert list(cut[1][1])[:3] == ["a", "b", "a"]
    assert list(cut[1][2])[8] == "001"
    assert cut[1][3].numbers() is None


def test_a_parquet_column_is_read_in_batches(tmp_path: Path) -> None:
    path, rows = tmp_path / "rows.parquet", 5000
    table = pa.table({"x": np.arange(rows) * 0.5, "label": [f"n{k}" for k in range(rows)]})
    pq.write_table(table, path, row_group_size=700)
    found = read_table(path)
    assert found.n_rows == rows
    np.testing.assert_array_equal(found.numbers("x"), np.arange(rows) * 0.5)
    assert found.texts("label")[-1] == f"n{rows - 1}"
