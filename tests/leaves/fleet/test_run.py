"""A fleet's run: the same bytes however it was worked out, nobody stopped by a machine that fails; its command's refusals."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import pandas as pd
import pytest

from support.command import invoke, refused
from support.tiny_fleets import GAIN, PLAY, rows, write_fleet, write_machine
from truepose.identification.leaves.fleet.run import run_fleet
from truepose.identification.leaves.fleet.work import Options
from truepose.pool import Cluster, Cores, Pool, cluster, several_threads

POISON = """
import os, signal
from truepose.models.effects.base import Effect, effects

@effects.add("poison")
class Poison(Effect):
    slug = "poison"
    title = "Kills the process"

    def places(self, machine):
        if machine.name == "poison":
            os.kill(os.getpid(), signal.SIGKILL)
        return []

    def coefficients(self, machine, place, settings):
        return ()

    def shifts(self, site):
        return {}
"""

KILLED = """
import os, signal, sys
from pathlib import Path
from truepose.identification.leaves.fleet.run import run_fleet
from truepose.identification.leaves.fleet.work import Options
from truepose.pool import Cores

def hear(finished, of, name):
    if " " not in name and finished == 2:
        os.kill(os.getpid(), signal.SIGKILL)

run_fleet(Path(sys.argv[1]), Path(sys.argv[2]), Cores(1), Options(brief=True), progress=hear)
"""
"""A run that is killed when two machines are done."""


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder."""
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def run(machines: Path, results: Path, pool: Pool, options: Options | None = None) -> list[str]:
    """The names of the machines that were worked with."""
    names = list[str]()

    def hear(_: int, __: int, name: str) -> None:
        names.append(name)

    run_fleet(machines, results, pool, options or Options(brief=True), progress=hear)
    return [name for name in names if " " not in name]  # else it is what goes on


def statuses(results: Path) -> dict[str, str]:
    table = pd.read_csv(results / "fleet.csv")
    return dict(zip(table["name"], table["status"], strict=True))


