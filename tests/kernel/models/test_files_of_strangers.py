"""A machine file of a stranger runs nothing, reads no other file, and is refused in one line."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from support.command import input_error
from truepose.errors import InputError
from truepose.models.builders.urdf_file import Robot
from truepose.models.file.formula import LONGEST, Formula
from truepose.models.file.yaml_document import parse_document
from truepose.models.load import load_machine
from truepose.models.units import parse_unit

RUN = "open('ran', 'w')"
FILE = """schema: truepose/machine/1
name: {name}
mechanism: {{type: serial, joints: [{{name: q1, kind: {kind}, r: {r}}}]}}
"""
USUAL = {"name": "arm", "kind": "revolute", "r": "400"}
TAGS = (
    "!!python/object/apply:os.system ['touch ran']",
    "!!python/object/new:os.system ['touch ran']",
    "!!python/name:os.system",
    "!!python/module:os",
    f'!!python/object/apply:builtins.eval ["{RUN}"]',
    "!touch ran",
)
NUMBERS = ("1" + "0" * 400, "0x" + "f" * 6000, "1:" * 200_000 + "1", "0b" + "1" * 5000, "!!binary aGVsbG8=")
ROBOT = '<robot name="a"><link name="x{}"/></robot>'
LAUGHS = "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(20))
XML = {
    "billion laughs": f'<!DOCTYPE r [<!ENTITY a0 "lol">{LAUGHS}]>' + ROBOT.format("&a20;"),
    "one long entity": f'<!DOCTYPE r [<!ENTITY a "{"x" * 100_000}">]>' + ROBOT.format("&a;" * 20_000),
    "another file": '<!DOCTYPE r [<!ENTITY e SYSTEM "secret.txt">]>' + ROBOT.format("&e;"),
    "a parameter": '<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1:9/x"> %p;]>' + ROBOT.format(""),
    "a document type": '<!DOCTYPE r SYSTEM "http://127.0.0.1:9/x">' + ROBOT.format(""),
}
FORMULAS = (
    f"__import__('os').system('touch ran') or {RUN}", RUN, f"(lambda: {RUN})()", f"[{RUN} for u in u]", f"f'{{{RUN}}}'",
    "u.__class__.__mro__", "sin.__globals__", "u if u else u", "(u := 1)", "sin(*u)", "sin(x=u)", "'u'", "9" * 999,
    "0x" + "f" * 900, "-" * 998 + "u", "(" * 490 + "u" + ")" * 490, "u" * (LONGEST + 1), "True", "1j", "...",
)  # fmt: skip


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def refused(path: Path) -> str:
    """What is said of a machine file that is not taken."""
    with pytest.raises(InputError) as caught:
        load_machine(path)
    assert not Path("ran").exists()
    return str(caught.value)


@pytest.mark.parametrize("field", USUAL)
@pytest.mark.parametrize("value", [*TAGS, *NUMBERS], ids=lambda value: value[:24])
def test_tags_that_run_code_and_numbers_without_end_are_refused(field: str, value: str) -> None:
    path = Path("arm.yaml")
    path.write_text(FILE.format(**{**USUAL, field: value}))
    said = refused(path)
    assert said.startswith("arm.yaml: ") and "\n" not in said and len(said) < 300


def test_numbers_as_large_as_they_may_be_are_read() -> None:
    assert parse_document("a: " + "9" * 250, "f") == {"a": int("9" * 250)}
    assert parse_document("a: [0o17, 0x1f, 1_000, -3]", "f")["a"] == ["0o17", "0x1f", "1_000", -3]


@pytest.mark.parametrize("opens", ["[", "{a: ", "- "])
def test_a_file_nested_without_end_is_refused(opens: str) -> None:
    with input_error("nested too deeply"):
        parse_document("a:\n  " + opens * 20_000, "arm.yaml")


@pytest.mark.parametrize("kind", XML)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_robot_description_has_no_entities(kind: str, encoding: str) -> None:
    Path("secret.txt").write_text("hidden")
    path = Path("a.urdf")
    path.write_bytes(XML[kind].encode(encoding))
    with input_error(r"^a\.urdf: found <!DOCTYPE r>, expected a URDF without") as caught:
        Robot.read(path)
    assert "hidden" not in str(caught.value)


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/stdin", "pipe", "."])
def test_a_machine_file_reads_no_device_and_no_pipe(device: str) -> None:
    import os

    if device == "pipe":
        os.mkfifo("pipe")
    path = Path("arm.yaml")
    section = f"{{type: urdf, file: '{device}', base_link: a, tip_link: b}}"
    path.write_text(f"schema: truepose/machine/1\nname: arm\nmechanism: {section}\n")
    assert "cannot read the " in refused(path)


@pytest.mark.parametrize("text", FORMULAS, ids=lambda text: text[:24])
def test_a_formula_is_arithmetic_or_nothing(text: str) -> None:
    with pytest.raises(InputError) as caught:
        Formula.read(text, ("u",), 1.0, "here")
    assert not Path("ran").exists()
    assert str(caught.value).startswith("here: ") and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    ["9**9**9**9", "u**" * 300 + "u", "sin(" * 150 + "u" + ")" * 150, "+".join("u" * 450), "1e300*1e300"],
)
def test_towers_of_powers_are_worked_out(text: str) -> None:
    made = Formula.read(text, ("u",), 1.0, "here").value({"u": ca.SX.sym("u")})
    assert made.shape == (1, 1)


@given(st.text(max_size=60) | st.text("u9*-+/().,sincoabqrt '\"_[]{}:=", max_size=80))
@example("u\x00")
@example("u\n+u")
def test_any_text_is_a_formula_or_refused_in_words(text: str) -> None:
    try:
        formula = Formula.read(text, ("u",), 1.0, "here")
    except InputError:
        return
    assert set(formula.names) <= {"u"}
    assert formula.value({"u": ca.SX.sym("u")}).shape == (1, 1)


@pytest.mark.parametrize(
    "text", ["9**9**9**9*mm", "mm**9**9**9", "mm^(9^9^9)", "mm**1e400", "(" * 2000, RUN, "().__class__"]
)
def test_a_unit_runs_nothing(text: str) -> None:
    with pytest.raises(InputError):
        parse_unit(text, "mm", "here")
    assert not Path("ran").exists()
