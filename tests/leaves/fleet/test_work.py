"""One machine of a fleet, and a fleet worked with in this process: what is kept, what is tried again, how files are told."""

from __future__ import annotations

import html
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from support.tiny_fleets import rows, write_machine
from truepose.errors import InputError
from truepose.identification.leaves.check.run import check_files
from truepose.identification.leaves.fleet.folder import Member, members
from truepose.identification.leaves.fleet.record import RECORD, Record
from truepose.identification.leaves.fleet.run import DEAD, Folders, run_fleet, settings_of
from truepose.identification.leaves.fleet.work import RESULTS, Options, Task, done
from truepose.identification.recording.load import load_recording
from truepose.models.load import load_machine

DIAGNOSE = "truepose.identification.diagnosis.diagnose.diagnose"


class DeadError(Exception):
    """What a pool raises for a task whose process died."""


class Here(Executor):
    """Tasks one after the other in this process; those of machines named ``dead`` kill theirs."""

    at_once, dead = 1, DeadError

    @contextmanager
    def executor(self) -> Iterator[Executor]:
        yield self

    def submit(self, work: Callable[..., Any], /, *arguments: Any, **_: Any) -> Future[Any]:
        (task,), future = arguments, Future[Any]()
        if isinstance(task, Task) and task.member.name == "dead":
            future.set_exception(DeadError())
        else:
            future.set_result(work(task))
        return future


def asked(folder: Path, name: str, recording: pd.DataFrame | None = None, **options: Any) -> Task:
    """Of a machine in a fleet's folder, with ``line & sons`` for its name."""
    line = folder / "line & sons"
    write_machine(line / name, rows(1) if recording is None else recording)
    (member,) = (one for one in members(line, folder / "results") if one.name == name)
    return Task(member, line, folder / "results" / name, "key", Options(brief=True, **options))


def test_files_are_told_as_seen_from_the_fleet_s_folder(tmp_path: Path) -> None:
    one = asked(tmp_path, "arm")
    file = tmp_path / "line & sons" / "arm" / "a.csv"
    assert one.told(f"{file}: wrong, {html.escape(str(file))}") == "arm/a.csv: wrong, arm/a.csv"
    assert one.told(str(tmp_path / "elsewhere")) == str(tmp_path / "elsewhere")
    found = one.record("failed", f"{file}:\n   two \t lines")
    assert found == Record("arm", "key", "failed", "arm/a.csv: two lines")
    assert one.record("broken").why == ""


def test_a_machine_that_failed_leaves_its_record_alone(tmp_path: Path) -> None:
    one = asked(tmp_path, "arm", rows(1).drop(columns="q2"))
    one.output.mkdir(parents=True)
    for name in RESULTS:
        (one.output / name).write_text("of other files", encoding="utf-8")
    found = done(one)
    assert found.status == "failed" and found.why.startswith("arm/recording.csv: missing column 'q2'")
    assert [path.name for path in one.output.iterdir()] == [RECORD]
    assert (one.output / RECORD).read_text(encoding="utf-8") == found.text() + "\n"
    assert done(replace(one, member=Member("arm", why="two machine files"))).why == found.why  # it is kept
    unread = replace(one, member=Member("arm", why="two machine files"), key="other")
    assert done(unread) == Record("arm", "other", "failed", "two machine files")


@pytest.mark.parametrize(
    ("key", "status", "kept"),
    [("key", "done", True), ("key", "refused", True), ("key", "broken", False), ("other", "done", False)],
)
def test_what_is_kept_of_the_same_files_is_not_worked_out_again(
    tmp_path: Path, key: str, status: Any, kept: bool
) -> None:
    one = asked(tmp_path, "arm", rows(1).drop(columns="q2"))
    before = Record("arm", key, status, "as it was")
    one.output.mkdir(parents=True)
    (one.output / RECORD).write_text(before.text(), encoding="utf-8")
    found = done(one)
    assert (found == before) is kept and (found.status == "failed") is not kept


