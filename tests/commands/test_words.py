"""What commands say beside their files: displays on a terminal, tables that cannot be written."""

from __future__ import annotations

import errno
import sys
import time
from pathlib import Path
from typing import Any, NoReturn

import pandas as pd
import pytest

from truepose.commands import progress
from truepose.errors import InputError
from truepose.files import write_table


@pytest.mark.parametrize("on_terminal", [True, False])
def test_progress_is_shown_as_a_bar_on_a_terminal_only_and_never_on_standard_output(
    on_terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for stream in (sys.stdout, sys.stderr):
        monkeypatch.setattr(stream, "isatty", lambda: on_terminal)
    monkeypatch.setattr(progress, "DELAY", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    shown = ""
    with progress.progress("calibrating") as say:
        for turn in range(15000):  # five minutes at most
            say(f"turn {turn}")
            shown += capsys.readouterr().err
            if "turn" in shown or "calibrating" in shown:
                break
            time.sleep(0.02)
    assert "calibrating" in shown or "turn" in shown
    assert ("\x1b" in shown) == on_terminal
    with progress.counted("sitting") as hear:
        for _ in range(15000):
            hear(1, 2, "case001")
            out = capsys.readouterr()
            assert out.out == ""
            if "sitting: case001" in out.err:
                return
            time.sleep(0.02)
    raise AssertionError("nothing was shown of steps that are counted")


def test_a_table_that_cannot_be_written_is_told_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> NoReturn:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(pd.DataFrame, "to_parquet", full)
    with pytest.raises(InputError, match=r"table\.parquet: cannot write the file: No space left on device"):
        write_table(tmp_path / "table.parquet", pd.DataFrame({"a": [1.0]}))
    assert not list(tmp_path.iterdir())
