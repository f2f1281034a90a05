"""Large tables read and written by whole columns: the same values, cells and complaints as cell by cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from truepose.errors import InputError
from truepose.identification.recording.arrow_columns import ArrowCells
from truepose.identification.recording.table import Column, Table, read_table


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
