"""How commands end: an exit code and one line, whatever comes out of them; and what is shown while they work."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from support import MACHINES
from truepose.cli import app
from truepose.commands import progress
from truepose.commands.identify import first_interrupt
from truepose.commands.one_line import exit_code
from truepose.commands.progress import counted
from truepose.errors import ConvergenceError, InputError
from truepose.models.effects.base import effects

SLIPS = {
    "no command": ("launch", "No such command 'launch'"),
    "a command misspelt": ("calibrte", "Did you mean 'calibrate'?"),
    "an option misspelt": ("demo --jsn", "--json"),
    "no argument": ("calibrate", "Missing argument 'MACHINE'"),
    "no output": ("calibrate a.yaml b.csv", "-o"),
    "no number": ("plan a.yaml -n many -o b.csv", "'many'"),
    "too small a number": ("fleet a -o b --workers -3", "-3"),
    "no value": ("plan a.yaml -n", "-n"),
    "no such kind": ("schema thing", "'thing'"),
    "too many words": ("effects a b c", "b c"),
}
posix = pytest.mark.skipif(os.name == "nt", reason="no such devices and signals")


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


def test_help_stays_help() -> None:
    for words, code in (([], 2), (["--help"], 0), (["plan", "-h"], 0)):
        result = run(*words)
        assert result.exit_code == code and result.output.startswith("Usage: truepose")


def ended(error: BaseException) -> int:
    def raises() -> None:
        raise error

    return exit_code(raises)


ENDINGS: dict[str, tuple[BaseException, int, str]] = {
    "input": (InputError("x: found y,\nexpected z"), 2, "x: found y, expected z"),
    "no minimum": (ConvergenceError("q1.d"), 3, "q1.d"),
    "memory": (MemoryError(), 2, "found too little memory"),
    "compiled memory": (RuntimeError("std::bad_alloc"), 2, "found too little memory"),
    "levels": (RecursionError("maximum"), 2, "nested deeper"),
    "disk": (OSError(28, "No space left on device", "/tmp/x"), 2, "/tmp/x: No space left on device"),
    "no name": (OSError(28, "No space left on device"), 2, "the system says: No space left on device"),
    "Ctrl-C": (KeyboardInterrupt(), 130, "stopped"),
    "a pipe": (BrokenPipeError(), 0, ""),
    "a code": (SystemExit(3), 3, ""),
}


@pytest.mark.parametrize("case", ENDINGS)
def test_whatever_ends_a_command_has_its_code_and_its_line(
    case: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdout", io.StringIO())  # what is forgotten then is no file of the test run
    error, code, expected = ENDINGS[case]
    assert ended(error) == code
    told = capsys.readouterr().err
    if expected:
        one_line(told, expected)
    else:
        assert told == ""


@pytest.mark.parametrize("there", [True, False])
def test_a_fault_of_the_program_is_one_line_and_a_report(
    there: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def raises(*_: object) -> object:
        raise ZeroDivisionError("two\nlines" + "z" * 400)

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path if there else tmp_path / "none"))
    monkeypatch.setattr("sys.argv", ["truepose", "effects", "a name"])
    monkeypatch.setattr(effects, "get", raises)
    result = run("effects", "backlash")
    assert result.exit_code == 1 and result.stdout == "" and len(result.stderr) < 500
    one_line(result.stderr, "ZeroDivisionError: two lines")
    if there:
        (report,) = tmp_path.iterdir()
        text = report.read_text(encoding="utf-8")
        assert str(report) in result.stderr and "Traceback" in text and "z" * 400 in text
        assert all(name in text for name in ("truepose ", "Python ", "truepose effects 'a name'"))


@posix
@pytest.mark.parametrize("words", [["effects"], ["effects", "--json"], ["--help"], ["--version"]])
def test_a_full_standard_output_is_told_and_a_closed_one_is_not(words: list[str]) -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        done = command(*words, stdout=full)
    assert done.returncode == 2
    one_line(done.stderr, "No space left on device")
    read, write = os.pipe()
    os.close(read)
    done = command(*words, stdout=write)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, "")


@posix
def test_errors_that_cannot_be_told_still_have_their_code() -> None:
    with Path("/dev/full").open("w", encoding="utf-8") as full:
        arguments = [sys.executable, "-m", "truepose", "effects", "nope"]
        assert subprocess.run(arguments, stderr=full, check=False).returncode == 2


def test_a_terminal_without_the_letters_is_no_fault(tmp_path: Path) -> None:
    done = command(
        "effects", "backlash", stdout=subprocess.PIPE, env={**os.environ, "PYTHONIOENCODING": "ascii"}
    )
    assert done.returncode == 0 and done.stderr == "" and done.stdout


@posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_command_that_is_stopped_leaves_nothing(number: int, tmp_path: Path) -> None:
    """Nothing under a temporary name either; what was there stays."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "calibrated.yaml").write_text("old", encoding="utf-8")
    script = (
        "import sys, time\nfrom truepose.cli import app, main\nfrom truepose.files import atomic_directory\n"
        "@app.command('wait')\n"
        "def wait():\n"
        f"    with atomic_directory({str(out)!r}) as partial:\n"
        "        (partial / 'calibrated.yaml').write_text('new')\n"
        "        print('at work', flush=True)\n"
        "        time.sleep(60)\n"
        "sys.argv = ['truepose', 'wait']\nmain()\n"
    )
    words = [sys.executable, "-c", script]
    with subprocess.Popen(words, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "at work\n"
        process.send_signal(number)
        assert process.stderr.read() == "error: stopped\n"
    assert process.returncode == 130
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "calibrated.yaml"]
    assert (out / "calibrated.yaml").read_text(encoding="utf-8") == "old"


