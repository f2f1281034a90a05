"""An empty word of the command line, as a variable that is not set leaves one, is no working directory."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from support import MACHINES
from truepose.cli import app

MACHINE = str(MACHINES / "serial.yaml")


@pytest.mark.parametrize(
    ("words", "where"),
    [
        (["export", MACHINE, "-o", ""], "-o"),
        (["export", MACHINE, "--output="], "--output"),
        (["export", MACHINE, "--output", ""], "--output"),
        (["export", "", "-o", "arm.urdf"], "arguments"),
        (["export", MACHINE, "-o", "arm.urdf", ""], "arguments"),
        (["plan", MACHINE, "--candidates=", "-n", "3"], "--candidates"),
        (["effects", ""], "arguments"),
    ],
)
def test_it_is_no_name(words: list[str], where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 2
    assert f"{where}: found an empty text, expected a name" in result.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [["--arm="], ["--arm", ""], ["--arm", "", "--tip", ""]])
def test_an_empty_word_behind_such_an_option_is_its_value(words: list[str], tmp_path: Path) -> None:
    """As one that was left out: there is no source yet, and no place for the file."""
    result = CliRunner().invoke(app, ["init", *words, "-o", str(tmp_path / "arm.yaml")])
    assert result.exit_code == 2 and "found no source of the mechanism" in result.stderr


def test_an_option_that_names_no_file_may_be_empty(tmp_path: Path) -> None:
    words = ["export", MACHINE, f"--output={tmp_path / 'arm.urdf'}", "--format", ""]
    assert "format: found export format '', expected one of" in CliRunner().invoke(app, words).stderr
