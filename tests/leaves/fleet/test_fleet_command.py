"""``truepose fleet`` from the command line: what it refuses in one line, and what it says where nothing could be done."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from support.command import invoke, refused
from support.tiny_fleets import write_fleet


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
