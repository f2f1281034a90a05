"""Whatever comes out of a command is one line and an exit code: slips of the command line, a full disk, faults of our own."""

from __future__ import annotations

import io
import os
import re
import runpy
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from support import MACHINES
from truepose import faults
from truepose.cli import app
from truepose.errors import InputError
from truepose.models.effects.base import effects
from truepose.stopping import stopping
from truepose.version import VERSION

SERIAL = MACHINES / "serial.yaml"
SLIPS = {
    "no command": ("launch", "found the command 'launch', expected one of demo, init"),
    "a command misspelt": ("calibrte", "did you mean 'calibrate'?"),
    "no option": ("effects --nope", "effects: no such option: --nope"),
    "an option misspelt": ("demo --jsn", "--json"),
    "no argument": ("calibrate", "missing argument 'MACHINE'"),
    "no second argument": ("calibrate a.yaml", "missing argument 'RECORDING...'"),
    "no output": ("calibrate a.yaml b.csv", "-o"),
    "no number": ("plan a.yaml -n many -o b.csv", "'many'"),
    "too small a number": ("fleet a -o b --workers -3", "-3"),
    "no value": ("plan a.yaml -n", "-n"),
    "no such kind": ("schema thing", "'thing'"),
    "too many words": ("effects a b c", "b c"),
}
faulty = pytest.mark.skipif(os.name == "nt", reason="no such devices")


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def one_line(stderr: str, *expected: str) -> None:
    assert re.fullmatch(r"error: [^\n]+\n", stderr), stderr
    assert all(text in stderr for text in expected), stderr


def command(*words: object, **options: object) -> subprocess.CompletedProcess[str]:
    arguments = [sys.executable, "-m", "truepose", *map(str, words)]
    return subprocess.run(arguments, text=True, stderr=subprocess.PIPE, check=False, **options)  # type: ignore[call-overload,no-any-return]


@pytest.mark.parametrize("case", SLIPS)
def test_a_slip_of_the_command_line_is_one_line(case: str) -> None:
    words, expected = SLIPS[case]
    result = run(*words.split())
    assert result.exit_code == 2 and result.stdout == ""
    one_line(result.stderr, expected, "--help")
    known = words.split(maxsplit=1)[0]
    known = "" if known in ("launch", "calibrte") else known
    said = re.fullmatch(
        r"error: (?:(\w+): )?(.*[^.]); truepose (\w+ )?--help tells what it takes\n", result.stderr
    )
    assert said and {said[1], (said[3] or "").strip()} <= {known, "", None} and not said[2][:1].isupper()


def test_help_stays_help() -> None:
    for words, code in (([], 2), (["--help"], 0), (["plan", "-h"], 0)):
        result = run(*words)
        assert result.exit_code == code and result.output.startswith("Usage: truepose")


@pytest.mark.parametrize("words", [["init", "-o", ""], ["calibrate", "", "x"], ["effects", "a\0b"]])
def test_an_empty_name_and_one_with_a_nul_are_told(words: list[str]) -> None:
    result = run(*words)
    assert result.exit_code == 2
    one_line(result.stderr, "found", "expected")


def _raising(monkeypatch: pytest.MonkeyPatch, make: Callable[[], BaseException]) -> None:
    def raises(*_: object) -> object:
        raise make()

    monkeypatch.setattr(effects, "get", raises)


