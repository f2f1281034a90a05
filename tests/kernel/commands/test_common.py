"""What commands share: errors as codes, text for a reader who may be gone, and files that may be written."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest
import typer

from truepose.commands import common
from truepose.commands.common import check_file, fail, finish, note, reported, tell
from truepose.errors import ConvergenceError, InputError, TrueposeError


@pytest.mark.parametrize(
    ("error", "code"),
    [(InputError("bad\ninput"), 2), (TrueposeError("bad input"), 2), (ConvergenceError("bad input"), 3)],
)
def test_an_error_that_can_be_mended_is_a_line_and_a_code(
    error: TrueposeError, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(typer.Exit) as ended, reported():
        raise error
    assert ended.value.exit_code == code
    assert tuple(capsys.readouterr()) == ("", "error: bad input\n")


def test_other_errors_go_on_and_no_error_is_none() -> None:
    with pytest.raises(ZeroDivisionError), reported():
        raise ZeroDivisionError
    with reported():
        pass
    with pytest.raises(typer.Exit) as ended:
        fail("nothing", 7)
    assert ended.value.exit_code == 7


def test_plug_ins_are_loaded_before_anything_is_done(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    done: list[str] = []
    (tmp_path / "good.py").write_text("from pathlib import Path\nPath(__file__).with_name('seen').touch()\n")
    with reported([tmp_path / "good.py"]):
        assert (tmp_path / "seen").exists()
    with pytest.raises(typer.Exit) as ended, reported([tmp_path / "good.py", tmp_path / "none.py"]):
        done.append("work")
    assert ended.value.exit_code == 2 and done == [] and "none.py" in capsys.readouterr().err


def test_a_command_ends_with_json_alone_or_with_lines_and_notes(capsys: pytest.CaptureFixture[str]) -> None:
    finish({"rows": 1}, ["a", "b"], ["mind this"], as_json=True)
    said = capsys.readouterr()
    assert '"rows": 1' in said.out and '"mind this"' in said.out and said.err == ""
    assert said.out.endswith("}\n") and not said.out.endswith("\n\n")
    finish({"rows": 1}, ["a", "b"], ["mind this"], as_json=False)
    assert tuple(capsys.readouterr()) == ("a\nb\n", "note: mind this\n")


def test_who_reads_no_more_is_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    forgotten: list[object] = []

    def fails(*_: object, **__: object) -> None:
        raise BrokenPipeError(32, "Broken pipe")

    monkeypatch.setattr(typer, "echo", fails)
    monkeypatch.setattr(common, "forget", forgotten.append)
    note("nobody hears this")
    assert forgotten == []
    tell("text")
    assert forgotten == [sys.stdout]


def test_a_file_that_is_read_is_known_by_whatever_name(tmp_path: Path) -> None:
    for name in ("read.csv", "other.csv"):
        (tmp_path / name).write_text("rows", encoding="utf-8")
    (tmp_path / "link.csv").symlink_to("read.csv")
    (tmp_path / "hard.csv").hardlink_to(tmp_path / "read.csv")
    read = tmp_path / "read.csv"
    for name in ("read.csv", "link.csv", "hard.csv"):
        with pytest.raises(InputError, match=f"{name}: found the file .*read.csv, which is read"):
            check_file(tmp_path / name, None, tmp_path / "other.csv", read)
    check_file(tmp_path / "other.csv", None, read, tmp_path / "none.csv")
    check_file(tmp_path / "new.csv", read, None)
    check_file(tmp_path / "other.csv")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        (".", "expected a file to write, found a directory"),
        ("none/new.csv", "cannot write the file: its directory does not exist"),
        ("read.csv/new.csv", "cannot write the file: .*is no directory"),
        ("x" * 300, "cannot write the file: File name too long"),
        ("a\0b", "found no name of a file"),
    ],
)
def test_a_place_where_no_file_can_be_is_refused(name: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "read.csv").touch()
    with pytest.raises(InputError, match=said):
        check_file(tmp_path / name)
    assert os.listdir(tmp_path) == ["read.csv"]  # noqa: PTH208
