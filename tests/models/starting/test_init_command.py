"""What ``truepose init`` says, which names and numbers it takes, and when it asks or tries what it wrote."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from truepose.cli import app
from truepose.models.load import load_machine

TABLE = "joint,a,alpha,d,theta\n1,25,90,400,0\n2,455,0,0,0\n"


def run(*words: str, answers: str | None = None) -> Any:
    return CliRunner().invoke(app, ["init", *words], input=answers)


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("table.csv").write_text(TABLE, encoding="utf-8")


def test_the_list_has_a_line_a_machine_in_two_columns() -> None:
    told = json.loads(run("--list", "--json").stdout)
    width = max(len(name) for name in told["arms"])
    assert told["command"] == "init" and told["notes"] == []
    assert run("--list").stdout.splitlines() == [f"{n.ljust(width)}  {t}" for n, t in told["arms"].items()]


def test_the_lines_say_what_to_do_next() -> None:
    done = run("--arm", "panda", "-o", "cell.yaml")
    told = json.loads(run("--arm", "panda", "-o", "other.yaml", "--json").stdout)
    first, second, third = done.stdout.splitlines()
    assert first.startswith("cell.yaml: Franka Emika Panda")
    assert first.endswith("; the lines marked CHECK are yours to check")
    assert second == f"cell_recording.csv: one row a measured configuration, {','.join(told['columns'])}"
    assert third == "then: truepose calibrate cell.yaml cell_recording.csv -o result"
    assert (told["command"], told["files"], told["notes"]) == (
        "init",
        ["other.yaml", "other_recording.csv"],
        [],
    )
    assert done.stderr == "" and told["name"] == load_machine(Path("other.yaml")).name


@pytest.mark.parametrize(
    ("name", "taken"), [("a.yaml", True), ("a.yml", True), ("a.YAML", True), ("a.txt", False), ("a", False)]
)
def test_a_machine_file_has_its_ending(name: str, taken: bool) -> None:
    done = run("--arm", "panda", "-o", name)
    assert done.exit_code == (0 if taken else 2) and Path(name).exists() is taken
    assert taken or done.stderr == f"error: -o: found {name!r}, expected a machine file that ends in .yaml\n"


@pytest.mark.parametrize("option", ["--base", "--tool"])
@pytest.mark.parametrize(
    ("text", "taken"),
    [
        ("1,2,3", True),
        ("1,2,3,4,5,6", True),
        ("1,2", False),
        ("1,2,3,4", False),
        ("1,2,3,4,5", False),
        ("1,2,3,4,5,6,7", False),
        ("1,2,x", False),
        ("1,2,nan", False),
        ("inf,2,3", False),
        ("1e300,2,3", False),
    ],
)
def test_a_frame_is_three_numbers_or_six(option: str, text: str, taken: bool) -> None:
    done = run("--arm", "panda", option, text, "-o", "m.yaml")
    assert done.exit_code == (0 if taken else 2) and Path("m.yaml").exists() is taken
    wrong = f"error: {option}: found {text!r}, expected X,Y,Z or X,Y,Z,R,P,Y (mm and deg)\n"
    assert done.stderr == ("" if taken else wrong)


def test_what_nobody_has_tried_before_is_built_before_it_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bundled machine has been: the core that builds it takes long to load."""
    tried: list[Path] = []
    monkeypatch.setattr("truepose.models.leaves.starting.written.verify", lambda _, path: tried.append(path))
    table = ("--table", "table.csv", "--convention", "standard")
    for words, wanted in ((("--arm", "panda"), []), (table, [Path("a.yaml")])):
        assert run(*words, "-o", "a.yaml", "--force").exit_code == 0
        assert tried == wanted
