"""Cases of an examination side by side: by processes, by what joblib is told, and what happens when one breaks."""

from __future__ import annotations

import os
import threading
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import joblib
import pytest

from challenge import examine
from challenge.examine import Challenge


def _done(folder: Path, count: int) -> Challenge:
    """An examination whose cases are all sat."""
    for name in (seat.name for seat in Challenge(folder, count).seats):
        for file in (f"answers/{name}.json", f"cases/{name}/heldout.csv", f"results/{name}/run.json"):
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).touch()
    return Challenge(folder, count)


def test_what_joblib_is_told_to_use_takes_the_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    threads, heard = dict[str, int](), list[tuple[int, int, str]]()
    monkeypatch.setattr(
        examine, "write_and_sit", lambda _, seat, __: threads.update({seat.name: threading.get_ident()})
    )
    with joblib.parallel_config(backend="threading"):
        seats = examine.run(_done(tmp_path, 5), jobs=2, progress=lambda *said: heard.append(said))
    assert set(threads) == {seat.name for seat in seats} and threading.get_ident() not in threads.values()
    assert [(done, of) for done, of, _ in heard] == [(k, 5) for k in range(1, 6)]
    assert {name for *_, name in heard} == set(threads)


@pytest.mark.parametrize("jobs", [1, 2])
def test_what_goes_wrong_with_a_case_is_raised(
    jobs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(examine, "write_and_sit", full)
    with joblib.parallel_config(backend="threading"), pytest.raises(OSError, match="no space left"):
        examine.run(_done(tmp_path, 3), jobs=jobs)


def test_every_process_loads_the_plugins_once(tmp_path: Path) -> None:
    plugin = tmp_path / "plugin.py"
    plugin.write_text(
        f"import os\nwith open({str(tmp_path / 'pids')!r}, 'a') as f: f.write(f'{{os.getpid()}} ')\n"
    )
    heard = list[str]()
    examine.run(
        replace(_done(tmp_path / "examination", 8), plugins=(plugin,)),
        jobs=2,
        progress=lambda *said: heard.append(said[2]),
    )
    pids = (tmp_path / "pids").read_text().split()
    assert 1 <= len(pids) == len(set(pids)) <= 2 and str(os.getpid()) not in pids
    assert sorted(heard) == [f"case{k:03d}" for k in range(1, 9)]


def test_a_killed_process_ends_the_examination(tmp_path: Path) -> None:
    plugin = tmp_path / "plugin.py"
    plugin.write_text("import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n")
    with pytest.raises(BrokenProcessPool):
        examine.run(replace(_done(tmp_path / "examination", 2), plugins=(plugin,)), jobs=2)
