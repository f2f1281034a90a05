"""Compilers that a user may name: arguments, rubbish, silence, and no end. The numbers come all the same, with one note."""

from __future__ import annotations

import ctypes
import logging
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from support.built_machines import manufactured, read_machines, simulated
from support.engines import compile_all
from support.generated_c import COMPILER, needs_compiler
from truepose.codegen.evaluation import compiled, engine
from truepose.codegen.evaluation.batch import BatchFunction
from truepose.codegen.evaluation.compiled import NotCompiledError, library_cache, load
from truepose.identification.fit.calibrate import calibrate

SOURCE = "int three(void);\nint three(void) { return 3; }\n"
ANSWERS = 'if [ "$1" = --version ]; then echo "cc 1.0"; exit 0; fi\n'
LAST = 'for last in "$@"; do :; done\n'
"""The library's path is the last argument."""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    compile_all(monkeypatch, tmp_path / "cache")
    engine.log_once.cache_clear()
    yield tmp_path / "cache"


@pytest.fixture
def impatient(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second to compile; a version has its usual time."""
    monkeypatch.setattr(compiled, "TO_START", 1.0)
    monkeypatch.setattr(compiled, "A_LETTER", 0.0)


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
    "an empty library": (f'{ANSWERS}{LAST}: > "$last"\n', "cannot be loaded"),
    "nothing": (f"{ANSWERS}exit 0\n", "wrote no library"),
    "a folder": (f'{ANSWERS}{LAST}mkdir "$last"\n', "wrote no library"),
    "a pipe": (f'{ANSWERS}{LAST}mkfifo "$last"\n', "wrote no library"),
    "a link": (f'{ANSWERS}{LAST}ln -s /bin/sh "$last"\n', "wrote no library"),
    "a failure without words": (f"{ANSWERS}exit 7\n", "exit code 7"),
    "killed": (f"{ANSWERS}kill -9 $$\n", "exit code -9"),
    "no end": (f"{ANSWERS}sleep 600\n", "found no end after 1 s"),
    "no answer": ("sleep 600\n", "--version failed: found no end after 1 s"),
    "endless words": (f"{ANSWERS}yes error >&2\n", "writes without end"),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_a_broken_compiler_makes_one_note_and_the_numbers_come(
    cache: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    request: pytest.FixtureRequest,
    kind: str,
) -> None:
    script, words = BROKEN[kind]
    if kind == "no end":
        request.getfixturevalue("impatient")
    if kind == "no answer":
        monkeypatch.setattr(compiled, "TO_ANSWER", 1.0)
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, script)))
    x = ca.SX.sym("x")
    with caplog.at_level(logging.WARNING):
        for k in range(3):
            function = BatchFunction("f", [x], [ca.sin(x) + k], rows=1)
            np.testing.assert_allclose(function(np.ones((5, 1)))[0].ravel(), np.sin(1.0) + k)
            assert function.engine.missed
    (record,) = caplog.records
    assert words in record.getMessage() and "my-cc" in record.getMessage()
    assert record.getMessage().isprintable()
    assert not list(cache.glob("*"))


@pytest.mark.usefixtures("impatient")
def test_what_a_compiler_started_ends_with_it(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another process that has its output open is not waited for, and does not go on: it leaves its pipe without a word."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    script = f"{ANSWERS}(trap '' TERM HUP; exec > {pipe}; sleep 600; echo alive) &\nsleep 600\n"
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, script)))
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    assert "found no end" in said()
    os.set_blocking(reader, True)
    with os.fdopen(reader) as stream:
        assert stream.read() == ""


def test_a_compiler_that_leaves_another_process_behind_is_not_waited_for(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would be waited for until the compiler's time is over, which is said otherwise."""
    left = tmp_path / "left"
    monkeypatch.setenv(
        "TRUEPOSE_CC", str(named(tmp_path, f"{ANSWERS}sleep 600 &\necho $! > {left}\nexit 3\n"))
    )
    assert "exit code 3" in said()
    os.kill(int(left.read_text()), signal.SIGKILL)


@pytest.mark.usefixtures("impatient")
def test_a_compiler_that_hung_is_not_asked_again(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    count = tmp_path / "count"
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, f"{ANSWERS}echo asked >> {count}\nsleep 600\n")))
    assert said() == said(SOURCE.replace("3", "4"))
    assert not count.exists() or count.read_text().split() == ["asked"]  # its second may end before it begins


@needs_compiler
def test_long_texts_have_more_time(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "TO_START", 0.5)
    monkeypatch.setattr(compiled, "A_LETTER", 2e-3)
    slow = f'{ANSWERS}sleep 1; exec {COMPILER} "$@"\n'
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, slow)))
    long = f"{SOURCE}/* {'x' * 100_000} */\n"  # 200 s more
    assert load(long, ["three"]).three() == 3
    monkeypatch.setattr(compiled, "A_LETTER", 0.0)
    assert "found no end" in said()


