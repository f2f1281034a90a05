"""What options are where they are left out, which numbers they take, and what help says of it: whatever the command."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from truepose.cli import app
from truepose.errors import InputError

COMMANDS: dict[str, Any] = dict(typer.main.get_command(app).commands)  # type: ignore[attr-defined]
POSES = "10000"
TOLD = {
    "demo": {"name": "default: telescope", "output": "default: truepose-demo"},
    "init": {},
    "check": {"machine": "required", "recordings": "required"},
    "calibrate": {
        "machine": "required",
        "recordings": "required",
        "output": "required",
        "estimator": "default: map",
        "solver": "default: gn",
    },
    "diagnose": {"machine": "required", "recordings": "required", "output": "required"},
    "identifiability": {"machine": "required", "number": f"default: 100; 1<=x<={POSES}"},
    "drift": {"machine": "required", "recordings": "required"},
    "fleet": {"folder": "required", "output": "required", "workers": "x>=0"},
    "plan": {
        "machine": "required",
        "n": f"2<=x<={POSES}; required",
        "output": "required",
        "criterion": "default: d",
        "seed": "default: 0; x>=0",
    },
    "poses": {"points": "required", "output": "required", "sigma": "required"},
    "predict": {"machine": "required", "recording": "required", "output": "required"},
    "simulate": {
        "machine": "required",
        "poses": "required",
        "output": "required",
        "seed": "default: 0; x>=0",
    },
    "compensate": {
        "machine": "required",
        "path": "required",
        "output": "required",
        "method": "default: exact",
        "limit": "default: 5.0",
        "limit_angle": "default: 1.0",
    },
    "codegen": {"machine": "required", "output": "required", "real": "default: double"},
    "export": {"machine": "required", "output": "required"},
    "effects": {},
    "schema": {"kind": "default: machine"},
    "import": {
        "file": "required",
        "output": "required",
        "form": "default: auto",
        "every": "default: 0.0; x>=0.0",
        "rotation": "default: auto",
    },
}
"""What help has in brackets behind an argument or an option: whether it must be given, else what it is, and its range."""


def bracket(command: Any, parameter: Any) -> str:
    """What stands in brackets behind its help."""
    with typer.Context(command, terminal_width=400) as ctx:
        record = parameter.get_help_record(ctx)
    found = re.search(r"\[((?:default|required|[\d.<=]*x[<>]=)[^\]]*)\]$", record[1]) if record else None
    return found[1] if found else ""


@pytest.mark.parametrize("name", COMMANDS)
def test_help_tells_what_an_option_is_where_it_is_left_out(name: str) -> None:
    """And nothing of what has no value then: brackets without one would only be read in vain."""
    command = COMMANDS[name]
    told = {p.name: bracket(command, p) for p in command.params}
    assert {key: text for key, text in told.items() if text} == TOLD[name]


WORDS = {
    "demo": "teapot",
    "init": "-o arm.txt",
    "check": "none.yaml none.csv",
    "calibrate": "none.yaml none.csv -o out",
    "diagnose": "none.yaml none.csv -o out",
    "identifiability": "none.yaml",
    "drift": "none.yaml none.csv",
    "fleet": "none -o out",
    "plan": "none.yaml -n 5 -o out.csv",
    "poses": "none.csv --sigma 1 -o out.csv",
    "predict": "none.yaml none.csv -o out.csv",
    "simulate": "none.yaml none.csv -o out.csv",
    "compensate": "none.yaml none.csv -o out.csv",
    "codegen": "none.yaml -o out",
    "export": "none.yaml -o out.urdf",
    "effects": "none",
    "schema": "-o .",
    "import": "none.csv -o out.csv",
}
"""What each needs at least, of files that are not there."""
LEFT_OUT: dict[str, dict[str, object]] = {
    "demo": {"output": Path("truepose-demo")},
    "calibrate": {"estimator": "map", "solver": "gn"},
    "identifiability": {"number": 100},
    "fleet": {"workers": 0},
    "plan": {"criterion": "d", "seed": 0},
    "simulate": {"seed": 0},
    "compensate": {"method": "exact", "limit": 5.0, "limit_angle": 1.0},
    "codegen": {"real": "double"},
    "schema": {"kind": "machine"},
    "import": {"form": "auto", "every": 0.0, "rotation": "auto"},
}
"""What options are that were left out, where they are not nothing."""


@pytest.mark.parametrize("name", WORDS)
def test_what_is_left_out_is_nothing_but_where_help_tells_otherwise(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No switch is on; and a command that is started so looks for its input before it does anything."""
    monkeypatch.chdir(tmp_path)
    command, words = COMMANDS[name], WORDS[name].split()
    with command.make_context(name, list(words)) as ctx, pytest.raises((typer.Exit, InputError)) as end:
        given = {
            p.name for p in command.params if set(p.opts) & set(words) or p.param_type_name == "argument"
        }
        left = {key: value for key, value in ctx.params.items() if key not in given or key in ("kind",)}
        usual = LEFT_OUT.get(name, {})
        assert {key: value for key, value in left.items() if value or key in usual} == usual
        assert left["quiet"] is False and set(left) >= usual.keys()
        command.invoke(ctx)
    said = capsys.readouterr()
    assert not isinstance(end.value, typer.Exit) or (end.value.exit_code == 2 and "error: " in said.err)
    assert said.out == "" and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("plan m.yaml -o p.csv -n 1", "found '1'|1 is not in the range"),
        ("plan m.yaml -o p.csv -n 10001", "10001"),
        ("plan m.yaml -o p.csv -n 2 --seed -1", "-1"),
        ("identifiability m.yaml -n 0", "0"),
        ("identifiability m.yaml -n 10001", "10001"),
        ("simulate m.yaml p.csv -o r.csv --seed -1", "-1"),
        ("fleet line -o results -j -1", "-1"),
        ("import p.csv -o r.csv --log l.csv --every -0.5", "-0.5"),
    ],
)
def test_a_number_out_of_its_range_is_refused(words: str, said: str) -> None:
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code == 2 and re.search(said, result.stderr) and "--help" in result.stderr


@pytest.mark.parametrize(
    "words",
    [
        "plan none.yaml -o p.csv -n 2 --seed 0",
        "plan none.yaml -o p.csv -n 10000",
        "identifiability none.yaml -n 1",
        "identifiability none.yaml -n 10000",
        "simulate none.yaml p.csv -o r.csv --seed 0",
    ],
)
def test_the_ends_of_a_range_belong_to_it(
    words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The command goes on, and finds that the file is not there."""
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, words.split())
    assert result.exit_code == 2 and "none.yaml: cannot read the file" in result.stderr
