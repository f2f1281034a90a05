"""Commands that apply a machine file, ``compensate`` and ``codegen``: what they refuse, pass on, write and say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from support import MACHINES
from support.calibrated_machines import calibrated
from support.command import refused, run
from truepose.errors import InputError

WORSE = "the file would leave the tool worse"
MACHINE = (MACHINES / "serial.yaml").read_text(encoding="utf-8")
SCALED = MACHINE + "effects:\n  - {effect: actuator-scale, place: [q1], parameters: {s: 1.e-3}}\n"


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
    assert refused(words) == f"error: {WORSE}\n"
    assert not Path("out.csv").exists() and not Path("out").exists()
    run(f"{words} --anyway")


def test_the_drawing_goes_with_what_is_generated(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By what differs from it the C compensates."""
    machine = calibrated("arm", tmp_path)
    assert machine.file is not None and machine.file.nominal
    heard: list[Any] = []

    def generate(*_: object, **told: object) -> list[Path]:
        heard.append(told)
        return []

    monkeypatch.setattr("truepose.codegen.c.generate", generate)
    run("codegen", "calibrated.yaml", "-o", "out")
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
        ("compensate arm.yaml job.src -o job.src", "found the program itself, expected another file"),
        ("compensate arm.yaml job.src -o out.src --at load=x", "--at load: found 'x', expected a number"),
    ],
)
def test_what_does_not_fit_is_refused(words: str, said: str) -> None:
    Path("there").mkdir()
    Path("there/leg_kin.h").touch()
    before = sorted(Path().rglob("*"))
    refused(words, said=said)
    assert sorted(Path().rglob("*")) == before
