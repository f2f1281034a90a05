"""The page of commands is what the commands say."""

from __future__ import annotations

import re

import pytest
from typer.testing import CliRunner

import commands_page
from truepose.cli import app

PAGE = commands_page.PAGE.read_text(encoding="utf-8")
SECTIONS = dict(re.findall(r"^## (\S+)\n(.*?)(?=^## |\Z)", PAGE, re.DOTALL | re.MULTILINE))
FLAG = re.compile(r"(?<![\w-])(--?[a-z][a-z-]*)\b")


def test_the_page_is_up_to_date() -> None:
    """Run ``python docs/commands_page.py`` after a command or an option was added or described anew."""
    assert commands_page.page() == PAGE


@pytest.mark.parametrize("command", SECTIONS)
def test_the_options_are_those_of_the_help(command: str) -> None:
    helped = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "400"}).stdout
    options = {
        flag for line in helped.splitlines() for flag in FLAG.findall(line[:60]) if line.startswith("  -")
    }
    head = PAGE.partition("\n## ")[0]
    told = {
        flag
        for row in re.findall(r"^\| `-.*$", head + SECTIONS[command], re.MULTILINE)
        for flag in FLAG.findall(row)
    }
    assert options and options <= told


def test_every_command_has_an_example() -> None:
    offered = {info.name or getattr(info.callback, "__name__", "") for info in commands_page.offered()}
    assert offered == set(SECTIONS)
    for command, text in SECTIONS.items():
        assert f"\ntruepose {command}" in text
