"""What commands print of a small machine: one JSON object or plain lines, notes beside them, nothing where they are quiet."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from support.slide_arm import TINY
from truepose.cli import app

HEATED = (
    TINY
    + "effects:\n  - {effect: thermal-expansion, place: [link1], parameters: {alpha: {value: 1.e-5, unit: 1/K}}}\n"
)
ROWS = [(x, 20 * k - 70) for k, x in enumerate((-90, -60, -20, 0, 30, 50, 80, 95))]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a machine, poses without readings, and what should be read there."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(TINY, encoding="utf-8")
    (tmp_path / "heated.yaml").write_text(HEATED, encoding="utf-8")
    table = "q1,q2\n" + "".join(f"{x},{turn}\n" for x, turn in ROWS)
    (tmp_path / "poses.csv").write_text(table, encoding="utf-8")
    assert run("simulate tiny.yaml poses.csv -o rows.csv").exit_code == 0
    return tmp_path


def run(words: str) -> Result:
    return CliRunner().invoke(app, words.split())


READINGS = ["x", "y", "z"]
JSON: dict[str, dict[str, Any]] = {
    "simulate tiny.yaml poses.csv -o out.csv": {"rows": 8, "columns": ["q1", "q2", *READINGS]},
    "predict tiny.yaml rows.csv -o out.csv": {
        "rows": 8,
        "columns": [
            *(name for axis in READINGS for name in (axis, f"{axis}.std")),
            *(f"pose.{name}" for name in ("x", "y", "z", "rx", "ry", "rz")),
        ],
    },
    "identifiability tiny.yaml poses.csv -o out.json": {"machine": "tiny", "poses": 8, "readings": 24},
    "export tiny.yaml -o out.urdf": {
        "machine": "tiny",
        "format": "urdf",
        "left_out": {},
        "lost": {"value": 0.0, "unit": "mm"},
        "frozen": {},
    },
    "plan tiny.yaml -n 4 --method random -o out.csv": {
        "machine": "tiny",
        "method": "random",
        "seed": 0,
        "poses": 4,
        "columns": ["pose", "q1", "q2"],
    },
    "plan tiny.yaml -n 4 --candidates poses.csv --seed 3 -o out.csv": {"method": "exchange", "seed": 3},
}


@pytest.mark.parametrize("words", JSON)
def test_json_is_one_object_that_names_command_and_files(words: str, folder: Path) -> None:
    """On standard output alone, with one line's end behind it."""
    result = run(f"{words} --json")
    assert result.exit_code == 0 and result.stderr == ""
    assert result.stdout.endswith("}\n") and not result.stdout.endswith("\n\n")
    told = json.loads(result.stdout)
    assert told["command"] == words.split(maxsplit=1)[0] and told["notes"] == []
    assert (
        told["files"] == [words.rsplit(maxsplit=1)[-1]] and (folder / words.rsplit(maxsplit=1)[-1]).is_file()
    )
    assert {key: told[key] for key in JSON[words]} == JSON[words]


LINES = {
    "simulate tiny.yaml poses.csv -o out.csv": "out.csv: 8 rows\n",
    "predict tiny.yaml rows.csv -o out.csv": "out.csv: 8 rows\n",
    "export tiny.yaml -o out.urdf": "out.urdf\n",
    "schema recording -o out.json": "wrote out.json\n",
}


@pytest.mark.parametrize("words", LINES)
def test_plain_lines_say_what_was_written(words: str, folder: Path) -> None:
    result = run(words)
    assert (result.exit_code, result.stdout, result.stderr) == (0, LINES[words], "")
    assert (folder / words.rsplit(maxsplit=1)[-1]).is_file()


@pytest.mark.parametrize("words", [*JSON, "identifiability tiny.yaml"])
def test_a_quiet_command_prints_nothing(words: str, folder: Path) -> None:
    """But for the JSON that was asked for."""
    assert folder.is_dir()
    assert (run(f"{words} --quiet").stdout, run(f"{words} --quiet").stderr) == ("", "")
    assert json.loads(run(f"{words} --quiet --json").stdout)["command"] == words.split(maxsplit=1)[0]


@pytest.mark.parametrize("command", ["simulate", "predict"])
def test_a_note_stands_in_the_json_or_on_standard_error(command: str, folder: Path) -> None:
    """These rows do not say how warm the link was."""
    plain = run(f"{command} heated.yaml rows.csv -o out.csv")
    assert plain.exit_code == 0 and plain.stdout == "out.csv: 8 rows\n"
    notes = json.loads(run(f"{command} heated.yaml rows.csv -o out.csv --json").stdout)["notes"]
    assert len(notes) > 0 and plain.stderr == "".join(f"note: {note}\n" for note in notes)
    assert run(f"{command} heated.yaml rows.csv -o out.csv --quiet").stderr == ""
    assert any("temperature.link1" in note for note in notes)


