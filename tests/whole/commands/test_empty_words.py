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
        (["init", "--arm", "", "-o", "arm.yaml"], "--arm"),
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
