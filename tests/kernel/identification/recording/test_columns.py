"""Large tables read and written by whole columns: the same values, cells and complaints as cell by cell."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from truepose.errors import InputError
from truepose.identification.recording.table import read_table


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
