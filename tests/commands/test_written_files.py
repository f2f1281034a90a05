"""Single files and folders as they are written: what is in them, what is told of them, and who may write at a time."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from truepose import files
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_file, atomic_write_text, check_place, write_table
from truepose.publication import begun, claimed, clear, held
from truepose.stopping import stopping

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no such locks and links")
STAGE = f".{'0a' * 6}.partial"


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(stopping, "written", [])


def there(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


@pytest.mark.parametrize("ending", ["csv", "txt", "parquet", "pq", "PARQUET"])
def test_a_table_is_read_back_as_it_was(ending: str) -> None:
    """Floats at full precision; what is said above a CSV's header has no place in Parquet."""
    rng = np.random.default_rng(3)
    frame = pd.DataFrame({"a [mm]": rng.normal(size=5), "b": [1, 2, 3, 4, 5]})
    path = Path(f"table.{ending}")
    write_table(path, frame, ["first", "second"])
    if ending.lower() in ("parquet", "pq"):
        pd.testing.assert_frame_equal(pd.read_parquet(path), frame)
    else:
        text = path.read_bytes().decode()
        assert text.startswith("# first\n# second\na [mm],b\n") and "\r" not in text
        rows = [line.split(",") for line in text.splitlines()[3:]]
        assert [[float(a), int(b)] for a, b in rows] == frame.to_numpy().tolist()
    write_table(Path("plain.csv"), frame)
    assert Path("plain.csv").read_text(encoding="utf-8").startswith("a [mm],b\n")


def test_what_is_in_place_is_told_by_its_whole_name(tmp_path: Path) -> None:
    """A folder once, not each of its files."""
    atomic_write_text("a.txt", "a")
    with atomic_directory("new") as partial:
        atomic_write_text(partial / "b.txt", "b")
        atomic_write_text(partial / "c.txt", "c")
    with atomic_directory("new") as partial:
        atomic_write_text(partial / "c.txt", "d")
    assert stopping.written == [str(tmp_path / "a.txt"), str(tmp_path / "new"), str(tmp_path / "new")]
    assert there(tmp_path) == {"a.txt", "new", "new/b.txt", "new/c.txt"}
    assert Path("new/c.txt").read_text(encoding="utf-8") == "d"


def test_lines_end_as_they_were_given() -> None:
    atomic_write_text("a.txt", "one\r\ntwo\n\u00b5")
    assert Path("a.txt").read_bytes() == b"one\r\ntwo\n\xc2\xb5"


def test_a_link_is_followed_and_stays_one(tmp_path: Path) -> None:
    Path("real").mkdir()
    Path("real/a.txt").write_text("old", encoding="utf-8")
    Path("link.txt").symlink_to("real/a.txt")
    Path("folder").symlink_to("real")
    atomic_write_text("link.txt", "new")
    with atomic_directory("folder") as partial:
        (partial / "b.txt").write_text("b", encoding="utf-8")
    assert Path("link.txt").is_symlink() and Path("folder").is_symlink()
    assert Path("real/a.txt").read_text(encoding="utf-8") == "new"
    assert there(tmp_path) == {"real", "real/a.txt", "real/b.txt", "link.txt", "folder"}


def test_a_pipe_is_written_to_as_it_is(tmp_path: Path) -> None:
    """It is no file that another could take the place of."""
    os.mkfifo("pipe")
    reader = os.open("pipe", os.O_RDONLY | os.O_NONBLOCK)
    check_place("pipe", "file")
    atomic_write_text("pipe", "through")
    assert os.read(reader, 100) == b"through"
    os.close(reader)
    assert there(tmp_path) == {"pipe"} and not Path("pipe").is_file() and stopping.written == []


@pytest.mark.parametrize("kind", ["file", "directory"])
def test_what_fails_leaves_what_was_there(kind: str, tmp_path: Path) -> None:
    """Of new folders none; one that others have filled meanwhile stays."""
    Path("a.txt").write_text("old", encoding="utf-8")
    Path("old").mkdir()
    before = there(tmp_path)
    for path in ("a.txt", "b.txt") if kind == "file" else ("old", "new/deep/er"):
        with pytest.raises(ZeroDivisionError):
            if kind == "file":
                with atomic_file(path) as unfinished:
                    unfinished.write_text("half", encoding="utf-8")
                    raise ZeroDivisionError
            with atomic_directory(path) as partial:
                (partial / "c.txt").write_text("half", encoding="utf-8")
                raise ZeroDivisionError
    assert there(tmp_path) == before and Path("a.txt").read_text(encoding="utf-8") == "old"
    with pytest.raises(ZeroDivisionError), atomic_directory("new/deep/er"):
        Path("new/mine.txt").touch()
        raise ZeroDivisionError
    assert there(tmp_path) == before | {"new", "new/mine.txt"}