def test_rows_of_what_cannot_be_identified_become_a_folder_or_a_file(folder: Path) -> None:
    """As the name ends; both hold what --json prints, but for what the command adds."""
    told = json.loads(run("identifiability tiny.yaml poses.csv --json").stdout)
    assert told["files"] == [] and told["seed"] is None
    drawn = json.loads(run("identifiability tiny.yaml -n 3 --json").stdout)
    assert drawn["poses"] == 3 and drawn["seed"] is not None
    for output, file in (("found.JSON", "found.JSON"), ("found", "found/identifiability.json")):
        plain = run(f"identifiability tiny.yaml poses.csv -o {output}")
        assert plain.stdout.splitlines()[-1] == file
        held = json.loads((folder / file).read_text(encoding="utf-8"))
        assert held.pop("files") == [
            "poses.csv"
        ]  # what was looked at; printed are the files that were written
        assert held | {"command": "identifiability", "files": []} == told
    assert run("identifiability tiny.yaml poses.csv").stdout == plain.stdout.rpartition("found/")[0]


def test_a_check_mends_nothing_where_nothing_is_wrong(folder: Path) -> None:
    done = run("check tiny.yaml rows.csv --fix mended --json")
    told = json.loads(done.stdout)
    assert done.exit_code == 0 and (told["verdict"], told["files"], told["notes"]) == ("ok", [], [])
    assert not (folder / "mended").exists()
    plain = run("check tiny.yaml rows.csv --fix mended")
    assert plain.exit_code == 0 and plain.stdout.startswith("ok: ") and plain.stdout.count("\n\n") == 0
    assert not (folder / "mended").exists()


def test_a_check_writes_what_is_mended_where_it_is_asked_to(folder: Path) -> None:
    """Readings in metres where the machine file says mm; without --fix nothing is written."""
    head, *lines = (folder / "rows.csv").read_text(encoding="utf-8").splitlines()
    number = head.split(",").index("x")
    rows = [line.split(",") for line in lines]
    text = [",".join([*row[:number], *(repr(float(v) / 1e3) for v in row[number:])]) for row in rows]
    (folder / "wrong.csv").write_text("\n".join([head, *text]) + "\n", encoding="utf-8")
    before = sorted(folder.rglob("*"))
    plain = run("check tiny.yaml wrong.csv")
    assert plain.exit_code == 2 and plain.stdout.startswith("wrong: ")
    assert sorted(folder.rglob("*")) == before
    done = run("check tiny.yaml wrong.csv --fix mended --json")
    told = json.loads(done.stdout)
    assert done.exit_code == 2 and told["verdict"] == "wrong" and len(told["files"]) > 0
    assert {Path(name).parent for name in told["files"]} == {Path("mended")}
    assert all((folder / name).is_file() for name in told["files"])


def test_the_catalogue_stands_in_columns_and_one_effect_in_full() -> None:
    table = run("effects").stdout.split("\n\n")
    entries = json.loads(run("effects --json").stdout)["effects"]
    width = max(len(entry["effect"]) for entry in entries)
    assert table[0].splitlines() == [
        f"{e['effect'].ljust(width)}  {e['title']}: {e['formula']}" for e in entries
    ]
    assert table[1].startswith("truepose effects SLUG tells size")
    for entry in entries[::5]:
        one = json.loads(run(f"effects {entry['effect']} --json").stdout)
        assert one["effects"] == [entry] and isinstance(entry["look_alikes"], list)
        said = run(f"effects {entry['effect']}").stdout
        assert said == (
            f"{entry['effect']}: {entry['title']}\n  formula: {entry['formula']}\n  size: {entry['size']}\n"
            f"  looks like: {', '.join(entry['look_alikes']) or '-'}\n  told apart by: {entry['experiment'] or '-'}\n"
            f"  source: {entry['source'] or '-'}\n"
        )


def test_a_schema_is_printed_as_it_is_written(folder: Path) -> None:
    for kind in ("machine", "recording"):
        printed = run(f"schema {kind}").stdout
        assert run(f"schema {kind} -o out.json").exit_code == 0
        assert (folder / "out.json").read_text(encoding="utf-8") == printed
        assert json.loads(printed)["$schema"].endswith("2020-12/schema") and printed.endswith("}\n")
        assert not printed.endswith("\n\n")
    assert run("schema").stdout == run("schema machine").stdout != run("schema recording").stdout