@posix
def test_a_first_ctrl_c_asks_a_diagnosis_for_an_end(capsys: pytest.CaptureFixture[str]) -> None:
    """And a second one ends it."""
    with pytest.raises(KeyboardInterrupt), first_interrupt() as stop:
        assert not stop()
        signal.raise_signal(signal.SIGINT)
        assert stop() and capsys.readouterr().err.startswith("the search ends")
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def shown(
    work: Callable[[], None],
    capsys: pytest.CaptureFixture[str],
    expected: str,
) -> str:
    """What stands on standard error once the expected text does; ten seconds at most."""
    told = ""
    for _ in range(500):
        work()
        told += capsys.readouterr().err
        if expected in told:
            break
        time.sleep(0.02)
    assert expected in told
    return told


@pytest.mark.parametrize("terminal", [True, False])
def test_long_work_is_shown_on_standard_error(
    terminal: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bar on a terminal, else lines; in the first seconds nothing."""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)
    monkeypatch.setenv("TERM", "xterm")
    with progress.progress("calibrating") as say:
        say("fitting")
    assert tuple(capsys.readouterr()) == ("", "")
    monkeypatch.setattr(progress, "DELAY", 0.0)
    monkeypatch.setattr(progress, "EVERY", 0.02)
    with progress.progress("calibrating") as say:
        told = shown(lambda: say("fitting"), capsys, "fitting")
    with counted("sitting") as hear:
        told += shown(lambda: hear(1, 2, "case001"), capsys, "sitting: case001")
    assert ("\x1b" in told) == terminal
    assert terminal or re.search(r"^sitting: case001, 1 of 2 \(0 s\)$", told, re.MULTILINE)
    assert not [one for one in threading.enumerate() if one.name.startswith("Timer")]


def test_a_result_says_where_files_beside_it_are_of_another_run(tmp_path: Path) -> None:
    from truepose.files import FILES_SHA256, mixed_files, mixture_notes, sha256_of
    from truepose.models.load import load_machine

    improved, result = tmp_path / "improved.yaml", tmp_path / "diagnosis.json"
    text = (MACHINES / "serial.yaml").read_text(encoding="utf-8")
    improved.write_text(text, encoding="utf-8")
    (tmp_path / "report.html").write_text("one run's", encoding="utf-8")
    result.write_text(json.dumps({FILES_SHA256: sha256_of(tmp_path)}), encoding="utf-8")
    notes = load_machine(improved).notes
    assert mixed_files(result) == () and mixture_notes(result) == ()
    (tmp_path / "report.html").write_text("another's", encoding="utf-8")
    assert mixed_files(result) == ("report.html",) and load_machine(improved).notes == notes
    improved.write_text(text + "\n", encoding="utf-8")
    assert mixed_files(result) == ("improved.yaml", "report.html")
    (said,) = load_machine(improved).notes[len(notes) :]
    assert said.startswith(
        f"{tmp_path}: found improved.yaml other than diagnosis.json was written with, expected"
    )
    for name in ("improved.yaml", "report.html"):
        (tmp_path / name).unlink()
    assert mixed_files(result) == ()  # what is not there is no other run's
    for content in ("", "[]", "{}", '{"files_sha256": 3}'):
        result.write_text(content, encoding="utf-8")
        assert mixed_files(result) == ()
