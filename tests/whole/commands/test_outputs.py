"""Outputs that cannot be are refused in one line before anything is read, and leave nothing; whatever the command."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from support import MACHINES
from truepose.cli import app
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_file, atomic_write_text, check_place

pytestmark = pytest.mark.skipif(os.name == "nt", reason="other names and permissions there")
M, R = "none.yaml", "none.csv"
"""Inputs that are not there: who names the output first has not read them."""
TO_FILE = {
    ".yaml": {"init": ["--arm", "ur5e", "-o"]},
    ".csv": {
        "plan": [M, "-n", "3", "-o"],
        "poses": [R, "--sigma", "1", "-o"],
        "predict": [M, R, "-o"],
        "simulate": [M, R, "-o"],
        "compensate": [M, R, "-o"],
        "import": [R, "-o"],
    },
    ".urdf": {"export": [M, "-o"]},
    ".json": {"schema": ["-o"], "identifiability": [M, "-o"]},
}
FILES = [(name, words, end) for end, some in TO_FILE.items() for name, words in some.items()]
FOLDERS = [
    ("demo", ["-o"], ""),
    ("check", [M, R, "--fix"], ""),
    ("calibrate", [M, R, "-o"], ""),
    ("diagnose", [M, R, "-o"], ""),
    ("drift", [M, R, "-o"], ""),
    ("fleet", ["none", "-o"], ""),
    ("codegen", [M, "-o"], ""),
]


def _below_a_file(folder: Path) -> Path:
    (folder / "file").write_text("mine", encoding="utf-8")
    return folder / "file" / "x"


def _loop(folder: Path) -> Path:
    (folder / "loop").symlink_to("loop")
    return folder / "loop" / "x"


def _directory(folder: Path) -> Path:
    (folder / "x").mkdir()
    return folder / "x"


def _file(folder: Path) -> Path:
    (folder / "x").write_text("mine", encoding="utf-8")
    return folder / "x"


BAD: dict[str, Callable[[Path], Path]] = {
    "a name too long": lambda folder: folder / ("x" * 300),
    "a name too long in a new folder": lambda folder: folder / "new" / ("x" * 300),
    "below a file": _below_a_file,
    "a loop of links": _loop,
    "a NUL": lambda folder: folder / "a\0b",
    "no files there": lambda _: Path("/proc/truepose/x"),
}
CASES = [
    *((*what, case, BAD[case]) for what in [*FILES, *FOLDERS] for case in BAD),
    *((*what, "the root", lambda _: Path("/")) for what in FILES),
    *((*what, "a folder", _directory) for what in FILES),
    *((*what, "a file", _file) for what in FOLDERS),
]


@pytest.mark.parametrize(
    ("command", "words", "end", "case", "place"), CASES, ids=[f"{c[0]} {c[3]}{c[2]}" for c in CASES]
)
def test_an_output_that_cannot_be_is_refused_first(
    command: str,
    words: list[str],
    end: str,
    case: str,
    place: Callable[[Path], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    out = str(place(tmp_path)) + ("" if case in ("the root", "a folder") else end)
    before = sorted(tmp_path.rglob("*"))
    result = CliRunner().invoke(app, [command, *words, out])
    assert result.exit_code == 2 and result.stdout == ""
    assert re.fullmatch(r"error: [^\n]+\n", result.stderr), result.stderr
    assert (repr(out) if "\0" in out else out) in result.stderr and "none" not in result.stderr
    assert sorted(tmp_path.rglob("*")) == before


def test_no_permission_is_told_before() -> None:
    """As another user where tests are run by one who may do everything."""
    script = (
        "import os, sys\nfrom pathlib import Path\nfrom truepose.files import check_place\n"
        "os.getuid() or os.setuid(65534)\ncheck_place(Path(sys.argv[1]), sys.argv[2])\n"
    )
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        (folder / "closed").mkdir(mode=0o555)
        for kind in ("file", "directory"):
            words = [sys.executable, "-c", script, str(folder / "closed" / "x"), kind]
            done = subprocess.run(words, capture_output=True, text=True, check=False)
            assert re.search(r"InputError: .*x: cannot write the .*: Permission denied", done.stderr), (
                done.stderr
            )
        assert not list((folder / "closed").iterdir())


@pytest.mark.parametrize("command", ["effects", "schema"])
def test_a_working_directory_that_is_gone(command: str, tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    script = (
        f"import os, sys\nos.mkdir({str(gone)!r})\nos.chdir({str(gone)!r})\nos.rmdir({str(gone)!r})\n"
        "from truepose.__main__ import main\nmain()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, command], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and done.stderr == ""  # it writes no file
    words = ["schema", "-o", "x.json"]
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 2 and not gone.exists()
    assert re.fullmatch(r"error: [^\n]+\n", done.stderr), done.stderr


def test_a_full_device_is_told() -> None:
    result = CliRunner().invoke(app, ["schema", "-o", "/dev/full"])
    assert result.exit_code == 2
    assert result.stderr == "error: /dev/full: cannot write the file: No space left on device\n"


@pytest.mark.parametrize("name", ["x" * 250, "é" * 120])
def test_any_name_that_the_system_has_can_be_written(name: str, tmp_path: Path) -> None:
    check_place(tmp_path / name, "file")
    atomic_write_text(tmp_path / name, "whole")
    with atomic_directory(tmp_path / "folder" / name) as partial:
        (partial / "a.txt").write_text("a", encoding="utf-8")
    assert (tmp_path / name).read_text(encoding="utf-8") == "whole"
    assert (tmp_path / "folder" / name / "a.txt").read_text(encoding="utf-8") == "a"
    assert not list(tmp_path.rglob("*.partial"))


def test_a_folder_that_goes_while_it_is_written_is_told_by_its_own_name(tmp_path: Path) -> None:
    import shutil

    out = tmp_path / "out"
    with pytest.raises(InputError, match=f"^{out}[^ ]*: cannot write"), atomic_directory(out) as partial:
        shutil.rmtree(partial.parent)
        atomic_write_text(partial / "a.txt", "a")
    with pytest.raises(InputError, match=f"^{out}[^ ]*: cannot write"), atomic_directory(out) as partial:
        shutil.rmtree(partial.parent)
        (partial / "a.txt").write_text("a", encoding="utf-8")
    with (
        pytest.raises(InputError, match="cannot write the file"),
        atomic_file(tmp_path / "b.txt") as unfinished,
    ):
        unfinished.unlink()
    assert not list(tmp_path.iterdir())


READ = {
    "predict": "predict m.yaml r.csv",
    "simulate": "simulate m.yaml r.csv",
    "export": "export m.yaml",
    "compensate": "compensate m.yaml r.csv",
    "a plan": "plan m.yaml -n 3 --candidates c.csv",
    "poses": "poses r.csv --sigma 1 --body b.csv",
    "points beside joints": "import r.csv --joints j.csv",
    "a probe's log": "import r.csv --log l.csv --model m.yaml",
}
"""Commands that write one file, and all that they read."""


@pytest.mark.parametrize(
    ("words", "over"),
    [
        pytest.param(words, over, id=f"{name}: {over}")
        for name, words in READ.items()
        for over in re.findall(r"\S+\.(?:yaml|csv)", words)
    ],
)
def test_no_file_is_written_over_one_that_is_read(
    words: str, over: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    names = re.findall(r"\S+\.(?:yaml|csv)", words)
    for name in names:
        text = "q1 [mm],q2,q3\n1,0.1,0.2\n" if name.endswith("csv") else None
        (tmp_path / name).write_text(text or (MACHINES / "serial.yaml").read_text(encoding="utf-8"))
    before = {name: (tmp_path / name).read_bytes() for name in names}
    result = CliRunner().invoke(app, [*words.split(), "-o", over])
    assert result.exit_code == 2 and result.stdout == "" and f"{over}, which is read" in result.stderr
    assert {name: (tmp_path / name).read_bytes() for name in names} == before


@pytest.mark.parametrize("option", ["--diagnosis", "--with"])
def test_a_plan_is_not_written_over_what_it_is_made_from(option: str, tmp_path: Path) -> None:
    read = tmp_path / "read"
    read.write_text("what was found", encoding="utf-8")
    asked = ["--discriminate", "backlash", "nothing"] if option == "--with" else []
    words = ["plan", MACHINES / "serial.yaml", "-n", "4", *asked, option, read, "-o", read]
    result = CliRunner().invoke(app, [*map(str, words)])
    assert result.exit_code == 2 and "which is read" in result.stderr
    assert read.read_text(encoding="utf-8") == "what was found"