@pytest.mark.parametrize("learned", [False, True])
def test_a_diagnosis_is_given_what_the_options_say(
    tmp_path: Path, learned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = list[Any]()

    def diagnose(*given: Any, prior: Any, examine: Any) -> None:
        seen.extend([*given, prior])
        raise InputError("no more than that")

    prior = "truepose.identification.learned_prior.read_prior"
    monkeypatch.setattr(DIAGNOSE, diagnose)
    monkeypatch.setattr(prior, lambda file: f"learned in {file.name}")
    found = done(asked(tmp_path, "arm", prior=tmp_path / "prior.yaml" if learned else None))
    assert (found.status, found.why) == ("failed", "no more than that")
    machine, recording, told = seen
    assert machine.file.path == Path("arm/machine.yaml") and recording.files == ("arm/recording.csv",)
    assert told == ("learned in prior.yaml" if learned else None)


def test_a_fault_of_the_program_is_told_with_its_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def diagnose(*_: Any, prior: Any, examine: Any) -> None:
        raise ZeroDivisionError(f"by {prior}")

    monkeypatch.setattr(DIAGNOSE, diagnose)
    found = done(asked(tmp_path, "arm"))
    assert (found.status, found.why) == ("broken", "unexpected ZeroDivisionError: by None")


@pytest.mark.parametrize("anyway", [False, True])
@pytest.mark.parametrize("loaded", [False, True])
def test_files_that_do_not_belong_together_are_worked_with_where_it_is_asked_for(
    tmp_path: Path, anyway: bool, loaded: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As long as there is something to work with: of a machine without a sensor there are no rows."""

    def diagnose(*_: Any, prior: Any, examine: Any) -> None:
        raise InputError(f"reached, {prior}")

    one = asked(tmp_path, "arm", anyway=anyway)
    assert one.member.machine is not None
    whole = load_machine(one.member.machine)
    read = load_recording(whole, one.member.recordings)
    text = one.member.machine.read_text(encoding="utf-8")
    one.member.machine.write_text(text.partition("sensor:")[0], encoding="utf-8")
    wrong, *nothing = check_files(one.member.machine, one.member.recordings)
    given = (wrong, whole, read) if loaded else (wrong, *nothing)
    monkeypatch.setattr(DIAGNOSE, diagnose)
    monkeypatch.setattr("truepose.identification.leaves.check.gate.check_files", lambda *_, **__: given)
    found = done(one)
    assert found.status == ("failed" if anyway and loaded else "wrong")
    assert (found.why == "reached, None") is (anyway and loaded)


# -- a whole run ---------------------------------------------------------------------------------------


def test_every_setting_is_one_of_what_results_depend_on(tmp_path: Path) -> None:
    for name in ("plugin.py", "other.py", "prior.yaml"):
        (tmp_path / name).write_text(name, encoding="utf-8")
    plugin, other, prior = (tmp_path / name for name in ("plugin.py", "other.py", "prior.yaml"))
    options = [
        Options(), Options(anyway=True), Options(shuffled=True), Options(brief=True), Options(plugins=(plugin,)),
        Options(plugins=(other,)), Options(plugins=(plugin, other)), Options(prior=prior), Options(plugins=(prior,)),
    ]  # fmt: skip
    told = [settings_of(one) for one in options]
    assert len(set(told)) == len(told)
    assert settings_of(Options(limit=3.0)) == told[0]  # a limit changes no result, it may only leave one out
    assert [settings_of(one) for one in options] == told
    plugin.write_text("changed", encoding="utf-8")
    assert [settings_of(one) == was for one, was in zip(options, told, strict=True)] == [
        "plugin.py" not in str(one.plugins) for one in options
    ]


def test_a_run_says_how_far_it_is_and_leaves_no_journal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Machines whose files cannot be read, or whose process dies, are rows like all others; these alone are tried again."""
    line, key = tmp_path / "line", Member.key
    for name in ("dead", "lost", "unread"):
        write_machine(line / name, rows(1).drop(columns="q2"))

    def lost(member: Member, folder: Path, settings: str) -> str:
        if member.name == "lost" and not member.why:
            raise OSError(2, "No such file", str(line / "lost" / "rows.csv"))
        return key(member, folder, settings)

    monkeypatch.setattr(Member, "key", lost)
    folders, heard = Folders.of(line, tmp_path / "results"), list[tuple[int, int, str]]()
    fleet = run_fleet(folders, Here(), Options(brief=True), progress=lambda *told: heard.append(told))
    names = ("dead", "lost", "unread")
    assert heard == [
        *((k, 3, f"looking for changes, {name}") for k, name in enumerate(names)),
        (0, 3, "3 of 3 to work with"), (1, 3, "lost"), (2, 3, "unread"), (3, 3, "dead"), (1, 1, "what they say together"),
    ]  # fmt: skip
    told = [(row.name, row.status, row.why.partition(":")[0]) for row in fleet.rows]
    assert told == [
        ("dead", "broken", DEAD), ("lost", "failed", "cannot read rows.csv"), ("unread", "failed", "unread/recording.csv"),
    ]  # fmt: skip
    assert fleet.brief and not folders.journal.path.exists() and fleet.changes is None
    again = run_fleet(folders, Here(), Options(brief=True), progress=lambda *told: heard.append(told))
    assert heard[-3:] == [(0, 1, "1 of 3 to work with"), (1, 1, "dead"), (1, 1, "what they say together")]
    assert [row.name for row in again.rows] == list(names) and again.changes is not None


def test_a_run_of_which_nothing_is_left_to_do_says_so(tmp_path: Path) -> None:
    write_machine(tmp_path / "line" / "unread", rows(1).drop(columns="q2"))
    folders, heard = Folders.of(tmp_path / "line", tmp_path / "results"), list[tuple[int, int, str]]()
    run_fleet(folders, Here(), Options(brief=True))
    run_fleet(folders, Here(), Options(brief=True), progress=lambda *told: heard.append(told))
    assert heard[1:] == [(0, 1, "0 of 1 to work with"), (1, 1, "what they say together")]
