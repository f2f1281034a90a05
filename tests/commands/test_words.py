"""Tables that cannot be written."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any, NoReturn

import pandas as pd
import pytest

from truepose.errors import InputError
from truepose.files import write_table


def test_a_table_that_cannot_be_written_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(InputError, match=r"table\.parquet: cannot write the file: No space left on device"):
        write_table(tmp_path / "table.parquet", pd.DataFrame({"a": [1.0]}))
    assert not list(tmp_path.iterdir())
