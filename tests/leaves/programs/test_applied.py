"""Commands that apply a machine file, ``compensate`` and ``codegen``: what they refuse, pass on, write and say."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from support import MACHINES
from support.calibrated_machines import calibrated
from truepose.cli import app
from truepose.codegen.features import ALL, Features
from truepose.errors import InputError
from truepose.identification.leaves.programs.command import Options

WORSE = "the file would leave the tool worse"
MACHINE = (MACHINES / "serial.yaml").read_text(encoding="utf-8")
SCALED = MACHINE + "effects:\n  - {effect: actuator-scale, place: [q1], parameters: {s: 1.e-3}}\n"


def run(words: str) -> Result:
    return CliRunner().invoke(app, words.split())


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("arm.yaml").write_text(SCALED, encoding="utf-8")
    Path("path.csv").write_text("q1,q2,q3\n0,10,20\n50,-30,40\n-100,0,-60\n", encoding="utf-8")
    for name in ("job.src", "job.script"):
        Path(name).write_text("DEF job()\nEND\n", encoding="utf-8")


@pytest.fixture
def worse(monkeypatch: pytest.MonkeyPatch) -> None:
    """No file may be applied."""

    def refuses(_: object) -> None:
        raise InputError(WORSE)

    monkeypatch.setattr("truepose.identification.report.applied_words.check_applicable", refuses)


@pytest.mark.usefixtures("worse")
@pytest.mark.parametrize("words", ["compensate arm.yaml path.csv -o out.csv", "codegen arm.yaml -o out"])
def test_a_file_that_should_not_be_applied_is_only_where_that_is_wanted(
    words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("truepose.codegen.c.generate", lambda *_, **__: [Path("out/arm_kin.c")])
    refused = run(words)
    assert (refused.exit_code, refused.stderr) == (2, f"error: {WORSE}\n")
    assert not Path("out.csv").exists() and not Path("out").exists()
    assert run(f"{words} --anyway").exit_code == 0


@pytest.mark.parametrize(
    ("options", "real", "features"),
    [
        ("", "double", ALL),
        ("--real float", "float", ALL),
        ("--features warm,p", "double", Features.of("warm,p")),
    ],
)
def test_what_is_generated_is_what_was_asked_for(
    options: str, real: str, features: Features, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[tuple[Any, Any]] = []

    def generate(*arguments: Any, **told: Any) -> list[Path]:
        heard.append((arguments, told))
        return [Path("out/b.h"), Path("out/a.c")]

    monkeypatch.setattr("truepose.codegen.c.generate", generate)
    done = run(f"codegen arm.yaml -o out {options} --json")
    told = json.loads(done.stdout)
    ((arguments, named),) = heard
    assert arguments[0].name == "arm"
    assert arguments[1:] == (Path("out"), real) and named["features"] == features
    assert named["nominal"] is None  # this one is the drawing itself
    assert told["files"] == ["out/a.c", "out/b.h"] and told["features"] == list(features.names)
    assert (told["command"], told["machine"], told["real"]) == ("codegen", "arm", real)
    assert told["notes"] == []
    lines = run(f"codegen arm.yaml -o out {options}").stdout.splitlines()
    assert lines[:2] == ["out/a.c", "out/b.h"] and any("expected error of the tool" in line for line in lines)


def test_the_drawing_goes_with_what_is_generated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By what differs from it the C compensates."""
    machine = calibrated("arm", tmp_path)
    assert machine.file is not None and machine.file.nominal
    heard: list[Any] = []

    def generate(*_: object, **told: object) -> list[Path]:
        heard.append(told)
        return []

    monkeypatch.setattr("truepose.codegen.c.generate", generate)
    assert run("codegen calibrated.yaml -o out").exit_code == 0
    assert heard[0]["nominal"] == machine.file.nominal


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("codegen arm.yaml -o out --real half", "--real: found 'half', expected 'double' or 'float'"),
        ("codegen arm.yaml -o there", "found leg_kin.h, another machine's code"),
        ("codegen arm.yaml -o path.csv", "expected a directory for the results, found the file path.csv"),
        ("compensate arm.yaml path.csv -o out.csv --base 1,2,3", "--base: found it with a table"),
        ("compensate arm.yaml path.csv -o out.csv --tool 1,2,3", "--tool: found it with a table"),
        ("compensate arm.yaml path.csv -o out.csv --frame B=1,2,3", "--frame: found it with a table"),
        ("compensate arm.yaml path.csv -o out.csv --at payload=3", "--at: found it with a table"),
        (
            "compensate arm.yaml job.src -o out.src --method first-order",
            "--method: found 'first-order' with a robot program, expected exact",
        ),
        ("compensate arm.yaml job.src -o job.src", "found the program itself, expected another file"),
        ("compensate arm.yaml job.src -o out.src --frame B", "--frame: found 'B', expected NAME=VALUE"),
        ("compensate arm.yaml job.src -o out.src --frame =1,2", "--frame: found '=1,2', expected NAME=VALUE"),
        ("compensate arm.yaml job.src -o out.src --at load=x", "--at load: found 'x', expected a number"),
    ],
)
def test_what_does_not_fit_is_refused(words: str, said: str) -> None:
    Path("there").mkdir()
    Path("there/leg_kin.h").touch()
    before = sorted(Path().rglob("*"))
    done = run(words)
    assert (done.exit_code, done.stdout) == (2, "") and said in done.stderr
    assert sorted(Path().rglob("*")) == before


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", Options(None, None, None, (), (), 5.0, 1.0)),
        ("--dialect kuka --base 1,2,3", Options("kuka", "1,2,3", None, (), (), 5.0, 1.0)),
        ("--tool 4,5 --frame A=1 --frame B=2", Options(None, None, "4,5", ["A=1", "B=2"], (), 5.0, 1.0)),
        ("--at load=3 --limit 2 --limit-angle 0.5", Options(None, None, None, (), ["load=3"], 2.0, 0.5)),
    ],
)
def test_what_is_said_of_a_program_reaches_its_correction(
    options: str, expected: Options, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[Any] = []

    def corrected(*arguments: Any) -> Any:
        heard.append(arguments)
        return {"dialect": "kuka"}, ["a line"], ["a note"]

    monkeypatch.setattr("truepose.identification.leaves.programs.command._correct_program", corrected)
    done = run(f"compensate arm.yaml job.src -o out.src {options}")
    assert (done.exit_code, done.stdout, done.stderr) == (0, "a line\n", "note: a note\n")
    ((machine, dialect, path, output, told),) = heard
    assert (machine.name, dialect.name, path, output) == ("arm", "kuka", Path("job.src"), Path("out.src"))
    assert told == expected
    summary = json.loads(run(f"compensate arm.yaml job.src -o out.src {options} --json").stdout)
    assert summary == {
        "command": "compensate",
        "dialect": "kuka",
        "files": ["out.src"],
        "notes": ["a note"],
    }


@pytest.mark.parametrize("method", ["exact", "first-order"])
def test_a_table_of_either_kind_holds_the_same_commands(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """CSV or Parquet, by its ending in whichever letters; the corrected joints are told with what they are worth."""
    frame = pd.DataFrame({"q1 [mm]": [0.5, 1.0 / 3.0], "who": ["a", "b"]})
    found = SimpleNamespace(command=None)
    at = "truepose.identification"
    heard: list[object] = []

    def solved(*_: object, **told: object) -> object:
        heard.append(told)
        return found

    monkeypatch.setattr(f"{at}.compensation.compensate.compensate", solved)
    monkeypatch.setattr(f"{at}.compensation.path_table.commands", lambda *_: frame)
    monkeypatch.setattr(
        f"{at}.compensation.path_table.check_commands", lambda *_: None
    )  # no machine to read them
    monkeypatch.setattr(f"{at}.report.compensation_words.compensation_json", lambda _: {"rows": 2})
    monkeypatch.setattr(f"{at}.report.compensation_words.compensation_lines", lambda *_: ["first"])
    for name in ("out.csv", "out.parquet", "out.PQ"):
        words = f"compensate arm.yaml path.csv -o {name} --method {method}"
        assert run(words).stdout.splitlines()[0] == "first"
        told = json.loads(run(f"{words} --json").stdout)
        assert (told["command"], told["method"]) == ("compensate", method)
        assert told["rows"] == 2 and told["files"] == [name] and "expected_pose" in told
    pd.testing.assert_frame_equal(pd.read_csv("out.csv"), frame)
    for name in ("out.parquet", "out.PQ"):
        pd.testing.assert_frame_equal(pd.read_parquet(name), frame)
    assert heard == [{"method": method}] * 6