def test_a_fault_of_our_own_leaves_a_report(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("sys.argv", ["truepose", "effects", "a name"])
    _raising(monkeypatch, lambda: ZeroDivisionError("two\nlines"))
    result = run("effects", "backlash")
    assert result.exit_code == 1 and result.stdout == ""
    (report,) = tmp_path.iterdir()
    one_line(result.stderr, str(report), "ZeroDivisionError: two lines", "truepose effects 'a name'")
    text = report.read_text(encoding="utf-8")
    assert all(name in text for name in ("truepose ", "Python ", "casadi ", "numpy ", "scipy "))
    assert "truepose effects 'a name'" in text and "Traceback" in text and "ZeroDivisionError" in text


@pytest.mark.parametrize("length", [30, 400])
def test_a_long_fault_is_cut_in_the_line_and_whole_in_the_report(
    length: int, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    _raising(monkeypatch, lambda: ZeroDivisionError("z" * length))
    line = run("effects", "backlash").stderr
    (report,) = tmp_path.iterdir()
    assert ("z" * length in line) is (length < 200) and ("z ..." in line) is (length > 200)
    assert "z" * min(length, 150) in line and "z" * 201 not in line
    assert "z" * length in report.read_text(encoding="utf-8")


MENDABLE: dict[str, tuple[Callable[[], BaseException], str]] = {
    "memory": (
        lambda: MemoryError("Unable to allocate 3.00 TiB"),
        "memory than this process may have (Unable",
    ),
    "compiled memory": (lambda: RuntimeError("std::bad_alloc"), "more memory"),
    "levels": (lambda: RecursionError("maximum"), "nested deeper"),
    "disk": (lambda: OSError(28, "No space left on device", "/tmp/x"), "/tmp/x: No space left on device"),
    "input": (lambda: InputError("x: found y,\nexpected z"), "x: found y, expected z"),
}


@pytest.mark.parametrize("case", MENDABLE)
def test_what_a_user_can_mend_is_bad_input(
    case: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    make, expected = MENDABLE[case]
    _raising(monkeypatch, make)
    result = run("effects", "backlash")
    assert result.exit_code == 2 and not list(tmp_path.iterdir())
    one_line(result.stderr, expected)


def test_an_interruption_says_that_nothing_was_written(monkeypatch: pytest.MonkeyPatch) -> None:
    _raising(monkeypatch, KeyboardInterrupt)
    result = run("effects", "backlash")
    assert (result.exit_code, result.stderr) == (130, "error: stopped; nothing was written\n")


@faulty
@pytest.mark.parametrize("words", [["effects"], ["effects", "--json"], ["--help"], ["--version"]])
def test_a_full_standard_output_is_told(words: list[str]) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = command(*words, stdout=full)
    assert done.returncode == 2
    one_line(done.stderr, "No space left on device")


@faulty
@pytest.mark.parametrize("words", [["effects"], ["effects", "--json"], ["--help"]])
def test_who_stops_reading_hears_nothing_of_it(words: list[str]) -> None:
    read, write = os.pipe()
    os.close(read)
    done = command(*words, stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


@faulty
def test_errors_that_cannot_be_told_still_have_their_code() -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        arguments = [sys.executable, "-m", "truepose", "effects", "nope"]
        assert subprocess.run(arguments, stderr=full, check=False).returncode == 2


def ended(error: BaseException) -> int:
    def raises() -> None:
        raise error

    return faults.ended(raises)


def exits(code: object, context: BaseException | None = None) -> SystemExit:
    made = SystemExit(code)
    made.__context__ = context
    return made


ENDINGS: dict[str, tuple[BaseException, int, str]] = {
    "a code": (exits(3), 3, ""),
    "no code": (exits(None), 0, ""),
    "nobody reads": (exits(1, BrokenPipeError()), 0, ""),
    "another error": (exits(1, ValueError()), 1, ""),
    "a pipe": (BrokenPipeError(), 0, ""),
    "memory": (
        MemoryError(),
        2,
        "needs more memory than this process may have; expected fewer rows, poses or parameters at once",
    ),
    "compiled memory": (
        RuntimeError("std::bad_alloc"),
        2,
        "needs more memory than this process may have; expected fewer rows, poses or parameters at once",
    ),
    "of the system": (OSError(28, "No space left on device"), 2, "the system says: No space left on device"),
    "a name in bytes": (OSError(28, "No space", b"/tmp/x"), 2, "/tmp/x: No space"),
    "no words": (OSError(28, ""), 2, "the system says: [Errno 28] "),
    "not there": (FileNotFoundError(2, "No such file", "x.csv"), 2, "x.csv: No such file"),
}


@pytest.mark.parametrize("case", ENDINGS)
def test_whatever_ends_a_program_has_its_code_and_its_words(
    case: str, capsys: pytest.CaptureFixture[str]
) -> None:
    error, code, told = ENDINGS[case]
    assert ended(error) == code
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", f"error: {told}\n" if told else "")


@pytest.mark.parametrize(
    ("error", "there", "said"),
    [
        (FileNotFoundError(2, "No such file", "x.csv"), True, "No such file"),
        (FileNotFoundError(2, "No such file", "x.csv"), False, "found no working directory"),
        (FileNotFoundError(2, "No such file", b"x.csv"), False, "found no working directory"),
        (FileNotFoundError(2, "No such file"), False, "found no working directory"),
        (FileNotFoundError(2, "No such file", str(Path.home())), False, "No such file"),
        (PermissionError(13, "Permission denied", "x.csv"), False, "Permission denied"),
    ],
)
def test_what_is_missing_may_be_the_working_directory(
    error: OSError, there: bool, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def gone() -> str:
        raise FileNotFoundError

    if not there:
        monkeypatch.setattr(os, "getcwd", gone)
    assert faults.reason(error).startswith(said)


@pytest.mark.parametrize(("found", "code"), [(3, 3), (0, 0), (None, 0), ("done", 0)])
def test_what_comes_to_its_end_has_the_code_that_it_gives(found: object, code: int) -> None:
    assert faults.ended(lambda: found) == code


@pytest.mark.parametrize(("length", "cut"), [(200, False), (201, True)])
def test_a_fault_is_cut_in_the_line_from_two_hundred_letters_on(
    length: int,
    cut: bool,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """And where no report can be written this is said."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "none"))
    monkeypatch.setattr("sys.argv", ["truepose", "effects"])
    assert ended(OSError("x" * (length - len("OSError: ")))) == 1  # without a number: not the system's
    whole = "OSError: " + "x" * (length - len("OSError: "))
    assert capsys.readouterr().err == (
        f"error: a fault of truepose, not of your files ({whole[:200]}{' ...' * cut}); no report of it could be written; "
        "it comes again with: truepose effects\n"
    )


def test_where_nobody_can_be_told_nothing_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    for stream in (None, open(os.devnull, encoding="utf-8")):  # noqa: SIM115, PTH123 -- closed below, cannot be written to
        monkeypatch.setattr(sys, "stderr", stream)
        faults.say("nobody hears this")
        if stream is not None:
            stream.close()
            faults.say("nor this")


@faulty
def test_a_stream_that_nobody_takes_is_forgotten() -> None:
    """What it still holds goes nowhere, and no file stays open for it."""
    read, write = os.pipe()
    os.close(read)
    before = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    with os.fdopen(write, "w", encoding="utf-8") as stream:
        stream.write("lost")
        with pytest.raises(BrokenPipeError):
            stream.flush()
        faults.forget(stream)
        assert len(os.listdir("/proc/self/fd")) == before  # noqa: PTH208
        stream.write("more")
        stream.flush()
    faults.forget(stream)  # closed
    faults.forget(None)


@pytest.fixture
def _signals_as_before(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.getsignal(number) for number in numbers]
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    monkeypatch.setattr(stopping, "listens", False)
    yield
    for number, handler in zip(numbers, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.usefixtures("_signals_as_before")
@pytest.mark.parametrize("kind", ["letters", "pipe", "none"])
def test_a_program_leaves_with_its_code_whatever_its_streams_are(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Letters that a terminal has not are written out, and nobody needs to read to the end."""
    held, read, write = io.BytesIO(), *os.pipe()
    out: dict[str, object] = {"letters": io.TextIOWrapper(held, "ascii"), "none": None}
    out["pipe"] = os.fdopen(write, "w", encoding="ascii")
    monkeypatch.setattr(sys, "stdout", out[kind])
    told = io.StringIO()
    monkeypatch.setattr(sys, "stderr", told)
    if kind == "pipe":
        os.close(read)

    def run() -> int:
        assert stopping.listens
        if sys.stdout is not None:
            sys.stdout.write("5 \u00b5m")
        return 3

    with pytest.raises(SystemExit) as end:
        faults.main(run)
    assert end.value.code == 3 and told.getvalue() == ""
    assert held.getvalue() == (b"5 \\xb5m" if kind == "letters" else b"")
    out["pipe"].close()  # type: ignore[attr-defined]
    if kind != "pipe":
        os.close(read)


@pytest.mark.usefixtures("_signals_as_before")
@pytest.mark.parametrize("module", ["truepose", "truepose.cli"])
def test_either_module_is_the_program(
    module: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With one thread of linear algebra, unless somebody wants more."""
    for name, value in (("OMP", ""), ("OPENBLAS", ""), ("MKL", "4")):
        monkeypatch.setenv(f"{name}_NUM_THREADS", value)
        if not value:
            monkeypatch.delenv(f"{name}_NUM_THREADS")
    monkeypatch.setattr("sys.argv", ["truepose", "--version"])
    monkeypatch.delitem(
        sys.modules, module if module == "truepose.cli" else "truepose.__main__", raising=False
    )
    with pytest.raises(SystemExit) as end:
        runpy.run_module(module, run_name="__main__")
    assert end.value.code == 0 and capsys.readouterr().out == f"truepose {VERSION}\n"
    threads = [os.environ[f"{name}_NUM_THREADS"] for name in ("OMP", "OPENBLAS", "MKL")]
    assert threads == ["1", "1", "4"]
