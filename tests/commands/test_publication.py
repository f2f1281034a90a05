"""A result of several files is seen whole: old or new, wherever the process that publishes it is killed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from support import killed
from truepose.errors import InputError
from truepose.files import atomic_directory, atomic_file, atomic_write_text

SCRIPT = Path(killed.__file__)
BEFORE, AFTER = killed.OWN | killed.OLD, killed.OWN | killed.NEW
pytestmark = pytest.mark.skipif(os.name == "nt", reason="no SIGKILL")


def _killed(room: Path, *options: str) -> list[Path]:
    """Folders with an ``out`` in which a publication was killed before its first, second ... change; the last was not."""
    done = subprocess.run(
        [sys.executable, SCRIPT, room, *options], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    number = int(done.stdout)
    assert number > 10
    return [room / str(k) for k in range(number)]


def _seen(folder: Path) -> dict[str, str]:
    """What can be read below a folder, by name; not what is hidden."""
    names = (path.relative_to(folder) for path in folder.rglob("*"))
    shown = (name for name in names if not any(part.startswith(".") for part in name.parts))
    return {
        name.as_posix(): (folder / name).read_text(encoding="utf-8")
        for name in shown
        if (folder / name).is_file()
    }


def _everything(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*")}


def _clean(room: Path, result: Mapping[str, str]) -> None:
    """The room holds these files, none a link, and nothing else."""
    assert _seen(room / "out") == result
    names = {Path("out") / name for name in result}
    folders = {parent.as_posix() for name in names for parent in name.parents if parent != Path()}
    own = {killed.ELSEWHERE, "out/empty"} if killed.OWN.items() <= result.items() else set()
    assert _everything(room) == {name.as_posix() for name in names} | folders | own
    assert not [name for name in result if name != "linked.txt" and (room / "out" / name).is_symlink()]


@pytest.mark.parametrize("options", [(), ("here",)], ids=["elsewhere", "working directory"])
def test_a_killed_publication_leaves_all_old_or_all_new(tmp_path: Path, options: tuple[str, ...]) -> None:
    rooms = _killed(tmp_path, *options)
    seen = [_seen(room / "out") for room in rooms]
    first_new = seen.index(AFTER)
    assert 0 < first_new < len(rooms) - 1
    assert seen == [BEFORE] * first_new + [AFTER] * (len(rooms) - first_new)  # one step
    for room, result in zip(rooms, seen, strict=True):
        again = room.with_name(f"{room.name} again")
        shutil.copytree(room, again, symlinks=True)
        (again / "out").rename(again / "moved")
        assert _seen(again / "moved") == result  # copied and moved as it stands, it is still whole
        with atomic_directory(room / "out") as partial:
            killed.fill(partial, {"last.txt": "last"})
        _clean(room, result | {"last.txt": "last"})
        with atomic_directory(again / "moved") as partial:
            killed.fill(partial, killed.NEW)
        (again / "moved").rename(again / "out")
        _clean(again, AFTER)
        assert (room / killed.ELSEWHERE).read_text(encoding="utf-8") == killed.OLD["linked.txt"]


def test_a_new_folder_is_there_whole_or_not_at_all(tmp_path: Path) -> None:
    rooms = _killed(tmp_path, "fresh")
    seen = [_seen(room / "out") if (room / "out").exists() else None for room in rooms]
    first_new = seen.index(killed.NEW)
    assert seen == [None] * first_new + [killed.NEW] * (len(rooms) - first_new)
    for room in rooms:
        with atomic_directory(room / "out") as partial:
            killed.fill(partial, killed.NEW)
        _clean(room, killed.NEW)


def test_where_links_cannot_be_made_a_mix_is_marked_and_mended(tmp_path: Path) -> None:
    rooms = _killed(tmp_path, "nolinks")
    mixed = 0
    for room in rooms:
        seen = _seen(room / "out")
        if seen not in (BEFORE, AFTER):
            assert list((room / "out").glob(".*.partial/now"))
            mixed += 1
        with atomic_directory(room / "out") as partial:
            killed.fill(partial, {"last.txt": "last"})
        result = _seen(room / "out")
        assert result in (BEFORE | {"last.txt": "last"}, AFTER | {"last.txt": "last"})
        assert seen in (BEFORE, AFTER) or result["a.txt"] == "new a"
        _clean(room, result)
    (tmp_path / "again").mkdir()
    for room in _killed(tmp_path / "again", "nolinks"):
        atomic_write_text(room / "out" / "a.txt", "single")
        assert _seen(room / "out")["a.txt"] == "single"
        assert not list((room / "out").glob(".*.partial"))
    assert 0 < mixed < len(killed.NEW)


def test_a_single_file_ends_what_a_killed_run_began(tmp_path: Path) -> None:
    """It is not written through that run's links, and nothing is left of it."""
    through = 0
    for room in _killed(tmp_path):
        through += (room / "out" / "a.txt").is_symlink()
        before = _seen(room / "out")
        atomic_write_text(room / "out" / "a.txt", "single")
        _clean(room, before | {"a.txt": "single"})
    assert through > 5