@needs_compiler
@pytest.mark.parametrize("arguments", ["-m64 -DX=1", "  -DTEXT='\"a b\"'", "'-DX=a b'"])
def test_a_command_with_arguments(cache: Path, monkeypatch: pytest.MonkeyPatch, arguments: str) -> None:
    if arguments.startswith("-m64") and os.uname().machine != "x86_64":
        arguments = "-DX=1"
    monkeypatch.setenv("TRUEPOSE_CC", f"{COMPILER} {arguments}")
    assert load(SOURCE, ["three"]).three() == 3


@needs_compiler
def test_arguments_reach_the_compiler_and_are_part_of_the_key(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "int three(void);\nint three(void) { return X; }\n"
    for value in (3, 4, 3):
        monkeypatch.setenv("TRUEPOSE_CC", f"{COMPILER} -DX={value}")
        assert load(text, ["three"]).three() == value
    assert len(list(cache.glob("*.so"))) == 2


@needs_compiler
def test_a_compiler_in_a_folder_with_spaces(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "my tools"
    folder.mkdir()
    path = named(folder, f'exec {COMPILER} "$@"\n')
    for text in (str(path), f"'{path}' -DX"):
        monkeypatch.setenv("TRUEPOSE_CC", text)
        assert load(SOURCE, ["three"]).three() == 3


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ("gcc '-m64", "expected a compiler and its arguments"),
        ("no-such-cc -m64", r"found no C compiler \(no-such-cc\)"),
        ("FOLDER", "a folder"),
        ("FOLDER -m64", "a folder"),
        ("PLAIN", "may not be run"),
        ("   ", "TRUEPOSE_CC is empty"),
    ],
)
def test_what_is_no_compiler_is_refused_in_words(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, asked: str, words: str
) -> None:
    (tmp_path / "plain").write_text("text")
    text = asked.replace("FOLDER", str(tmp_path)).replace("PLAIN", str(tmp_path / "plain"))
    monkeypatch.setenv("TRUEPOSE_CC", text)
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


@pytest.mark.nightly
@pytest.mark.usefixtures("impatient")
def test_a_calibration_says_once_that_its_compiler_has_no_end(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine, rng = read_machines(tmp_path)["arm"], np.random.default_rng(6)
    monkeypatch.setenv("TRUEPOSE_CC", str(named(tmp_path, f"{ANSWERS}sleep 600\n")))
    recording = simulated(machine, manufactured(machine, rng), rng)
    notes = calibrate(machine, recording).notes
    assert sum("found no end after" in note for note in notes) == 1


# -- the folder of libraries ----------------------------------------------------------------------------------------


def kept(folder: Path) -> Path | None:
    return library_cache({"TRUEPOSE_CACHE": str(folder)}).folder


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


@pytest.mark.skipif(os.name != "posix" or os.getuid() != 0, reason="only root can give a folder away")
@pytest.mark.parametrize("level", [0, 1])
def test_a_folder_of_another_user_is_not_used(tmp_path: Path, level: int) -> None:
    parts = [tmp_path / "a", tmp_path / "a" / "b"]
    parts[-1].mkdir(parents=True, mode=0o700)
    os.chown(parts[level], 12345, 12345)
    assert kept(parts[-1]) is None


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


@needs_compiler
@pytest.mark.parametrize("other", ["link", "pipe", "folder", "for all"])
def test_what_is_no_private_file_is_not_loaded(cache: Path, tmp_path: Path, other: str) -> None:
    assert load(SOURCE, ["three"]).three() == 3
    (library,) = cache.glob("*.so")
    content = library.read_bytes()
    library.unlink()
    if other == "link":
        (tmp_path / "elsewhere.so").write_bytes(content)
        library.symlink_to(tmp_path / "elsewhere.so")
    elif other == "pipe":
        os.mkfifo(library)
    elif other == "folder":
        library.mkdir()
    else:
        library.write_bytes(content)
        library.chmod(0o646)
    if other == "folder":  # cannot be replaced by a file: there is no C, and no error
        assert "cannot be loaded" in said()
    else:
        assert load(SOURCE, ["three"]).three() == 3
        assert library.is_file() and not library.is_symlink()


@needs_compiler
def test_what_is_loaded_is_what_was_looked_at(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the look at a file and its loading another may be put in its place."""
    assert COMPILER is not None
    assert load(SOURCE, ["three"]).three() == 3
    (library,) = cache.glob("*.so")
    (tmp_path / "evil.c").write_text(SOURCE.replace("return 3", "return 666"))
    evil = tmp_path / "evil.so"
    subprocess.run([COMPILER, "-shared", "-fPIC", tmp_path / "evil.c", "-o", evil], check=True)
    loader = ctypes.CDLL

    def swapped(path: str) -> ctypes.CDLL:
        shutil.copy(evil, library)
        return loader(path)

    monkeypatch.setattr(ctypes, "CDLL", swapped)
    assert load(SOURCE, ["three"]).three() == 3
