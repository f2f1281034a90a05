"""Single files and folders as they are written: what is in them, and what is left where they cannot be."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_file, atomic_write_text, check_place, write_table

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no such locks and links")


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


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


def test_a_folder_keeps_its_other_files(tmp_path: Path) -> None:
    atomic_write_text("a.txt", "a")
    with atomic_directory("new") as partial:
        atomic_write_text(partial / "b.txt", "b")
        atomic_write_text(partial / "c.txt", "c")
    with atomic_directory("new") as partial:
        atomic_write_text(partial / "c.txt", "d")
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
    assert there(tmp_path) == {"pipe"} and not Path("pipe").is_file()


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


def test_files_are_moved_one_by_one_and_the_one_that_names_them_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Folders in it are made first."""
    moved, replace = list[str](), Path.replace

    def noted(file: Path, to: Path) -> Path:
        moved.append(file.name)
        return replace(file, to)

    monkeypatch.setattr(Path, "replace", noted)
    with atomic_directory("out", last="b.json") as partial:
        (partial / "deep").mkdir()
        for name in ("b.json", "deep/a.csv", "c.yaml"):
            (partial / name).write_text(name, encoding="utf-8")
    assert moved == ["c.yaml", "a.csv", "b.json"]
    assert there(tmp_path) == {"out", "out/deep", "out/deep/a.csv", "out/b.json", "out/c.yaml"}


def test_a_folder_in_the_place_of_a_file_stops_all(tmp_path: Path) -> None:
    Path("out/b.txt").mkdir(parents=True)
    Path("out/a.txt").write_text("old", encoding="utf-8")
    before = there(tmp_path)
    with (
        pytest.raises(InputError, match=r"b\.txt: expected a file, found a directory"),
        atomic_directory("out") as partial,
    ):
        for name in ("a.txt", "b.txt"):
            (partial / name).write_text("new", encoding="utf-8")
    assert there(tmp_path) == before and Path("out/a.txt").read_text(encoding="utf-8") == "old"
