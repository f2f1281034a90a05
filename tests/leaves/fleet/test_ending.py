"""The end of a run: the same files whatever had been kept before, and however many machines are worked out at once."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from support.fleets import mixed_machines
from truepose.errors import InputError
from truepose.identification.leaves.fleet import ending
from truepose.identification.leaves.fleet.ending import TABLE, Folders, ended
from truepose.identification.leaves.fleet.record import Record, Status
from truepose.identification.leaves.fleet.result import SHOWN, Fleet
from truepose.identification.leaves.fleet.store import STORE, SUMS

MADE = (TABLE, "prior.yaml", STORE, SUMS)
MACHINES = 2 * ending.TOGETHER + 5


def records(seed: int, number: int = MACHINES) -> list[Record]:
    """Of machines by name; of every ten one is no calibration and one failed."""
    kept = mixed_machines(np.random.default_rng(seed), number)
    statuses: list[Status] = [("refused", "failed")[k % 10] if k % 10 < 2 else "done" for k in range(number)]
    out = list[Record]()
    for k, (status, evidence) in enumerate(zip(statuses, kept, strict=True)):
        if status == "failed":
            out.append(Record(f"m{k:03d}", f"{seed}-{k}", status, "no such column, 'q2'"))
            continue
        rms = {"position": {"before": 3.0, "after": 1.0, "unit": "um", "held_out": False}}
        figures = {
            "machine": "arm", "check": "ok", "verdict": evidence["verdict"], "concealed": None if k % 3 else True,
            "chi2": [4.0, 1.25], "rms": {} if k % 4 else rms, "ratio": None, "noise": 1.01, "findings": [], "remainder": None,
        }  # fmt: skip
        constants = {name: (x, 0.1) for name, (x, *_) in evidence["parameters"].items()}
        out.append(Record(f"m{k:03d}", f"{seed}-{k}", status, "", figures, constants, evidence))
    return out


def end(folder: Path, now: Sequence[Record], noted: Sequence[Record] | None = None) -> dict[str, bytes]:
    """End a run that noted these (or all) in a folder; what it made."""
    folders = Folders(folder.parent / "line", folder)
    with folders.journal.open() as stream:
        for record in now if noted is None else noted:
            folders.journal.note(stream, record)
    ended({record.name: record.key for record in now}, folders, brief=True)
    folders.journal.path.unlink()
    return {name: (folder / name).read_bytes() for name in MADE}


@pytest.mark.nightly
def test_files_do_not_tell_in_which_runs_machines_were_done(tmp_path: Path) -> None:
    now, before = records(1), records(2)
    whole = end(tmp_path / "whole", now)
    parts = tmp_path / "parts"
    end(parts, before[: MACHINES // 2] + now[MACHINES // 2 : -3])
    half = end(parts, now[:-3], now[: MACHINES // 2])
    assert end(parts, now, now[-3:]) == whole and half != whole
    assert end(parts, now[3:], []) == end(tmp_path / "without", now[3:])
    assert end(parts, now, now[:3]) == whole
    (parts / SUMS).unlink()
    assert end(parts, now, []) == whole


@pytest.mark.parametrize("together", [1, 7, MACHINES])
def test_files_do_not_tell_how_many_were_worked_out_at_once(
    together: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = end(tmp_path / "whole", records(3))
    monkeypatch.setattr(ending, "TOGETHER", together)
    assert end(tmp_path / "other", records(3)) == whole


def test_of_a_machine_without_a_calibration_nothing_is_said_of_its_oddness(tmp_path: Path) -> None:
    now = records(4)
    end(tmp_path / "results", now)
    found = pd.read_csv(tmp_path / "results" / TABLE)
    assert found["name"].tolist() == [record.name for record in now]
    assert found["oddness"].notna().tolist() == [record.status == "done" for record in now]


def test_the_page_counts_all_and_shows_some(tmp_path: Path) -> None:
    number = SHOWN + 60
    now = [Record(f"m{k:04d}", "k", "failed" if k % 2 else "broken", "why") for k in range(number)]
    folders = Folders(tmp_path / "line", tmp_path / "results")
    with folders.journal.open() as stream:
        for record in now:
            folders.journal.note(stream, record)
    fleet = ended({record.name: record.key for record in now}, folders, brief=True)
    assert fleet.machines == number and fleet.statuses == {"failed": number // 2, "broken": number // 2}
    assert [one.name for one in fleet.rows] == [record.name for record in now[:SHOWN]]
    assert len(fleet.undone) == SHOWN and fleet.odd == 0


def test_a_record_of_another_version_is_told_with_its_file(tmp_path: Path) -> None:
    now = records(5, 4)
    end(tmp_path / "results", now)
    table = pd.read_parquet(tmp_path / "results" / STORE)
    table["record"] = table["record"].str.replace("fleet-record/1", "fleet-record/0")
    table.to_parquet(tmp_path / "results" / STORE)
    changed = [replace(record, key="other") for record in now]
    with pytest.raises(InputError, match=r"results/fleet\.parquet: found a record of another version"):
        end(tmp_path / "results", changed)
    shutil.rmtree(tmp_path / "results")
    assert end(tmp_path / "results", changed)


def test_the_page_shows_the_oddest_and_counts_what_machines_are_found_to_be(tmp_path: Path) -> None:
    """As the table has them; what changed is told from the second run on."""
    now = records(6)
    folders = Folders(tmp_path / "line", tmp_path / "results")

    def ending_of(some: Sequence[Record]) -> Fleet:
        with folders.journal.open() as stream:
            for record in some:
                folders.journal.note(stream, record)
        fleet = ended({record.name: record.key for record in some}, folders, brief=False)
        folders.journal.path.unlink()
        return fleet

    fleet = ending_of(now)
    table = pd.read_csv(folders.results / TABLE)
    odd = table[table["odd"].fillna(value=False).astype(bool)].sort_values(
        ["oddness", "name"], ascending=[False, True]
    )
    assert fleet.odd == len(odd) > 1 and [row.name for row in fleet.unusual] == odd["name"].tolist()
    assert fleet.verdicts == table["verdict"].dropna().value_counts().to_dict()
    assert fleet.statuses == table["status"].value_counts().to_dict()
    assert [row.name for row in fleet.undone] == table.loc[table["status"] == "failed", "name"].tolist()
    assert fleet.name == "line" and not fleet.brief and fleet.changes is None
    less = ending_of(now[1:])
    assert less.changes is not None and less.changes.gone == ("m000",) and less.machines == len(now) - 1