@pytest.mark.parametrize("kind", ["file", "directory"])
def test_what_is_of_the_other_kind_is_refused(kind: str) -> None:
    Path("folder").mkdir()
    Path("file").touch()
    if kind == "file":
        with pytest.raises(InputError, match="folder: cannot write the file: Is a directory"):
            atomic_write_text("folder", "text")
    else:
        with (
            pytest.raises(InputError, match="file: expected a directory, found a file"),
            atomic_directory("file"),
        ):
            pass


def test_an_error_names_files_where_they_are_to_be() -> None:
    """What is said of other files stays as it is."""
    for end in (": found nothing", ": cannot write the file: No space left"):
        with pytest.raises(InputError) as told, atomic_directory("out") as partial:
            name = str(partial / "a.csv")
            raise InputError(name + end) if "found" in end else OSError(28, "No space left", name)
        assert str(told.value) == f"out/a.csv{end}"
    for other, said in (
        (InputError("else: found nothing"), "else: found nothing"),
        (OSError(28, "No space left", "else"), "out: cannot write the directory: No space left"),
        (OSError("strange"), "out: cannot write the directory: strange"),
    ):
        with pytest.raises(InputError) as told, atomic_directory("out"):
            raise other
        assert str(told.value) == said


@pytest.mark.parametrize("kind", ["file", "directory"])
def test_where_nobody_may_write_is_told_before(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    Path("old.txt").touch()
    for name in ("new", "deep/new", "old.txt")[: 3 if kind == "file" else 2]:
        with pytest.raises(InputError, match=f"{name}: cannot write the {kind}: no permission for"):
            check_place(name, kind)  # type: ignore[arg-type]


@pytest.mark.parametrize(("length", "fits"), [(255, True), (256, False)])
def test_a_name_has_as_many_bytes_as_systems_give_it(length: int, fits: bool) -> None:
    assert files.NAME_MAX == 255
    for name in (f"new/{'x' * length}", f"{'x' * length}/new"):
        if fits:
            check_place(name, "directory")
        else:
            with pytest.raises(InputError, match="File name too long"):
                check_place(name, "directory")


def test_one_at_a_time_holds_a_lock(monkeypatch: pytest.MonkeyPatch) -> None:
    """Until its block ends; where there are no locks everyone has it, and no file stays open for one."""
    Path("a").touch()
    opened = len(os.listdir("/proc/self/fd"))  # noqa: PTH208
    with held(Path("a")) as first, held(Path("a"), wait=False) as second:
        assert (first, second) == (True, False)
    with held(Path("a"), wait=False) as again, held(Path("none"), wait=False) as nothing:
        assert again and nothing
    assert len(os.listdir("/proc/self/fd")) == opened  # noqa: PTH208
    monkeypatch.setitem(sys.modules, "fcntl", None)
    with held(Path("a")) as first, held(Path("a"), wait=False) as second:
        assert first and second


@pytest.mark.parametrize("folder", [False, True])
def test_what_is_claimed_is_hidden_locked_and_gone_afterwards(folder: bool, tmp_path: Path) -> None:
    """Inside a folder that is there, beside what is not."""
    if folder:
        Path("out").mkdir()
    with claimed(tmp_path / "out", Path.mkdir) as stage:
        assert stage.parent == (tmp_path / "out" if folder else tmp_path)
        assert stage.name.startswith("." if folder else ".out.") and stage.name.endswith(".partial")
        with held(stage, wait=False) as free:
            assert not free
        clear(tmp_path / "out", tmp_path)  # another run takes only what is dead
        assert stage.is_dir() and not begun(stage)
    assert there(tmp_path) == ({"out"} if folder else set())


def test_what_killed_runs_left_goes_with_the_next_one(tmp_path: Path) -> None:
    """Beside a result and in it, by names that none but such a run gives."""
    Path("out").mkdir()
    mine = ["out/.mine.partial", f"other{STAGE}", f"out/x{STAGE}", f".other{STAGE}"]
    for name in (f".out{STAGE}", f"out/{STAGE}", *mine):
        Path(name).mkdir()
    clear(tmp_path / "out", tmp_path / "nothing")
    assert there(tmp_path) == {"out", *mine}
    clear(tmp_path / "none", tmp_path)  # no such folder
    Path(f".out{STAGE}").touch()
    clear(tmp_path / "out", tmp_path / f".out{STAGE}")
    assert Path(f".out{STAGE}").exists()  # one's own
    clear(tmp_path / "out", tmp_path)
    assert there(tmp_path) == {"out", *mine}