@pytest.fixture(scope="module")
def machines(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three that can be worked with, and one that lacks a column."""
    folder = write_fleet(
        tmp_path_factory.mktemp("here") / "line", {"gain": [GAIN], "play": [PLAY], "plain": []}
    )
    write_machine(folder / "unread", rows(9).drop(columns="q2"))
    return folder


@pytest.fixture(scope="module")
def reference(machines: Path, tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    """What one worker at a time makes of them."""
    results = tmp_path_factory.mktemp("one") / "results"
    assert sorted(run(machines, results, Cores(1))) == ["gain", "plain", "play", "unread"]
    return tree(results)


@pytest.fixture(scope="module")
def dask() -> Iterator[Cluster]:
    """Two workers; the scheduler gives up a task with which one has died."""
    distributed = pytest.importorskip("distributed")
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as local,
        cluster(local.scheduler_address) as found,
    ):
        yield found


def test_files_say_what_came_of_each(reference: Mapping[str, bytes]) -> None:
    told = json.loads(reference["fleet.json"])
    assert told["schema"] == "truepose/fleet/1"
    assert told["statuses"] == {"done": 3, "failed": 1}
    (undone,) = told["undone"]
    assert (undone["name"], undone["status"]) == ("unread", "failed")
    assert undone["why"].startswith("unread/recording.csv: missing column 'q2'")
    for name in ("calibrated.yaml", "fit.json", "diagnosis.json", "improved.yaml", "record.json"):
        assert f"machines/gain/{name}" in reference
    assert [name for name in reference if "/unread/" in name] == ["machines/unread/record.json"]
    diagnosis = json.loads(reference["machines/gain/diagnosis.json"])
    assert diagnosis["files"] == ["gain/recording.csv"]
    assert [f["effect"] for f in diagnosis["findings"]] == ["actuator-scale"]


@pytest.mark.nightly
def test_two_workers_in_another_place_give_the_same_bytes(
    machines: Path, reference: Mapping[str, bytes], tmp_path: Path
) -> None:
    shutil.copytree(machines, tmp_path / "there" / "line")
    run(tmp_path / "there" / "line", tmp_path / "results", Cores(2))
    assert tree(tmp_path / "results") == reference


@pytest.fixture(scope="module")
def poisoned(machines: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Options]:
    """The same machines, and one that kills whatever process works with it."""
    folder = tmp_path_factory.mktemp("poisoned")
    shutil.copytree(machines, folder / "line")
    shutil.copytree(machines / "plain", folder / "line" / "killer")
    file = folder / "line" / "killer" / "machine.yaml"
    file.write_text(file.read_text(encoding="utf-8").replace("name: tiny", "name: poison"), encoding="utf-8")
    (folder / "poison.py").write_text(POISON, encoding="utf-8")
    return folder / "line", Options(brief=True, plugins=(folder / "poison.py",))


@pytest.fixture(scope="module")
def survived(poisoned: tuple[Path, Options], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What two workers on cores make of them."""
    results = tmp_path_factory.mktemp("cores") / "results"
    run(poisoned[0], results, Cores(2), poisoned[1])
    return results


@pytest.mark.nightly
def test_a_machine_that_kills_its_process_stops_nobody(
    survived: Path, reference: Mapping[str, bytes]
) -> None:
    assert statuses(survived) == {
        "gain": "done", "killer": "broken", "plain": "done", "play": "done", "unread": "failed"
    }  # fmt: skip
    for name in ("gain", "plain", "play"):
        same = f"machines/{name}/diagnosis.json"
        assert (survived / same).read_bytes() == reference[same]


@pytest.mark.nightly
def test_dask_gives_the_same_bytes(
    poisoned: tuple[Path, Options], survived: Path, dask: Cluster, tmp_path: Path
) -> None:
    run(poisoned[0], tmp_path / "results", dask, poisoned[1])
    assert tree(tmp_path / "results") == tree(survived)


@pytest.mark.nightly
def test_killed_in_the_middle_it_goes_on(
    machines: Path, reference: Mapping[str, bytes], tmp_path: Path
) -> None:
    results = tmp_path / "results"
    ended = subprocess.run([sys.executable, "-c", KILLED, machines, results], check=False).returncode
    assert ended == -signal.SIGKILL
    assert not (results / "fleet.csv").exists()
    done = list(results.glob("machines/*/record.json"))
    assert len(done) >= 2  # a third may have been at work
    for found in done:
        assert tree(found.parent) == tree_of(reference, f"machines/{found.parent.name}/")
    whole = {found.parent.name for found in done}
    assert set(run(machines, results, Cores(2))) == {"gain", "plain", "play", "unread"} - whole
    left = {name: data for name, data in tree(results).items() if ".partial" not in name}
    assert left == reference


def tree_of(whole: Mapping[str, bytes], below: str) -> dict[str, bytes]:
    return {name.removeprefix(below): data for name, data in whole.items() if name.startswith(below)}


@pytest.mark.nightly
def test_only_what_changed_is_worked_with_again(machines: Path, tmp_path: Path) -> None:
    line, results = tmp_path / "line", tmp_path / "results"
    shutil.copytree(machines, line)
    run(line, results, Cores(2))
    assert run(line, results, Cores(2)) == []
    shutil.rmtree(line / "gain")
    write_machine(line / "plain", rows(2, [GAIN]))
    write_machine(line / "more", rows(7))
    assert sorted(run(line, results, Cores(2))) == ["more", "plain"]
    changes = json.loads((results / "fleet.json").read_text(encoding="utf-8"))["changes"]
    assert (changes["new"], changes["gone"]) == (["more"], ["gain"])
    said = {(one["machine"], one["what"]) for one in changes["said"]}
    assert said == {("plain", "verdict"), ("plain", "findings")}
    fresh = tmp_path / "fresh"
    run(line, fresh, Cores(2))
    for name in ("fleet.csv", "records.jsonl", "prior.yaml"):
        assert (results / name).read_bytes() == (fresh / name).read_bytes()


@pytest.mark.parametrize(
    ("environment", "wrong"),
    [
        ({"OMP_NUM_THREADS": "1"}, ""),
        ({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}, ""),
        ({}, "no OMP_NUM_THREADS"),
        ({"OMP_NUM_THREADS": "8"}, "OMP_NUM_THREADS=8"),
        ({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "2"}, "OPENBLAS_NUM_THREADS=2"),
    ],
)
def test_workers_whose_sums_are_rounded_otherwise_are_known(environment: dict[str, str], wrong: str) -> None:
    assert several_threads(environment) == wrong


@pytest.fixture
def line(tmp_path: Path) -> Path:
    return write_fleet(tmp_path / "line", {"a": []})


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--dask", "tcp://nowhere:1", "-j", "2"], "--dask: found with --workers, expected one of them"),
        (["--prior", "machine.yaml"], "schema: found 'truepose/machine/1', expected 'truepose/prior/1'"),
        (["--prior", "none.yaml"], "none.yaml: cannot read the file"),
        (["--plugin", "none.py"], "none.py"),
    ],
)
def test_bad_options_are_one_line(
    options: list[str], said: str, line: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(line / "a")
    refused("fleet", line, "-o", tmp_path / "results", *options, said=said)
    assert not (tmp_path / "results" / "machines").exists()


def test_a_cluster_needs_the_extra(line: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    options = ("-o", tmp_path / "results", "--dask", "tcp://127.0.0.1:9")
    refused("fleet", line, *options, said="expected the extra dask: pip install 'truepose[dask]'")


def test_folders_that_are_none(line: Path, tmp_path: Path) -> None:
    for folder, output, said in (
        (tmp_path / "none", "results", "expected a folder of machines, found nothing"),
        (line, line, "expected another folder for the results"),
        (line, line / "a" / "machine.yaml", "expected a directory for the results, found the file"),
    ):
        refused("fleet", folder, "-o", tmp_path / output, said=said)
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "fit.json").write_text("{}", encoding="utf-8")
    refused("fleet", line, "-o", tmp_path / "fit", said="found fit.json, a result of truepose calibrate")


def test_where_no_machine_can_be_done_the_files_say_why(line: Path, tmp_path: Path) -> None:
    (line / "a" / "machine.yaml").unlink()
    done = invoke("fleet", line, "-o", tmp_path / "results", "--json")
    told = json.loads(done.stdout)
    assert done.exit_code == 2 and "None of 1 machines could be diagnosed." in done.stderr
    assert (told["command"], told["schema"], told["statuses"]) == ("fleet", "truepose/fleet/1", {"failed": 1})
    assert "found no machine file" in told["undone"][0]["why"]
    assert [Path(file).name for file in told["files"]] == [
        "fleet.csv",
        "fleet.json",
        "fleet.html",
        "prior.yaml",
    ]
    assert all(Path(file).is_file() for file in told["files"])
