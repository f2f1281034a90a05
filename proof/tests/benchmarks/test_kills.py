"""Commands killed or stopped at random moments leave the old result or the new one; and the study would see a mixture."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from kills.cases import CASES, Case, state
from kills.inputs import write_inputs
from kills.room import make_room, result, run
from kills.study import study

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no fork")
QUICK = ("init", "export", "codegen")


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("kills") / "in"
    write_inputs(folder)
    return folder


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", QUICK)
def test_old_or_new_and_no_litter(name: str, number: int, inputs: Path, tmp_path: Path) -> None:
    (case,) = (case for case in CASES if case.name == name)
    row = study(case, inputs, tmp_path, kills=10 if number == signal.SIGKILL else 4, seed=1, number=number)
    assert row.right, row
    assert row.states["old"] + row.states["new"] == row.kills


def _by_halves(words: list[str]) -> None:
    """A result of two files, one after the other."""
    folder = Path(words[-1])
    folder.mkdir(exist_ok=True)
    for name in ("a.txt", "b.txt"):
        (folder / name).write_text(words[0], encoding="utf-8")
        time.sleep(0.2)  # most of the time is between the two


def _noisy(words: list[str]) -> None:
    """A whole result, and litter that stays."""
    (Path(words[-1]) / "a.txt").write_text(words[0], encoding="utf-8")
    (Path(words[-1]) / f".litter{time.monotonic_ns()}").touch()
    time.sleep(0.05)


def _silent(words: list[str]) -> None:
    """One that does not hear Ctrl-C."""
    try:
        time.sleep(0.1)
    except KeyboardInterrupt:
        os._exit(3)
    (Path(words[-1]) / "a.txt").write_text(words[0], encoding="utf-8")


def test_the_study_sees_what_is_wrong(inputs: Path, tmp_path: Path) -> None:
    found = []
    for name, own, number in (
        ("halves", _by_halves, signal.SIGKILL),
        ("noisy", _noisy, signal.SIGKILL),
        ("silent", _silent, signal.SIGINT),
    ):
        folder = tmp_path / name
        folder.mkdir()
        case = Case(name, "{n} out", run=own)
        found.append(study(case, inputs, folder, kills=6, seed=1, number=number))
    halves, noisy, silent = found
    assert halves.states["mixed"] and noisy.litter and silent.untrue
    assert not any(row.right for row in found)


def test_machines_of_a_fleet_may_be_missing_but_not_mixed() -> None:
    old = {"fleet.csv": b"1", "machines/a/x": b"1", "machines/a/y": b"1", "machines/b/x": b"1"}
    new = dict.fromkeys(old, b"2")
    without = {name: data for name, data in old.items() if "/a/" not in name}
    assert state(old, old, new) == "old" and state(new, old, new) == "new"
    assert state(without, old, new) == "old"
    assert state(old | {"machines/b/x": b"2"}, old, new) == "old"
    assert state(old | {"machines/a/x": b"2"}, old, new) == "mixed"
    assert state({name: data for name, data in old.items() if name != "machines/a/x"}, old, new) == "mixed"
    assert state(old | {"fleet.csv": b"3"}, old, new) == "mixed"


def test_two_real_processes_with_one_folder_do_not_mix(inputs: Path, tmp_path: Path) -> None:
    """Each writes its own machine's C over the other's, again and again; a reader sees one of both."""
    (case,) = (case for case in CASES if case.name == "codegen")
    for n in (1, 2):
        make_room(tmp_path / str(n), inputs, None)
        run(case, n, tmp_path / str(n))
    one, two = (result(tmp_path / str(n)) for n in (1, 2))
    make_room(tmp_path / "both", inputs, None)
    writers = []
    for n in (1, 2):
        writer = os.fork()
        if writer == 0:
            try:
                for _ in range(4):
                    ended = run(case, n, tmp_path / "both")
                    assert ended.code == 0, ended.said
            except BaseException:
                os._exit(1)
            os._exit(0)
        writers.append(writer)
    assert [os.waitstatus_to_exitcode(os.waitpid(writer, 0)[1]) for writer in writers] == [0, 0]
    assert dict(result(tmp_path / "both")) in (dict(one), dict(two))
    assert dict(one) != dict(two)
    assert not list((tmp_path / "both").rglob("*.partial"))
