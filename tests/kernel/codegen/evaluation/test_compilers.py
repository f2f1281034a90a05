"""Compilers that a user may name: arguments, rubbish, silence, and no end. The numbers come all the same, with one note."""

from __future__ import annotations

import logging
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.engines import compile_all
from support.generated_c import COMPILER, needs_compiler
from truepose.codegen.evaluation import batch, compiled
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.codegen.evaluation.compiled import NotCompiledError, load

SOURCE = "int three(void);\nint three(void) { return 3; }\n"
LAST = 'for last in "$@"; do :; done\n'
"""The library's path is the last argument."""


@pytest.fixture(autouse=True)
def _all_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    compile_all(monkeypatch)
    batch.log_once.cache_clear()


def named(folder: Path, script: str) -> Path:
    """A program that does what a script of the shell says."""
    path = folder / "my-cc"
    path.write_text(f"#!/bin/sh\n{script}")
    path.chmod(0o755)
    return path


def said(text: str = SOURCE, function: str = "three") -> str:
    with pytest.raises(NotCompiledError) as caught:
        load(text, [function])
    line = str(caught.value)
    assert line.isprintable() and len(line) < 400
    return line


BROKEN = {
    "no utf-8 in its errors": (
        "printf 'x.c:1: error: \\377\\033[2J' >&2; exit 1\n",
        "error: \ufffd?[2J",
    ),
    "rubbish": (f'{LAST}echo rubbish > "$last"\n', "cannot be loaded"),
    "nothing": ("exit 0\n", "cannot be loaded"),
    "killed": ("kill -9 $$\n", "exit code -9"),
    "no end": ("exec sleep 600\n", "found no end after 0 s"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_compiler_makes_one_note_and_the_numbers_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, kind: str
) -> None:
    script, words = BROKEN[kind]
    if kind == "no end":
        monkeypatch.setattr(compiled, "SECONDS", 0.2)
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, script)))
    x = ca.SX.sym("x")
    with caplog.at_level(logging.WARNING):
        for k in range(2):
            function = BatchFunction("f", [x], [ca.sin(x) + k], rows=1)
            np.testing.assert_allclose(function(np.ones((5, 1)))[0].ravel(), np.sin(1.0) + k)
            assert function.engine.missed
    (record,) = caplog.records
    assert words in record.getMessage() and "my-cc" in record.getMessage()
    assert record.getMessage().isprintable()


@needs_compiler
def test_arguments_reach_the_compiler_and_tell_libraries_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "int three(void);\nint three(void) { return X; }\n"
    for value in (3, 4, 3):
        monkeypatch.setenv("TRUEPOSE_CC", f"{COMPILER} -DX={value}")
        assert load(text, ["three"]).three() == value


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("gcc '-m64", "expected a compiler and its arguments"),
        ("no-such-cc -m64", r"found no C compiler \(no-such-cc\)"),
        ("FOLDER", "found no C compiler"),
        ("   ", "TRUEPOSE_CC is empty"),
    ],
)
def test_what_is_no_compiler_is_refused_in_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str, words: str
) -> None:
    monkeypatch.setenv("TRUEPOSE_CC", asked.replace("FOLDER", str(tmp_path)))
    with pytest.raises(NotCompiledError, match=words):
        load(SOURCE)


@needs_compiler
def test_a_library_of_something_else_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = tmp_path / "other.c"
    other.write_text("int four(void);\nint four(void) { return 4; }\n")
    script = f'{LAST}exec {COMPILER} -shared -fPIC {other} -o "$last"\n'
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, script)))
    assert "it has no function three" in said()