def test_an_old_file_comes_back_as_it_was(tmp_path: Path) -> None:
    """Undone, a result is the very files it was: inode, time and mode."""
    undone = 0
    for room in _killed(tmp_path):
        file = room / "out" / "a.txt"
        if not file.is_symlink() or _seen(room / "out") != BEFORE:
            continue
        was = file.stat()
        with atomic_directory(room / "out") as partial:
            killed.fill(partial, {"last.txt": "last"})
        now = file.lstat()
        assert (now.st_ino, now.st_mtime_ns, now.st_mode) == (was.st_ino, was.st_mtime_ns, was.st_mode)
        undone += 1
    assert undone > 5


def test_what_stands_in_the_way_leaves_everything_as_it_was(tmp_path: Path) -> None:
    killed.before(tmp_path / "room")
    out = tmp_path / "room" / "out"
    for name, way in (("empty", "a directory"), ("a.txt/x.txt", "a file")):
        before, everything = _seen(out), _everything(tmp_path)
        with pytest.raises(InputError, match=f"found {way}"), atomic_directory(out) as partial:
            killed.fill(partial, {"b.txt": "new b", name: "new", "zz.txt": "new z"})
        assert (_seen(out), _everything(tmp_path)) == (before, everything)


@pytest.fixture
def full_disk(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """Renames that fail once, after so many: the list's only entry."""
    left, rename = [0], os.replace

    def replace(*names: str) -> None:
        left[0] -= 1
        if left[0] == -1:
            raise OSError(28, "No space left on device")
        rename(*names)

    monkeypatch.setattr(os, "replace", replace)
    yield left


def test_a_rename_that_fails_leaves_all_old_or_all_new(tmp_path: Path, full_disk: list[int]) -> None:
    outcomes = []
    for spared in range(100):
        killed.before(room := tmp_path / str(spared))
        full_disk[0] = spared
        try:
            with atomic_directory(room / "out") as partial:
                killed.fill(partial, killed.NEW)
        except InputError as exc:
            assert "No space left on device" in str(exc)
        outcomes.append(_seen(room / "out"))
        if full_disk[0] >= 0:
            break
        full_disk[0] = 1000
        with atomic_directory(room / "out") as partial:
            killed.fill(partial, {"last.txt": "last"})
        _clean(room, outcomes[-1] | {"last.txt": "last"})
    turned = outcomes.index(AFTER)
    assert turned > 3 and outcomes == [BEFORE] * turned + [AFTER] * (len(outcomes) - turned)


def test_a_publication_that_lives_is_left_alone(tmp_path: Path) -> None:
    killed.before(tmp_path / "room")
    out = tmp_path / "room" / "out"
    with atomic_directory(out) as slow:
        killed.fill(slow, {"a.txt": "slow a", "b.txt": "slow b"})
        with atomic_directory(out) as quick:
            killed.fill(quick, {"a.txt": "quick a", "b.txt": "quick b"})
        assert _seen(out)["b.txt"] == "quick b"
    assert (_seen(out)["a.txt"], _seen(out)["b.txt"]) == ("slow a", "slow b")
    assert not list(tmp_path.rglob("*.partial"))


def test_results_written_at_the_same_time_do_not_mix(tmp_path: Path) -> None:
    killed.before(tmp_path / "room")
    out, names = tmp_path / "room" / "out", [f"{k}.txt" for k in range(8)]

    def write(author: str) -> None:
        for _ in range(15):
            with atomic_directory(out) as partial:
                killed.fill(partial, dict.fromkeys(names, author))

    writers = [threading.Thread(target=write, args=(author,)) for author in "abc"]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    assert len({_seen(out)[name] for name in names}) == 1
    assert not list(tmp_path.rglob("*.partial"))


def test_what_a_killed_writer_of_one_file_left_goes(tmp_path: Path) -> None:
    target = tmp_path / "result.txt"
    left, other = tmp_path / f".result.txt.{'a' * 12}.partial", tmp_path / f".other.txt.{'a' * 12}.partial"
    users = tmp_path / ".result.txt.mine.partial"
    for path in (left, other, users):
        path.write_text("half")
    with atomic_file(target) as lives:
        atomic_write_text(target, "one")
        assert lives.exists() and not left.exists()
        lives.write_text("two")
    assert target.read_text() == "two"
    assert sorted(tmp_path.iterdir()) == sorted([target, other, users])


def test_one_file_settles_the_folder_that_it_goes_into(tmp_path: Path) -> None:
    """A killed run may have begun to publish the folder as a whole."""
    begun, users = tmp_path / f".{'b' * 12}.partial", tmp_path / ".mine.partial"
    for folder in (begun, users):
        folder.mkdir()
        (folder / "half.txt").write_text("half")
    atomic_write_text(tmp_path / "result.txt", "whole")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".mine.partial", "result.txt"]
