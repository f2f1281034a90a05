"""Compilers that a user may name: arguments, rubbish, silence, and no end. The numbers come all the same, with one note."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.engines import compile_all
from support.generated_c import COMPILER, needs_compiler
from truepose.codegen.evaluation import batch, compiled
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.codegen.evaluation.compiled import NotCompiledError, cache_folder, load

SOURCE = "int three(void);\nint three(void) { return 3; }\n"
ANSWERS = 'if [ "$1" = --version ]; then echo "cc 1.0"; exit 0; fi\n'
LAST = 'for last in "$@"; do :; done\n'
"""The library's path is the last argument."""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    compile_all(monkeypatch, tmp_path / "cache")
    batch.log_once.cache_clear()
    yield tmp_path / "cache"


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
    "no utf-8 in its version": ("printf 'cc \\377\\376'; [ \"$1\" = --version ]", "exit code 1"),
    "no utf-8 in its errors": (
        f"{ANSWERS}printf 'x.c:1: error: \\377\\033[2J' >&2; exit 1\n",
        "error: \ufffd?[2J",
    ),
    "rubbish": (f'{ANSWERS}{LAST}echo rubbish > "$last"\n', "cannot be loaded"),
    "nothing": (f"{ANSWERS}exit 0\n", "cannot be loaded"),
    "killed": (f"{ANSWERS}kill -9 $$\n", "exit code -9"),
    "no end": (f"{ANSWERS}exec sleep 600\n", "found no end after 0 s"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_compiler_makes_one_note_and_the_numbers_come(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, kind: str
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
    assert not list(cache.glob("*"))


@needs_compiler
def test_arguments_reach_the_compiler_and_are_part_of_the_key(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "int three(void);\nint three(void) { return X; }\n"
    for value in (3, 4, 3):
        monkeypatch.setenv("TRUEPOSE_CC", f"{COMPILER} -DX={value}")
        assert load(text, ["three"]).three() == value
    assert len(list(cache.glob("*.so"))) == 2


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
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str, words: str
) -> None:
    monkeypatch.setenv("TRUEPOSE_CC", asked.replace("FOLDER", str(tmp_path)))
    with pytest.raises(NotCompiledError, match=words):
        load(SOURCE)


@needs_compiler
def test_a_library_of_something_else_is_not_kept(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "other.c"
    other.write_text("int four(void);\nint four(void) { return 4; }\n")
    script = f'{ANSWERS}{LAST}exec {COMPILER} -shared -fPIC {other} -o "$last"\n'
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, script)))
    assert "it has no function three" in said()
    assert not list(cache.glob("*.so"))


# -- the folder of libraries ----------------------------------------------------------------------------------------


def kept(folder: Path) -> Path | None:
    return cache_folder({"TRUEPOSE_CACHE": str(folder)})


@pytest.mark.parametrize("mode", [0o777, 0o775, 0o772])
@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_folder_that_others_could_put_another_in_place_of_is_not_used(
    tmp_path: Path, mode: int, level: int
) -> None:
    parts = [tmp_path / "a", tmp_path / "a" / "b", tmp_path / "a" / "b" / "c"]
    parts[-1].mkdir(parents=True, mode=0o700)
    assert kept(parts[-1]) == parts[-1]
    parts[level].chmod(mode)
    assert kept(parts[-1]) is None
    assert kept(parts[-1] / "new") is None
    parts[level].chmod(mode | 0o1000)  # as /tmp is: nobody may move what is another's
    assert kept(parts[-1]) == (parts[-1] if level < 2 else None)


def test_links_are_followed_before_the_folder_is_judged(tmp_path: Path) -> None:
    open_to_all, own = tmp_path / "open", tmp_path / "own"
    (open_to_all / "cache").mkdir(parents=True)
    own.mkdir(mode=0o700)
    open_to_all.chmod(0o777)
    (own / "link").symlink_to(open_to_all / "cache")
    assert kept(own / "link") is None
    (own / "cache").mkdir(mode=0o700)
    (own / "other").symlink_to(own / "cache")
    assert kept(own / "other") == own / "cache"
    (own / "round").symlink_to(own / "round")
    assert kept(own / "round") is None
