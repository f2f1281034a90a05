"""A folder that holds another command's result, or another machine's, is not overwritten."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from support import MACHINES
from truepose.cli import app
from truepose.commands.common import DIAGNOSIS, DRIFT, FIT, check_code, check_directory, check_machine
from truepose.errors import InputError

OURS = (FIT, DIAGNOSIS, DRIFT)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


@pytest.mark.parametrize("own", OURS)
@pytest.mark.parametrize("there", OURS)
def test_each_command_keeps_to_its_own_folder(own: str, there: str, tmp_path: Path) -> None:
    (tmp_path / there).write_text(json.dumps({"machine": "arm"}), encoding="utf-8")
    if own == there:
        check_directory(tmp_path, own)
        check_machine(tmp_path, own, "arm")
        with pytest.raises(
            InputError,
            match=r"found a result of the machine 'arm', expected .* of 'leg'; nothing is overwritten",
        ):
            check_machine(tmp_path, own, "leg")
    else:
        with pytest.raises(
            InputError, match=rf"found {there}, .*; nothing is overwritten: give another folder"
        ):
            check_directory(tmp_path, own)
    check_directory(tmp_path)  # a command whose files have other names


@pytest.mark.parametrize("text", ["", "{", "[]", "{}"])
def test_what_is_no_result_stands_in_nobodys_way(text: str, tmp_path: Path) -> None:
    (tmp_path / FIT).write_text(text, encoding="utf-8")
    check_directory(tmp_path, FIT)
    check_machine(tmp_path, FIT, "arm")
    check_machine(tmp_path / "none", FIT, "arm")


def test_code_of_another_machine_stays(tmp_path: Path) -> None:
    check_code(tmp_path / "none", "arm")
    (tmp_path / "arm_kin.h").touch()
    check_code(tmp_path, "arm")
    with pytest.raises(InputError, match=r"found arm_kin\.h, another machine's code"):
        check_code(tmp_path, "leg")


@pytest.mark.parametrize("command", ["calibrate", "diagnose"])
def test_commands_refuse_before_they_work(command: str, tmp_path: Path) -> None:
    """Not even the recording is read: it is not there."""
    other = DIAGNOSIS if command == "calibrate" else FIT
    (tmp_path / other).write_text("{}", encoding="utf-8")
    result = run(command, MACHINES / "serial.yaml", tmp_path / "none.csv", "-o", tmp_path)
    assert result.exit_code == 2 and result.stdout == "" and f"found {other}" in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == [other]
